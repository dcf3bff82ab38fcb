"""Which of some cells is nearest to each of many others, and which of these are near one."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from eaves.model import Mask, Points

Index = NDArray[np.int64]
FARTHEST_CELLS = 1 << 24
"""More cells than a raster has along a side."""

ADJOINING = 2
"""Square of the distance of two cells that touch at a corner."""


def nearest_cells(known: Mask, rows: Index, columns: Index) -> tuple[Index, Index]:
    """Row and column (K,) of the cell of `known` (H, W) nearest to each of the cells (K,) given by row and
    column; at least one is known.

    Of cells equally near it is the one that a k-d tree of the known cells, row by row, comes to first.
    """
    away = away_kernel(known)
    row, column, tied = nearest_kernel(known, away, rows, columns)
    if tied.any():
        known_rows, known_columns = np.nonzero(known)
        which = cKDTree(places(known_rows, known_columns)).query(places(rows[tied], columns[tied]))[1]
        row[tied], column[tied] = known_rows[which], known_columns[which]
    return row, column


def near_cells(known: Mask, square: int) -> Mask:
    """The cells (H, W) with one of `known` (H, W) no farther than the root of `square`, in cells."""
    steps = np.arange(int(np.sqrt(square)) + 1)
    return np.asarray(near_kernel(away_kernel(known), np.sqrt(square - steps**2).astype(np.int32)))


def places(rows: Index, columns: Index) -> Points:
    """Cells (K,) as points (K, 2) of a plane, x to the east and y to the north."""
    return np.asarray(np.c_[columns, -rows], np.float64)


@njit(cache=True)
def away_kernel(known: Mask) -> NDArray[np.int32]:
    """Rows (H, W) between each cell and the nearest known one in its column, up or down."""
    rows, columns = known.shape
    away = np.full((rows, columns), FARTHEST_CELLS, np.int32)
    for row in range(rows):
        for column in range(columns):
            if known[row, column]:
                away[row, column] = 0
            elif row > 0:
                away[row, column] = away[row - 1, column] + 1
    for row in range(rows - 2, -1, -1):
        for column in range(columns):
            away[row, column] = min(away[row, column], away[row + 1, column] + 1)
    return away


@njit(cache=True)
def nearest_kernel(
    known: Mask, away: NDArray[np.int32], rows: Index, columns: Index
) -> tuple[Index, Index, Mask]:
    """Row and column (K,) of a known cell nearest to each of some cells (K,), and whether others are as near.

    `away` is that of `away_kernel`. Columns are looked at from the middle out, till they are too far.
    """
    nearest_row, nearest_column = np.empty(len(rows), np.int64), np.empty(len(rows), np.int64)
    tied = np.zeros(len(rows), np.bool_)
    for i in range(len(rows)):
        row, middle = rows[i], columns[i]
        best, where, several, step = np.int64(away[row, middle]) ** 2, middle, False, 1
        while step * step <= best and (step <= middle or middle + step < known.shape[1]):
            for column in (middle - step, middle + step):
                if column < 0 or column >= known.shape[1]:
                    continue
                square = step * step + np.int64(away[row, column]) ** 2
                if square < best:
                    best, where, several = square, column, False
                elif square == best:
                    several = True
            step += 1
        up, below = row - away[row, where], row + away[row, where]
        above = up >= 0 and known[up, where]
        under = below != up and below < known.shape[0] and known[below, where]
        nearest_row[i], nearest_column[i] = up if above else below, where
        tied[i] = several or (above and under)
    return nearest_row, nearest_column, tied


@njit(cache=True)
def near_kernel(away: NDArray[np.int32], most: NDArray[np.int32]) -> Mask:
    """Cells (H, W) that are `away` from a known one, in a column so many steps aside, by at most `most`."""
    rows, columns = away.shape
    near = np.zeros((rows, columns), np.bool_)
    for row in range(rows):
        here, found = away[row], near[row]
        for step in range(min(len(most), columns)):
            limit, rest = most[step], columns - step
            aside, left = here[step:], found[step:]
            for column in range(rest):
                found[column] |= aside[column] <= limit
            for column in range(rest):
                left[column] |= here[column] <= limit
    return near
