"""The results of the passes: the result of a block, the points of a building, the result of a building."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.model.arrays import Integers, Labels, Mask, Points, Values
from eaves.model.block import Block, Bounds
from eaves.model.building import BuildingModel, Failure, Footprint
from eaves.model.doubt import Doubt
from eaves.model.scene import WALL, Raster


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
    """One building before it is modelled: its points (N,) about its owner block's origin, the terrain."""

    owner_block: Block
    xyz: Points
    point_id: Integers
    part: NDArray[np.uint8]
    terrain: Raster
    spacing: float
    score: float
    given: Footprint | None = None
    block: Footprint | None = None
    """The detected block that the building is a unit of; None for one that is a block of its own."""
    wall_certainty: float | None = None
    """Probability of the least sure party wall that was found on it, None where none was."""
    ground_seen: Raster | None = None
    """1 in the cells of the terrain that hold a ground point; None where that is not known."""
    ground_nearest: Points | None = None
    """The ground (K, 3) nearest to a given footprint where none was seen beside it."""
    ground_beside: bool | None = None
    """True if ground was seen beside a given footprint; None where that was not looked at."""
    not_last: NDArray[np.bool_] | None = None
    """Points whose pulses came back once more from below."""
    others: Points | None = None
    """High points (K, 3) in and around the building that are no building's; None of a given footprint."""
    around: Points | None = None
    """All points (K, 3) of the scan in and around the building, the ground's too; None where none asked."""

    def take(self, inside: Mask, **changes: Any) -> BuildingPoints:
        """The building with those of its points that a mask (N,) holds, and other fields changed."""
        columns = ("xyz", "point_id", "part", "not_last")
        names = [name for name in columns if getattr(self, name) is not None]
        return replace(self, **{name: getattr(self, name)[inside] for name in names}, **changes)

    @property
    def roof_not_last(self) -> NDArray[np.bool_] | None:
        """Mask (M,) of the `roof_points` that are not the last return of a pulse; None where not known."""
        return None if self.not_last is None else np.asarray(self.not_last[self.part != WALL])

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
