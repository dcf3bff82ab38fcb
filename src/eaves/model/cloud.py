"""The point cloud: coordinates in metres about a local origin, and what the scanner told of each point."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from eaves.model.arrays import Mask, Points, Values
from eaves.model.block import Block, Bounds
from eaves.model.coordinates import LOCAL_METRES, CoordinateSystem

Scalar = TypeVar("Scalar", bound=np.generic)

UNCLASSIFIED, GROUND, LOW_VEGETATION, MEDIUM_VEGETATION, HIGH_VEGETATION, BUILDING = 1, 2, 3, 4, 5, 6
LOW_NOISE, WATER, HIGH_NOISE = 7, 9, 18
NOISE_CLASSES = (LOW_NOISE, HIGH_NOISE)
"""Class codes of LAS 1.4, table 17."""

GRID_STEP = 1e-4
"""Local coordinates are whole multiples of this (m), so data moved by whole blocks compute identically."""


@dataclass(frozen=True, eq=False)
class PointCloud:
    """N points. Every array is (N,) and in the same order; none is ever written to.

    `origin` is the world position (m) of local (0, 0); heights keep their world value.
    """

    xyz: Points
    origin: tuple[float, float] = (0.0, 0.0)
    return_number: NDArray[np.uint8] | None = None
    number_of_returns: NDArray[np.uint8] | None = None
    classification: NDArray[np.uint8] | None = None
    """LAS classes: the file's until `classify_ground`, ours (1, 2, 6, 7, 18) after it."""
    point_id: NDArray[np.int64] | None = None
    """Position of each point in the input, counted through all files in order."""
    system: CoordinateSystem = field(default=LOCAL_METRES)
    ordered: bool = False
    """Whether the points are known to be in canonical order."""

    def __len__(self) -> int:
        return len(self.xyz)

    @property
    def bounds(self) -> Bounds:
        """Local metres; N > 0."""
        return Bounds.of(self.xyz)

    @property
    def ground(self) -> Mask:
        """Which points are ground (class 2)."""
        if self.classification is None:
            raise ValueError("the cloud has no classes; call classify_ground(cloud) first")
        return np.asarray(self.classification == GROUND)

    @property
    def noise(self) -> Mask:
        """Which points are noise (classes 7 and 18); none where there are no classes."""
        if self.classification is None:
            return np.zeros(len(self), bool)
        low, high = NOISE_CLASSES
        return np.asarray((self.classification == low) | (self.classification == high))

    @property
    def has_returns(self) -> bool:
        """Whether the scanner told several returns of a pulse apart."""
        return self.number_of_returns is not None and bool(np.any(self.number_of_returns > 1))

    def with_(self, **changes: object) -> PointCloud:
        """A copy with some arrays replaced."""
        if not changes.keys().isdisjoint(("xyz", "return_number")):
            changes.setdefault("ordered", False)
        return replace(self, **changes)  # type: ignore[arg-type]

    def take(self, which: Mask | NDArray[np.int64]) -> PointCloud:
        """The points picked by a mask (N,) or by indices, in that order; the cloud itself when it is all."""
        # to take by indices, and along the first axis, is several times as fast as to index
        index = np.flatnonzero(which) if which.dtype == np.bool_ else which
        if len(index) == len(self) and bool((index == np.arange(len(self))).all()):
            return self

        def pick(array: NDArray[Scalar] | None) -> NDArray[Scalar] | None:
            return None if array is None else array.take(index)

        return replace(
            self,
            xyz=self.xyz.take(index, axis=0),
            return_number=pick(self.return_number),
            number_of_returns=pick(self.number_of_returns),
            classification=pick(self.classification),
            point_id=pick(self.point_id),
            ordered=self.ordered and bool((index[1:] > index[:-1]).all()),
        )

    def about(self, origin: tuple[float, float]) -> PointCloud:
        """The same points with local coordinates counted from another origin (world metres)."""
        if origin == self.origin:
            return self
        shift = np.array([self.origin[0] - origin[0], self.origin[1] - origin[1], 0.0])
        return replace(self, xyz=snap(self.xyz + shift), origin=origin, ordered=False)

    def canonical_order(self) -> NDArray[np.int64]:
        """Indices that put the points in the one order every method sees: by 1 m cell, row by row, then
        y, x, z.

        The order depends on the points alone, so no answer depends on the order of the file; neighbours
        in the order are neighbours in the plane, which is what insertion into a TIN and caches want.
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
        xyz = np.asarray(xyz, np.float64).reshape(-1, 3)
        if origin is None:
            finite = xyz[np.isfinite(xyz).all(axis=1)]
            origin = Block.at(finite[:, 0].min(), finite[:, 1].min()).origin if len(finite) else (0.0, 0.0)
        local = snap(xyz - np.array([origin[0], origin[1], 0.0]))
        return cls(xyz=local, origin=origin, **arrays)  # type: ignore[arg-type]


def snap(xyz: Points) -> Points:
    """Coordinates rounded to the quantum, (N, 3)."""
    return np.round(xyz / GRID_STEP) * GRID_STEP


def millimetres(values: Values) -> NDArray[np.int64]:
    """Values (N,) as whole millimetres above the metre under the lowest; those not finite count as 0."""
    finite = np.isfinite(values)
    known = values if finite.all() else np.where(finite, values, 0.0)
    shifted = known - np.floor(known.min())
    shifted *= 1000.0
    whole: NDArray[np.int64] = np.rint(shifted, out=shifted).astype(np.int64)
    return whole


def canonical_order(xyz: Points, tie_break: NDArray[np.uint8] | None = None) -> NDArray[np.int64]:
    """Indices (N,) that sort points (N, 3) by 1 m cell, row by row, and inside a cell by y, x, z (1 mm)."""
    if len(xyz) == 0:
        return np.zeros(0, np.int64)
    from eaves.model.order import keys_kernel  # imports numba, which a cloud alone does not need

    key, fits, rising = keys_kernel(xyz)
    if fits:
        # the verbs find most clouds in order; an unstable sort is faster, and ties are settled below
        order = np.arange(len(key)) if rising else np.argsort(key)
        ordered = key if rising else key.take(order)
        tied = np.flatnonzero(ordered[1:] == ordered[:-1])
    else:
        # column by column: numpy reduces a long array of three columns ten times slower
        whole = [millimetres(column) for column in xyz.T]
        cell, inside = [w // 1000 for w in whole[:2]], [w % 1000 for w in whole[:2]]
        order = np.lexsort((whole[2], inside[0], inside[1], cell[0], cell[1]))
        same = [w[order][1:] == w[order][:-1] for w in whole]
        tied = np.flatnonzero(same[0] & same[1] & same[2])
    if len(tied):  # equal to the millimetre: settle by the exact coordinates, the return number, the place
        some = np.unique(np.concatenate([tied, tied + 1]))
        group = np.cumsum(np.r_[1, np.diff(some) > 1]) + np.cumsum(~np.isin(some, tied + 1))
        members = order[some]
        last = np.zeros(len(members), np.uint8) if tie_break is None else tie_break[members]
        exact = xyz[members]
        order[some] = members[np.lexsort((members, last, exact[:, 2], exact[:, 0], exact[:, 1], group))]
    return order.astype(np.int64, copy=False)
