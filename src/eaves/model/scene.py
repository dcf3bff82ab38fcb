"""What the detectors look at: a classified cloud with its rasters, and what they answer."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from eaves.model.arrays import Grid, Labels, Mask, Points, Values
from eaves.model.block import Bounds
from eaves.model.cloud import PointCloud
from eaves.model.doubt import Doubt

ROOF, WALL, TREE, NOISE = 1, 2, 3, 4
"""Codes of `Regions.part` and of the extra dimension `part` of classified.laz; 0 is none of them."""


@dataclass(frozen=True, eq=False)
class Raster:
    """Values (H, W), float32, row 0 north; `west` and `north` are the outer corner in local metres."""

    values: Grid
    west: float
    north: float
    cell: float

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.values.shape[0], self.values.shape[1]

    @property
    def bounds(self) -> Bounds:
        """Local metres, to the outer edges of the cells."""
        rows, columns = self.shape
        return Bounds(self.west, self.north - rows * self.cell, self.west + columns * self.cell, self.north)

    def with_(self, **changes: object) -> Raster:
        """A copy with some fields replaced."""
        return replace(self, **changes)  # type: ignore[arg-type]

    def cell_of(self, xy: Points) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Row and column of points (N, 2 or 3); outside the raster they are out of range."""
        column = np.floor((xy[:, 0] - self.west) / self.cell).astype(np.int64)
        row = np.floor((self.north - xy[:, 1]) / self.cell).astype(np.int64)
        return row, column

    def at(self, xy: Points) -> Values:
        """Bilinear values (N,) at points (N, 2 or 3); the nearest cell's beyond the rim; NaN at NaN cells."""
        from eaves.model.bilinear import bilinear_kernel  # imports numba, which a raster alone does not need

        values, places = np.ascontiguousarray(self.values), np.ascontiguousarray(xy, np.float64)
        return np.asarray(bilinear_kernel(values, self.west, self.north, self.cell, places))


@dataclass(frozen=True, eq=False)
class Scene:
    """A cloud with classes 2, 7, 18 set, its terrain and its surface; all about the same origin."""

    cloud: PointCloud
    dtm: Raster
    dsm: Raster
    spacing: float
    """Mean spacing of the points in plan (m): 1 / √density, counted where points are."""

    height: Values = field(default_factory=lambda: np.zeros(0))
    """Height of every point above the terrain (N,), m."""


@dataclass(frozen=True, eq=False)
class Regions:
    """Which building each point belongs to.

    `label` (N,) is 0 for no building, else 1…K. `score` (K,) says how sure the detector is, 0 to 1.
    `part` (N,) tells roof, wall, tree and noise apart where the method does (codes above). `doubts` are
    places, in local metres, where the evidence contradicts itself or is missing.
    """

    label: Labels
    score: Values = field(default_factory=lambda: np.zeros(0))
    part: NDArray[np.uint8] | None = None
    doubts: tuple[Doubt, ...] = ()

    def with_doubts(self, doubts: Iterable[Doubt]) -> Regions:
        """The same regions with these doubts."""
        return replace(self, doubts=tuple(doubts))

    @property
    def count(self) -> int:
        """How many regions there are."""
        return int(self.label.max(initial=0))

    def mask_of(self, number: int) -> Mask:
        """The points (N,) of region `number`."""
        return np.asarray(self.label == number)
