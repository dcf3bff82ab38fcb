"""Statistics of the points in half cells, and in the cells of two by two of them in each of four placements.

The points are sorted once: counts and heights of a cell are those of its four half cells, wherever the cells
begin.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.detect.toolkit.cells import Cells, SquareCells
from eaves.model import Integers, Mask, Points, Scene, Values

STEPS = ((0, 0), (0, 1), (1, 0), (1, 1))
"""The placements: half cells south and east by which the cells begin after those at the local origin."""
HALVES = 2
"""Half cells along the side of a cell."""


@dataclass(frozen=True, eq=False)
class CellsOfFour(SquareCells):
    """Square cells of two by two half cells, in one of their placements."""

    half: Cells
    step: tuple[int, int]

    @classmethod
    def of(cls, half: Cells, step: tuple[int, int]) -> CellsOfFour:
        """The cells that begin so many half cells south and east of where half cells do."""
        (down, right), (rows, columns) = step, half.shape
        west, north = half.west + right * half.side, half.north - down * half.side
        shape = (rows - down) // HALVES, (columns - right) // HALVES
        return cls(HALVES * half.side, west, north, shape, half, step)

    def four(self, values: NDArray[Any]) -> list[NDArray[Any]]:
        """The values (h, w) of each cell's four half cells, (H, W) each."""
        down, right = self.step
        rows, columns = (HALVES * count for count in self.shape)
        return [
            values[down + i : down + rows : HALVES, right + j : right + columns : HALVES]
            for i in range(HALVES)
            for j in range(HALVES)
        ]

    def sum(self, values: NDArray[Any]) -> NDArray[Any]:
        """Sum (H, W) of the half cells' values (h, w)."""
        one, two, three, four = self.four(values)
        return np.asarray(one + two + three + four)

    def highest(self, values: NDArray[Any]) -> NDArray[Any]:
        """The highest (H, W) of the half cells' values (h, w)."""
        one, two, three, four = self.four(values)
        return np.asarray(np.maximum(np.maximum(one, two), np.maximum(three, four)))

    @property
    def count(self) -> NDArray[np.int64]:
        """Points in each cell (cells,)."""
        return self.sum(self.half.count.reshape(self.half.shape)).ravel()

    @property
    def of_half(self) -> Integers:
        """The cell (h, w) that each half cell lies in; those in none are empty and count to the margin."""
        row, column = (
            np.clip((np.arange(half) - begin) // HALVES, 0, count - 1)
            for half, begin, count in zip(self.half.shape, self.step, self.shape, strict=True)
        )
        return np.add.outer(row * self.shape[1], column)

    @property
    def off_middle(self) -> tuple[Values, Values]:
        """Offset (m) of half cells from their cell's middle: columns (w,) to the east, rows (h,) to the
        north."""
        south, east = (
            (np.arange(half) - begin) % HALVES - 0.5
            for half, begin in zip(self.half.shape, self.step, strict=True)
        )
        return np.asarray(east * self.half.side, np.float64), np.asarray(-south * self.half.side, np.float64)

    def points_of(self, cells: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The points of cells (K,): for each, its position in `cells`, and its number (M,), (M,)."""
        row, column = np.divmod(cells, self.shape[1])
        first = (HALVES * row + self.step[0]) * self.half.shape[1] + HALVES * column + self.step[1]
        along = np.arange(HALVES)
        four = first[:, None] + (along[:, None] * self.half.shape[1] + along).ravel()
        which, points = self.half.points_of(four.ravel())
        return which // HALVES**2, points


@dataclass(frozen=True, eq=False)
class HalfCells:
    """Statistics of the points of half cells, (h, w) each, and the M candidates among them."""

    cells: Cells
    xyz: Points
    """The points (N, 3), heights counted from a level near them."""
    candidates: Points
    place: Integers
    """The candidates (M, 3) and the half cell (M,) of each."""
    several: Values
    other: Values
    height: Values
    """Number of candidates of pulses with several returns; number of points neither candidates nor noise;
    the sum of the candidates' heights over the terrain."""
    top: Values
    low: Values
    """Height of the highest candidate and of the highest other point; -inf where there is none."""

    @classmethod
    def of(cls, scene: Scene, candidate: Mask, side: float) -> HalfCells:
        """Half cells of cells of that side (m); `candidate` (N,) marks the points that could be roofs."""
        z = scene.cloud.xyz[:, 2]
        xyz = scene.cloud.xyz - [0.0, 0.0, np.floor(z.min(where=candidate, initial=z.max()))]
        cells = Cells.of(xyz, side / HALVES, margin=2 * HALVES, whole=HALVES)
        chosen, other = np.flatnonzero(candidate), ~candidate & ~scene.cloud.noise
        place, returns = cells.cell[chosen], scene.cloud.number_of_returns
        several = place[:0] if returns is None else place[returns[chosen] > 1]

        def total(half: Integers, weights: Values | None = None) -> NDArray[Any]:
            return np.bincount(half, weights, cells.size).reshape(cells.shape)

        def highest(mask: Mask) -> Values:
            return cells.extreme(np.where(mask, xyz[:, 2], -np.inf)).reshape(cells.shape)

        return cls(
            cells=cells,
            xyz=xyz,
            candidates=xyz[chosen],
            place=place,
            several=total(several),
            other=total(cells.cell[other]),
            height=total(place, scene.height[chosen]),
            top=highest(candidate),
            low=highest(other),
        )
