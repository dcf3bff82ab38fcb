"""The point cloud: coordinates in metres about a local origin, and the scanner's data on each point."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import inlined_kernel, kernel
from eaves.model.block import BLOCK_SIDE, Block, Bounds, extremes
from eaves.model.checks import Integers, Mask, Pictured, Points, Values, as_points, check_lengths
from eaves.model.coordinates import LOCAL_METRES, CoordinateSystem

if TYPE_CHECKING:
    from pyproj import CRS

UNCLASSIFIED, GROUND, LOW_VEGETATION, MEDIUM_VEGETATION, HIGH_VEGETATION, BUILDING = 1, 2, 3, 4, 5, 6
LOW_NOISE, WATER, HIGH_NOISE = 7, 9, 18
WIRE, WIRE_TOWER, BRIDGE_DECK = 14, 15, 17
NOISE_CLASSES = (LOW_NOISE, HIGH_NOISE)
"""Class codes of LAS 1.4, table 17."""

ARRAYS = ("return_number", "number_of_returns", "classification", "part", "point_id")
"""Attributes of points that a cloud may have besides coordinates."""
GRID_STEP = 1e-4
"""Local coordinates are whole multiples of this (m), so data moved by whole blocks compute identically."""

FARTHEST = 40 * BLOCK_SIDE
"""Coordinates without an origin that start farther from it (m) are those of the world: they are counted from
the corner of a block, where the numbers of methods keep their digits."""


@dataclass(frozen=True, eq=False)
class PointCloud(Pictured):
    """N points. Every array has N rows in the same order; none is ever written to.

    Parameters
    ----------
    xyz : ndarray (N, 3) of float64
        x, y, z in metres: x and y about `origin`, z as in the world. World coordinates without an origin get
        the corner of a block as origin, as `from_world` gives it.
    origin : (float, float)
        World position (m) of local (0, 0).
    return_number, number_of_returns : ndarray (N,) of uint8 or None
        Number of each return in its pulse, from 1, and how many the pulse has.
    classification : ndarray (N,) of uint8 or None
        LAS classes: the file's until `classify_ground`, those of this package (1, 2, 6, 7, 18) after it.
    part : ndarray (N,) of uint8 or None
        Walls, trees and small regions (codes of `model.scene`) that a ground filter found.
    point_id : ndarray (N,) of int64 or None
        Position of each point in the input, counted through all files in order.
    fields : mapping of str to ndarray (N,) of float64
        What else the files hold of the points, where it was asked for: `intensity`, `red`, `green`, `blue`,
        `nir`, `scan_angle` (degrees), `gps_time` (s), `point_source_id`, extra dimensions by their names.
    system : CoordinateSystem
        Reference system of the world coordinates.
    ordered : bool
        True if the points are known to be in canonical order.

    Raises
    ------
    TypeError
        When `xyz` are no numbers.
    ValueError
        When `xyz` is not (N, 3), or another array has not one value a point.

    Examples
    --------
    >>> import numpy as np
    >>> from eaves import PointCloud
    >>> cloud = PointCloud.from_world(np.array([[85000.0, 447000.0, 1.5], [85001.0, 447002.0, 1.7]]))
    >>> len(cloud), cloud.origin
    (2, (84960.0, 446880.0))
    """

    xyz: Points
    origin: tuple[float, float] = (0.0, 0.0)
    return_number: NDArray[np.uint8] | None = None
    number_of_returns: NDArray[np.uint8] | None = None
    classification: NDArray[np.uint8] | None = None
    part: NDArray[np.uint8] | None = None
    point_id: Integers | None = None
    fields: Mapping[str, Values] = field(default_factory=dict)
    system: CoordinateSystem = field(default=LOCAL_METRES)
    ordered: bool = False

    def __post_init__(self) -> None:
        xyz, origin = as_points(self.xyz, "xyz"), self.origin
        if origin == (0.0, 0.0) and len(xyz) and np.fmax.reduce(np.abs(xyz[:, :2]), axis=None) > FARTHEST:
            xyz, origin = brought_near(xyz)
        arrays = {name: array if array is None else np.asarray(array) for name, array in self._arrays.items()}
        check_lengths(len(xyz), arrays | dict(self.fields))
        for name, value in {"xyz": xyz, "origin": origin, **arrays}.items():
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.xyz)

    def __getitem__(self, which: Any) -> PointCloud:
        """The points that a mask (N,), indices, a slice or one index picks."""
        return self.take(np.atleast_1d(np.arange(len(self))[which]))

    @property
    def _arrays(self) -> dict[str, NDArray[Any] | None]:
        return {name: getattr(self, name) for name in ARRAYS}

    @property
    def world(self) -> Points:
        """World coordinates (N, 3) in metres."""
        return np.asarray(self.xyz + np.array([*self.origin, 0.0]))

    @property
    def crs(self) -> CRS | None:
        """The reference system as a pyproj.CRS; None for a plane without a place on Earth."""
        from pyproj import CRS

        return None if self.system.wkt is None else CRS.from_wkt(self.system.wkt)

    @property
    def bounds(self) -> Bounds:
        """Local metres of the points that have coordinates; ValueError when none has."""
        known = self.xyz
        if len(known) and not np.isfinite(extremes(known)).all():
            known = known[np.isfinite(known).all(axis=1)]
        if not len(known):
            raise ValueError("the cloud has no points and so no bounds; check the area that was read")
        return Bounds.of(known)

    @property
    def ground(self) -> Mask:
        """Mask (N,) of the ground points (class 2)."""
        if self.classification is None:
            raise ValueError("the cloud has no classes; call classify_ground(cloud) first")
        return np.asarray(self.classification == GROUND)

    @property
    def noise(self) -> Mask:
        """Mask (N,) of the noise points (classes 7 and 18); none where there are no classes."""
        if self.classification is None:
            return np.zeros(len(self), bool)
        low, high = NOISE_CLASSES
        return np.asarray((self.classification == low) | (self.classification == high))

    @property
    def has_returns(self) -> bool:
        """True if the scanner recorded several returns of a pulse."""
        return self.number_of_returns is not None and bool(np.any(self.number_of_returns > 1))

    def with_(self, **changes: object) -> PointCloud:
        """A copy with some arrays replaced."""
        if not changes.keys().isdisjoint(("xyz", "return_number")):
            changes.setdefault("ordered", False)
        return replace(self, **changes)  # type: ignore[arg-type]

    def take(self, which: Mask | Integers) -> PointCloud:
        """The points picked by a mask (N,) or by indices, in that order; the cloud itself when it is all."""
        # to take by indices, and along the first axis, is several times as fast as to index
        index = np.flatnonzero(which) if which.dtype == np.bool_ else which
        if len(index) == len(self) and bool((index == np.arange(len(self))).all()):
            return self
        arrays: dict[str, Any] = {
            name: array if array is None else array.take(index) for name, array in self._arrays.items()
        }
        if self.fields:
            arrays["fields"] = {name: values.take(index) for name, values in self.fields.items()}
        ordered = self.ordered and bool((index[1:] > index[:-1]).all())
        return replace(self, xyz=self.xyz.take(index, axis=0), **arrays, ordered=ordered)

    def about(self, origin: tuple[float, float]) -> PointCloud:
        """The same points with local coordinates counted from another origin (world metres)."""
        if origin == self.origin:
            return self
        shift = np.array([self.origin[0] - origin[0], self.origin[1] - origin[1], 0.0])
        ordered = self.ordered and bool((shift == np.floor(shift)).all())  # the cells are those of the world
        return replace(self, xyz=snap(self.xyz + shift), origin=origin, ordered=ordered)

    def canonical_order(self) -> Integers:
        """Indices that put the points in the one order every method sees: by 1 m cell, row by row, then
        y, x, z, the return number and the place.

        The order depends on the points alone, so no result depends on the order of the file. Neighbours
        in the order are neighbours in the plane, which makes insertion into a TIN and cache use fast.
        """
        return np.arange(len(self)) if self.ordered else canonical_order(self.xyz, self.return_number)

    def in_canonical_order(self) -> PointCloud:
        """The same points in canonical order; the cloud itself when it is known to be."""
        return self if self.ordered else replace(self.take(self.canonical_order()), ordered=True)

    @classmethod
    def from_world(
        cls, xyz: Points, origin: tuple[float, float] | None = None, **arrays: object
    ) -> PointCloud:
        """A cloud from world coordinates in metres (N, 3); the origin defaults to the first point's block
        corner."""
        xyz = as_points(xyz, "xyz")
        local, origin = brought_near(xyz, origin)
        return cls(xyz=local, origin=origin, **arrays)  # type: ignore[arg-type]

    @classmethod
    def from_laspy(cls, las: Any, crs: Any = None) -> PointCloud:
        """A cloud from a laspy.LasData, as `eaves.read` gives it from its file."""
        import eaves  # the readers stand above the values

        return eaves.read(las, crs=crs)


def plain_points(points: Any) -> Points:
    """The local coordinates (N, 3) of a cloud, or points as an array."""
    return points.xyz if isinstance(points, PointCloud) else as_points(points)


def brought_near(
    xyz: Points, origin: tuple[float, float] | None = None
) -> tuple[Points, tuple[float, float]]:
    """World coordinates (N, 3) in local metres about an origin, by default the corner of the first block, and
    that origin."""
    if origin is None:
        finite = xyz[np.isfinite(xyz).all(axis=1)]
        origin = Block.at(*finite[:, :2].min(axis=0)).origin if len(finite) else (0.0, 0.0)
    return snap(xyz - np.array([origin[0], origin[1], 0.0])), origin


def snap(xyz: Points) -> Points:
    """Coordinates rounded to `GRID_STEP`, (N, 3)."""
    return np.round(xyz / GRID_STEP) * GRID_STEP


def canonical_order(xyz: Points, tie_break: NDArray[np.uint8] | None = None) -> Integers:
    """Indices (N,) that sort points (N, 3) by 1 m cell, row by row, and inside a cell by y and x in whole
    `GRID_STEP`, then by z, the tie break (the return number) and the place."""
    if len(xyz) == 0:
        return np.zeros(0, np.int64)
    key, falls = keys_kernel(xyz)
    if len(key):
        # most clouds are in order already, or made of runs that are, which numpy's stable sort merges in a
        # seventh of the time; ties are settled below
        rising = falls == 0
        kind: Literal["stable"] | None = "stable" if LONG_RUN * falls < len(key) else None
        order = np.arange(len(key)) if rising else np.argsort(key, kind=kind)
        ordered = key if rising else key.take(order)
        tied = np.flatnonzero(ordered[1:] == ordered[:-1])
    else:  # columns so far apart that 63 bits do not hold the keys
        finite = np.where(np.isfinite(xyz[:, :2]), xyz[:, :2], 0.0)
        x, y = (np.rint(column * PER_METRE) for column in finite.T)
        order = np.lexsort((x, y, np.floor(x / PER_METRE), np.floor(y / PER_METRE)))
        tied = np.flatnonzero((x[order][1:] == x[order][:-1]) & (y[order][1:] == y[order][:-1]))
    if len(tied):
        rows = np.unique(np.concatenate([tied, tied + 1]))
        group = np.cumsum(np.r_[1, np.diff(rows) > 1]) + np.cumsum(~np.isin(rows, tied + 1))
        members = order[rows]
        last = np.zeros(len(members), np.uint8) if tie_break is None else tie_break[members]
        x, y, z = xyz[members].T  # off the grid x and y may differ still
        order[rows] = members[np.lexsort((members, last, x, y, z, group))]
    return order.astype(np.int64, copy=False)


PER_METRE = round(1.0 / GRID_STEP)
"""Keys count the steps of the grid."""
LARGEST_KEY = 2.0**62
LONG_RUN = 32
"""Points of a run, in the mean, from which on runs are merged."""


@inlined_kernel
def steps_of(value: float, level: float) -> Any:
    """Whole steps of the grid over a level, a float; a value that is not finite counts as 0."""
    return np.rint(((value if np.isfinite(value) else 0.0) - level) * PER_METRE)


@kernel
def keys_kernel(xyz: Points) -> tuple[Integers, int]:
    """Keys (N,) that rise by 1 m cell, row by row, and inside a cell by y and x, and how often they fall from
    point to point; no keys where 63 bits do not hold them.
    """
    count = len(xyz)
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for i in range(count):
        for axis in range(2):
            value = xyz[i, axis] if np.isfinite(xyz[i, axis]) else 0.0
            low[axis], high[axis] = min(low[axis], value), max(high[axis], value)
    west, south = np.floor(low[0]), np.floor(low[1])
    if not (high[0] - west + 2.0) * (high[1] - south + 2.0) * PER_METRE**2 < LARGEST_KEY:
        return np.empty(0, np.int64), 0
    key, falls = np.empty(count, np.int64), 0
    columns = np.floor(steps_of(high[0], west) / PER_METRE) + 1.0
    for i in range(count):
        # whole numbers in floats, which divide several times as fast
        x, y = steps_of(xyz[i, 0], west), steps_of(xyz[i, 1], south)
        column, row = np.floor(x / PER_METRE), np.floor(y / PER_METRE)
        inside = (y - row * PER_METRE) * PER_METRE + x - column * PER_METRE
        key[i] = int(row * columns + column) * PER_METRE**2 + int(inside)
        falls += i > 0 and key[i] < key[i - 1]
    return key, falls
