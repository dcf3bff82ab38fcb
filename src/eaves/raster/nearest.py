"""Nearest of some cells to each of many others, and those of these that are near one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import kernel
from eaves.model import Integers, Mask, Points

FARTHEST_CELLS = 1 << 24
"""More cells than a raster has along a side."""

ADJOINING = 2
"""Square of the distance of two cells that touch at a corner."""


def nearest_cells(occupied: Mask, rows: Integers, columns: Integers) -> tuple[Integers, Integers]:
    """Row and column (K,) of the cell of `occupied` (H, W) nearest to each of the cells (K,) given by row and
    column, whose rows do not fall; at least one is known.

    Of cells equally near it is the one in the westernmost column, of two in a column the northern one.
    """
    row, column = nearest_kernel(occupied, away_kernel(occupied), rows, columns)
    return row, column


def near_cells(occupied: Mask, square: int) -> Mask:
    """The cells (H, W) with one of `occupied` (H, W) no farther than the root of `square`, in cells."""
    steps = np.arange(int(np.sqrt(square)) + 1)
    return np.asarray(near_kernel(away_kernel(occupied), np.sqrt(square - steps**2).astype(np.int32)))


def places(rows: Integers, columns: Integers) -> Points:
    """Cells (K,) as points (K, 2) of a plane, x to the east and y to the north."""
    return np.asarray(np.c_[columns, -rows], np.float64)


@kernel
def away_kernel(occupied: Mask) -> NDArray[np.int32]:
    """Rows (H, W) between each cell and the nearest known one in its column, up or down."""
    rows, columns = occupied.shape
    away = np.full((rows, columns), FARTHEST_CELLS, np.int32)
    for row in range(rows):
        for column in range(columns):
            if occupied[row, column]:
                away[row, column] = 0
            elif row > 0:
                away[row, column] = away[row - 1, column] + 1
    for row in range(rows - 2, -1, -1):
        for column in range(columns):
            away[row, column] = min(away[row, column], away[row + 1, column] + 1)
    return away


@kernel
def nearest_kernel(
    occupied: Mask, away: NDArray[np.int32], rows: Integers, columns: Integers
) -> tuple[Integers, Integers]:
    """Row and column (K,) of the known cell nearest to each of some cells (K,), whose rows do not fall.

    `away` is that of `away_kernel`. The squares of the distances to the nearest known cell of each column are
    parabolas along a row; `envelope` holds those of their lower envelope, from west to east, and `first` the
    column from which each is the least (Felzenszwalb and Huttenlocher 2012).
    """
    width = occupied.shape[1]
    nearest_row, nearest_column = np.empty(len(rows), np.int64), np.empty(len(rows), np.int64)
    envelope, first, last_row, count = np.empty(width, np.int64), np.empty(width, np.int64), -1, 0
    for i in range(len(rows)):
        row = rows[i]
        if row != last_row:
            last_row, count = row, 0
            for column in range(width):
                if away[row, column] >= FARTHEST_CELLS:
                    continue
                height = np.int64(away[row, column]) ** 2 + column * column
                start = np.int64(0)
                while count > 0:
                    before = envelope[count - 1]
                    rise = height - (np.int64(away[row, before]) ** 2 + before * before)
                    start = rise // (2 * (column - before)) + 1
                    if start > first[count - 1]:
                        break
                    count -= 1
                if count == 0:
                    start = np.int64(0)
                if start < width:
                    envelope[count], first[count] = column, start
                    count += 1
        low, high = 0, count - 1
        while low < high:
            middle = (low + high + 1) // 2
            if first[middle] <= columns[i]:
                low = middle
            else:
                high = middle - 1
        column = envelope[low]
        above = row - away[row, column]
        nearest_row[i] = above if above >= 0 and occupied[above, column] else row + away[row, column]
        nearest_column[i] = column
    return nearest_row, nearest_column


@kernel
def near_kernel(away: NDArray[np.int32], most: NDArray[np.int32]) -> Mask:
    """Cells (H, W) that are `away` from a known one, in a column so many steps aside, by at most `most`."""
    rows, columns = away.shape
    mask = np.zeros((rows, columns), np.bool_)
    for row in range(rows):
        here, line = away[row], mask[row]
        for step in range(min(len(most), columns)):
            limit, span = most[step], columns - step
            aside, line_aside = here[step:], line[step:]
            for column in range(span):
                line[column] |= aside[column] <= limit
            for column in range(span):
                line_aside[column] |= here[column] <= limit
    return mask
