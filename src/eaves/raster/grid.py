"""Grids: which cell a point falls in, and which point stands for a cell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from rasterio import Affine, features
from shapely import Polygon

from eaves.kernels import kernel
from eaves.model import Bounds, Doubt, Grid, Integers, Mask, Points, Raster, Values

TRUE_POSITIVE, FALSE_NEGATIVE, FALSE_POSITIVE, UNKNOWN = 1, 2, 3, 255


def agreement_codes(result: Mask, reference: Mask) -> NDArray[np.uint8]:
    """The code of each cell of a result and a reference (H, W); 0 where neither has anything."""
    codes = [TRUE_POSITIVE, FALSE_NEGATIVE, FALSE_POSITIVE]
    return np.select([result & reference, reference, result], codes).astype(np.uint8)


EMPTY = -1
"""In a grid of point numbers: a cell without points."""


def grid_shape(bounds: Bounds, cell: float) -> tuple[int, int]:
    """Rows and columns of the cells (m) that cover the bounds."""
    return max(1, round(bounds.height / cell)), max(1, round(bounds.width / cell))


def empty_raster(bounds: Bounds, cell: float, value: float = np.nan) -> Raster:
    """A raster over the bounds with one value everywhere."""
    return Raster(np.full(grid_shape(bounds, cell), value, np.float32), bounds.west, bounds.north, cell)


def whole_cells(bounds: Bounds, cell: float) -> Bounds:
    """The bounds widened to multiples of the cell (m), so that every point on their rim has a cell.

    A cell holds its west and its north side, as `Raster.cell_of` counts.
    """
    west = min(np.floor(bounds.west / cell) * cell, bounds.west)  # a product may lie beside its quotient
    north = max(np.ceil(bounds.north / cell) * cell, bounds.north)
    columns, rows = np.floor((bounds.east - west) / cell) + 1, np.floor((north - bounds.south) / cell) + 1
    return Bounds(float(west), float(north - rows * cell), float(west + columns * cell), float(north))


def cell_centres(raster: Raster) -> Points:
    """Centres (H * W, 2) of the cells, row by row."""
    rows, columns = raster.shape
    x = raster.west + (np.arange(columns) + 0.5) * raster.cell
    y = raster.north - (np.arange(rows) + 0.5) * raster.cell
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def lowest_points(xyz: Points, bounds: Bounds, cell: float) -> Integers:
    """Number of the lowest point in each cell, (H, W), `EMPTY` where there is none; ties go to the first."""
    rows, columns = grid_shape(bounds, cell)
    return np.asarray(extreme_kernel(xyz, bounds.west, bounds.north, cell, rows, columns, -1.0))


def highest_points(xyz: Points, bounds: Bounds, cell: float) -> Integers:
    """Number of the highest point in each cell, (H, W), `EMPTY` where there is none; ties go to the first."""
    rows, columns = grid_shape(bounds, cell)
    return np.asarray(extreme_kernel(xyz, bounds.west, bounds.north, cell, rows, columns, 1.0))


def mean_heights(xyz: Points, bounds: Bounds, cell: float) -> tuple[Grid, Grid]:
    """Mean height and number of points of each cell, both (H, W); NaN where there is none."""
    rows, columns = grid_shape(bounds, cell)
    mean, count = mean_kernel(xyz, bounds.west, bounds.north, cell, rows, columns)
    return mean, count


def heights_of(numbers: Integers, z: Values) -> Grid:
    """Heights (H, W) of the points with these numbers, NaN where there is none."""
    if len(z) == 0:
        return np.full(numbers.shape, np.nan, np.float32)
    return np.where(numbers >= 0, z[np.maximum(numbers, 0)], np.nan).astype(np.float32)


@dataclass(frozen=True, eq=False)
class WorldGrids:
    """Grids (H, W) of cells of a side `cell` (m) that are fixed to the world.

    `west` is the number of the first column and `north` that of the first row, in cells counted east and
    north from the origin of the world; row 0 is the northernmost.
    """

    west: int
    north: int
    cell: float
    doubts: tuple[Doubt, ...] = field(default=(), kw_only=True)

    def cropped(self, bounds: Bounds) -> Self:
        """The cells within `bounds` (world metres, whole cells)."""
        first, last = round(bounds.west / self.cell), round(bounds.east / self.cell)
        bottom, top = round(bounds.south / self.cell), round(bounds.north / self.cell) - 1
        rows = slice(max(0, self.north - top), max(0, self.north - bottom + 1))
        columns = slice(max(0, first - self.west), max(0, last - self.west))
        inside = tuple(
            doubt
            for doubt in self.doubts
            if bounds.west <= doubt.x < bounds.east and bounds.south <= doubt.y < bounds.north
        )
        changes: dict[str, Any] = {"west": max(self.west, first), "north": min(self.north, top)}
        for name, grid in vars(self).items():
            if isinstance(grid, np.ndarray):
                changes[name] = grid[rows, columns].copy()
        return replace(self, doubts=inside, **changes)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        grid = next(grid for grid in vars(self).values() if isinstance(grid, np.ndarray))
        return grid.shape[0], grid.shape[1]

    @property
    def bounds(self) -> Bounds:
        """World metres of the cells."""
        rows, columns = self.shape
        south, west = self.north + 1 - rows, self.west
        return Bounds(
            west * self.cell, south * self.cell, (west + columns) * self.cell, (self.north + 1) * self.cell
        )

    def centres(self, cells: Mask) -> tuple[Values, Values]:
        """World coordinates (K,) and (K,), in metres, of the middles of the cells of a mask (H, W)."""
        rows, columns = np.nonzero(cells)
        x, y = (self.west + columns + 0.5) * self.cell, (self.north - rows + 0.5) * self.cell
        return np.asarray(x, np.float64), np.asarray(y, np.float64)


@kernel
def extreme_kernel(
    xyz: Points, west: float, north: float, cell: float, rows: int, columns: int, sign: float
) -> Integers:
    """Number of the point with the largest sign * z in each cell, (rows, columns)."""
    best = np.full((rows, columns), EMPTY, np.int32)
    for i in range(len(xyz)):
        row = int(np.floor((north - xyz[i, 1]) / cell))
        column = int(np.floor((xyz[i, 0] - west) / cell))
        if row < 0 or row >= rows or column < 0 or column >= columns:
            continue
        # a choice of numbers of 32 bits, where a processor that guessed a branch would be wrong half the time
        rival = best[row, column]
        better = (rival < 0) | (sign * xyz[i, 2] > sign * xyz[max(rival, 0), 2])
        best[row, column] = i if better else rival
    return best.astype(np.int64)


@kernel
def mean_kernel(
    xyz: Points, west: float, north: float, cell: float, rows: int, columns: int
) -> tuple[Grid, Grid]:
    """Mean height and count of the points in each cell, (rows, columns)."""
    total = np.zeros((rows, columns))
    count = np.zeros((rows, columns), np.float32)
    for i in range(len(xyz)):
        row = int(np.floor((north - xyz[i, 1]) / cell))
        column = int(np.floor((xyz[i, 0] - west) / cell))
        if row < 0 or row >= rows or column < 0 or column >= columns:
            continue
        total[row, column] += xyz[i, 2]
        count[row, column] += 1
    mean = np.full((rows, columns), np.nan, np.float32)
    for row in range(rows):
        for column in range(columns):
            if count[row, column] > 0:
                mean[row, column] = total[row, column] / count[row, column]
    return mean, count


def lowest_in_squares(values: Grid, radius: int) -> Grid:
    """The lowest value within `radius` rows and columns of each cell (H, W); `values` holds no NaN."""
    return np.asarray(extreme_in_squares_kernel(values, radius, np.float32(1.0)))


def highest_in_squares(values: Grid, radius: int) -> Grid:
    """The highest value within `radius` rows and columns of each cell (H, W); `values` holds no NaN."""
    return np.asarray(extreme_in_squares_kernel(values, radius, np.float32(-1.0)))


@kernel
def least_of(first: Grid, second: Grid, third: Grid, fourth: Grid, least: Grid) -> None:
    """Write the least of four values, one from each array (K,), into a fifth."""
    for i in range(len(least)):
        a = first[i] if first[i] < second[i] else second[i]
        b = third[i] if third[i] < fourth[i] else fourth[i]
        least[i] = a if a < b else b


@kernel
def extreme_in_squares_kernel(values: Grid, radius: int, sign: float) -> Grid:
    """The value within `radius` rows and columns of each cell (H, W) that is least times a `sign`: the lowest
    by 1, the highest by -1.

    Along rows, then along columns, the minima of runs of 4, 16 … cells are made from those of a quarter; four
    runs that overlap cover the window. The inner loops go along rows, which a processor does many cells at a
    time.
    """
    (rows, columns), width, reach = values.shape, 2 * radius + 1, 1
    while 4 * reach <= width:
        reach *= 4
    second, third, last = min(reach, width - reach), min(2 * reach, width - reach), width - reach
    line, longer = np.empty(columns + 2 * radius, np.float32), np.empty(columns + 2 * radius, np.float32)
    runs = np.full((rows + 2 * radius, columns), np.inf, np.float32)
    for row in range(rows):
        line[:], inside, here, run = np.inf, line[radius:], values[row], 1
        for column in range(columns):
            inside[column] = sign * here[column]
        while run < reach:
            ahead = line[3 * run :]
            least_of(line, line[run:], line[2 * run :], ahead, longer[: len(ahead)])
            line, longer, run = longer, line, 4 * run
        least_of(line, line[second:], line[third:], line[last:], runs[row + radius])
    taller, run = np.empty_like(runs), 1
    while run < reach:
        for row in range(len(runs) - 3 * run):
            least_of(runs[row], runs[row + run], runs[row + 2 * run], runs[row + 3 * run], taller[row])
        runs, taller, run = taller, runs, 4 * run
    extreme = np.empty((rows, columns), np.float32)
    for row in range(rows):
        out = extreme[row]
        least_of(runs[row], runs[row + second], runs[row + third], runs[row + last], out)
        for column in range(columns):
            out[column] *= sign
    return extreme


def rasterize(polygons: Sequence[Polygon], bounds: Bounds, cell: float) -> Raster:
    """1 in every cell whose centre lies in a polygon, else 0; `bounds` run along cell borders."""
    shape = (round(bounds.height / cell), round(bounds.width / cell))
    values = np.zeros(shape, np.float32)
    if polygons:
        features.rasterize(
            ((polygon, 1) for polygon in polygons),
            out=values,
            transform=Affine(cell, 0.0, bounds.west, 0.0, -cell, bounds.north),
        )
    return Raster(values, bounds.west, bounds.north, cell)
