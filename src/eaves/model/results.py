"""The results of the passes: the result of a block, the points of a building, the result of a building."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.model.block import Block, Bounds
from eaves.model.building import BuildingModel, Failure, Footprint
from eaves.model.checks import Integers, Labels, Mask, Points, Values
from eaves.model.scene import WALL, Doubt, Raster


@dataclass(frozen=True, eq=False)
class BlockResult:
    """The result of the block pass for the points in one block; arrays are (N,) and in canonical order."""

    block: Block
    xyz: Points
    point_id: Integers
    classification: NDArray[np.uint8]
    label: Labels
    part: NDArray[np.uint8]
    vegetation: NDArray[np.uint8]
    """Class 3, 4 or 5 where a point is vegetation, 14 or 15 on a wire or its tower, else 0."""
    height: NDArray[np.float32]
    score: Values
    """Of each label, (K,)."""
    dtm: Raster
    dsm: Raster
    spacing: float
    seam_id: Integers
    seam_label: Labels
    """Labelled points within `SEAM` of the border, on both sides of it."""
    doubts: tuple[Doubt, ...] = ()
    """Places in the block, world metres, that the scan does not decide."""
    seconds: dict[str, float] = field(default_factory=dict)
    keeps_low: bool = False
    """True if buildings need the points below and around them: walls, ground."""

    @property
    def extent(self) -> Bounds:
        """World metres of the block's points; there is at least one."""
        return Bounds.of(self.xyz).translated(*self.block.origin)


@dataclass(frozen=True, eq=False)
class BuildingPoints:
    """One building before it is modelled: its points and what lies around them, about the corner of a block.

    Parameters
    ----------
    owner_block : Block
        The block that owns it.
    xyz : ndarray (N, 3) of float64
        Its points in local metres.
    point_id : ndarray (N,) of int64
        Their ids.
    part : ndarray (N,) of uint8
        What the filters found them to be, as codes of `model.scene`: walls, …
    terrain : Raster
        The heights around it, NaN where they are not known.
    spacing : float
        Mean distance (m) of the points of the scan in plan.
    score : float
        How sure the detector is, 0 to 1.
    given : Footprint or None
        The outline where it is given.
    block : Footprint or None
        The detected block that it is a unit of; None for a block of its own.
    wall_certainty : float or None
        Probability of the least sure party wall that was found on it; None where none was.
    ground_seen : Raster or None
        1 in the cells of the terrain that hold a ground point; None where that is not known.
    ground_nearest : ndarray (K, 3) or None
        The ground nearest to a given footprint where none was seen beside it.
    ground_beside : bool or None
        True if ground was seen beside a given footprint; None where that was not looked at.
    not_last : ndarray (N,) of bool or None
        Points whose pulses came back once more from below.
    intensity : ndarray (N,) of float64 or None
        Their intensities, where every file has them and the method of the units takes them.
    others : ndarray (K, 3) or None
        High points in and around it that are no building's; None of a given footprint.
    around : ndarray (K, 3) or None
        All points of the scan in and around it, the ground's too; None where none asked.

    Examples
    --------
    >>> import numpy as np
    >>> import eaves
    >>> points, terrain = np.zeros((4, 3)), eaves.Raster(np.zeros((2, 2), np.float32), 0.0, 1.0, 0.5)
    >>> part, numbers = np.zeros(4, np.uint8), np.arange(4)
    >>> eaves.BuildingPoints(eaves.Block(0, 0), points, numbers, part, terrain, 0.5, 1.0).roof_points.shape
    (4, 3)
    """

    owner_block: Block
    xyz: Points
    point_id: Integers
    part: NDArray[np.uint8]
    terrain: Raster
    spacing: float
    score: float
    given: Footprint | None = None
    block: Footprint | None = None
    wall_certainty: float | None = None
    ground_seen: Raster | None = None
    ground_nearest: Points | None = None
    ground_beside: bool | None = None
    not_last: NDArray[np.bool_] | None = None
    intensity: Values | None = None
    others: Points | None = None
    around: Points | None = None

    def take(self, inside: Mask, **changes: Any) -> BuildingPoints:
        """The building with those of its points that a mask (N,) holds, and other fields changed."""
        columns = ("xyz", "point_id", "part", "not_last", "intensity")
        names = [name for name in columns if getattr(self, name) is not None]
        return replace(self, **{name: getattr(self, name)[inside] for name in names}, **changes)

    @property
    def roof_not_last(self) -> NDArray[np.bool_] | None:
        """Mask (M,) of the `roof_points` that are not the last return of a pulse; None where not known."""
        return None if self.not_last is None else np.asarray(self.not_last[self.part != WALL])

    @property
    def roof_intensity(self) -> Values | None:
        """Intensities (M,) of the `roof_points`; None where not known."""
        return None if self.intensity is None else np.asarray(self.intensity[self.part != WALL])

    @property
    def roof_points(self) -> Points:
        """The points (M, 3) that are not on walls."""
        return np.asarray(self.xyz[self.part != WALL])


@dataclass(frozen=True, eq=False)
class BuildingResult:
    """A model, or the Failure (with its footprint), and the roof plane of every point (N,), 0 for none."""

    outcome: BuildingModel | Failure
    point_id: Integers
    plane: Labels
    seconds: dict[str, float] = field(default_factory=dict)

    @classmethod
    def without_points(cls, failure: Failure) -> BuildingResult:
        """A given footprint that no point belongs to."""
        return cls(failure, np.zeros(0, np.int64), np.zeros(0, np.int32))
