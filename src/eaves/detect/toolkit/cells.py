"""Points sorted into square cells: the grid on which detectors count, fit and grow."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import kernel
from eaves.model import Points, Raster, Values

WIDEST_CM = 3000
"""Sides are whole centimetres that divide this, and so a block of 240 m: neighbouring blocks share cells."""


@dataclass(frozen=True, eq=False)
class Cells:
    """Square cells fixed to the local origin, and the cell of each of N points.

    Cells are numbered row by row, row 0 north. `cell` (N,) is each point's number; the points of cell `c` are
    `order[start[c] : start[c + 1]]`.
    """

    side: float
    west: float
    north: float
    shape: tuple[int, int]
    cell: NDArray[np.int64]
    start: NDArray[np.int64]

    @classmethod
    def of(cls, xyz: Points, side: float, margin: int = 1) -> Cells:
        """Cells of the given side (m) that hold N > 0 points (N, 2 or 3), with `margin` empty ones around."""
        first, last, shape, cell, start = cells_kernel(xyz, side, margin)
        return cls(side, first * side, (last + 1) * side, shape, cell, start)

    @cached_property
    def order(self) -> NDArray[np.int64]:
        """The numbers (N,) of the points, cell by cell, ascending in each."""
        return np.asarray(order_kernel(self.cell, self.start))

    def raster(self, values: NDArray[Any]) -> Raster:
        """Values of all cells, flat or (H, W), as a raster."""
        return Raster(values.reshape(self.shape), self.west, self.north, self.side)

    @property
    def size(self) -> int:
        """Number of cells."""
        return self.shape[0] * self.shape[1]

    @property
    def count(self) -> NDArray[np.int64]:
        """Points in each cell (cells,)."""
        return np.diff(self.start)

    @property
    def neighbours(self) -> NDArray[np.int64]:
        """The steps from a cell's number to its eight neighbours (8,); the margin keeps them in."""
        columns = self.shape[1]
        return np.array([-columns - 1, -columns, -columns + 1, -1, 1, columns - 1, columns, columns + 1])

    def centres(self, cells: NDArray[np.int64]) -> Points:
        """Plan position (K, 2) of the middle of cells (K,)."""
        row, column = np.divmod(cells, self.shape[1])
        x, y = self.west + (column + 0.5) * self.side, self.north - (row + 0.5) * self.side
        return np.asarray(np.c_[x, y], np.float64)

    def total(self, values: Values) -> Values:
        """Sum of the points' values (N,) in each cell (cells,)."""
        return np.asarray(np.bincount(self.cell, weights=values, minlength=self.size), np.float64)

    def extreme(self, values: Values, highest: bool = True) -> Values:
        """Highest or lowest of the points' values (N,) in each cell (cells,); -inf or inf where none is."""
        ufunc = np.maximum if highest else np.minimum
        result = np.full(self.size, -np.inf if highest else np.inf)
        occupied = np.flatnonzero(self.count)
        if len(occupied):
            result[occupied] = ufunc.reduceat(values[self.order], self.start[occupied])
        return result

    def points_of(self, cells: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The points of cells (K,): for each, its position in `cells`, and its number (M,), (M,)."""
        count = self.start[cells + 1] - self.start[cells]
        which = np.repeat(np.arange(len(cells)), count)
        step = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
        return which, self.order[self.start[cells][which] + step]


def side_near(wanted: float) -> float:
    """The smallest whole number of centimetres (in m) that divides `WIDEST_CM` and is not under `wanted` (m),
    or the largest there is. From half a metre on: 0.5, 0.6, 0.75, 1, 1.2, 1.25, 1.5, 2, 2.5, 3, 3.75, 5 …
    """
    least = max(1, int(np.ceil(100.0 * wanted - 1e-6)))
    return next((side for side in range(least, WIDEST_CM) if WIDEST_CM % side == 0), WIDEST_CM) / 100.0


@kernel
def cells_kernel(
    xyz: Points, side: float, margin: int
) -> tuple[int, int, tuple[int, int], NDArray[np.int64], NDArray[np.int64]]:
    """The first column and the northernmost row, counted from the origin, and the rows and columns of the
    cells that hold N > 0 points with a margin; cell (N,) of each point, and where the points of each begin
    (cells + 1,) when they are put in order."""
    cell, line = np.empty(len(xyz), np.int64), np.empty(len(xyz), np.int64)
    for i in range(len(xyz)):
        cell[i], line[i] = int(np.floor(xyz[i, 0] / side)), int(np.floor(xyz[i, 1] / side))
    first, last = cell.min() - margin, line.max() + margin
    rows, columns = last - line.min() + 1 + margin, cell.max() - first + 1 + margin
    start = np.zeros(rows * columns + 1, np.int64)
    for i in range(len(xyz)):
        cell[i] += (last - line[i]) * columns - first
        start[cell[i] + 1] += 1
    for k in range(rows * columns):
        start[k + 1] += start[k]
    return first, last, (rows, columns), cell, start


@kernel
def order_kernel(cell: NDArray[np.int64], start: NDArray[np.int64]) -> NDArray[np.int64]:
    """See `Cells.order`."""
    order, following = np.empty(len(cell), np.int64), start[:-1].copy()
    for i in range(len(cell)):
        order[following[cell[i]]] = i
        following[cell[i]] += 1
    return order
