"""Pits of a surface of lowest heights: cells that lie under what is around them."""

from __future__ import annotations

import numpy as np

from eaves.kernels import kernel
from eaves.model import Grid, Integers, Values

RING, RING_SHARE = (3, 4), 6
"""A cell is compared with those 3 and 4 cells away, for a cluster of echoes meets three in a row. The
surface is as low as a sixth of them: roofs and crowns may fill the rest, other echoes not so much."""


def ring_of(least: int, most: int) -> Integers:
    """Rows and columns (K, 2) of the cells that lie `least` to `most` cells away."""
    row, column = np.indices((2 * most + 1, 2 * most + 1)).reshape(2, -1) - most
    away = np.hypot(row, column)
    return np.column_stack([row, column])[(away >= least) & (away < most + 0.5)]


@kernel
def level_around(lowest: Values, cell: int, steps: Integers, depth: float, around: Values) -> float:
    """The level that the surface around a cell (of those in a row) has there; -inf where that is no more than
    `depth` (m) over its lowest point, or unknown.

    A slope goes on: a cell of the ring, `steps` (K,) of cells away, counts as high as the surface is halfway
    to the cell across, but no higher than where what falls from it to the cell twice as far leads back to. A
    plane is met as it is. `around` (K,) is written to.
    """
    count, as_low, least = 0, 0, lowest[cell] + depth
    for k in range(len(steps)):
        z = lowest[cell + steps[k]]
        if z == np.inf:
            continue
        beyond, across = lowest[cell + 2 * steps[k]], lowest[cell - steps[k]]
        z += max(0.0, min(z - beyond, 0.5 * (across - z)))
        around[count] = z
        count += 1
        as_low += z <= least
        if as_low > len(steps) // RING_SHARE:
            return -np.inf
    if count == 0:
        return -np.inf
    level = float(np.sort(around[:count])[count // RING_SHARE])
    return level if level > least else -np.inf


@kernel
def empty_around(rows: int, columns: int, away: int) -> Values:
    """Heights of cells (rows + 2 away, columns + 2 away), inf everywhere: cells, and none as far around."""
    return np.full((rows + 2 * away, columns + 2 * away), np.inf)


def without_pits(heights: Grid, depth: float) -> Grid:
    """A surface (H, W), NaN where there is none, raised to what is around where it lies deeper than `depth`
    (m) in a pit narrower than the ring: no more than what is wide needs to know."""
    return np.asarray(fill_kernel(np.nan_to_num(heights, nan=np.inf), ring_of(*RING), depth), np.float32)


@kernel
def fill_kernel(lowest: Grid, ring: Integers, depth: float) -> Values:
    """The surface (rows, columns), inf where there is none, without pits, and NaN for inf. A round judges the
    cells near those that changed, all on the same surface.
    """
    (rows, columns), away, look = lowest.shape, 2 * ring.max(), np.ones(lowest.shape, np.bool_)
    wide = empty_around(rows, columns, away)
    filled, flat = wide[away : away + rows, away : away + columns], wide.ravel()
    filled[:] = lowest
    steps, around = ring[:, 0] * wide.shape[1] + ring[:, 1], np.empty(len(ring))
    pit, level, count = np.empty((rows * columns, 2), np.int32), np.empty(rows * columns), 1
    while count > 0:
        count = 0
        for row in range(rows):
            for column in range(columns):
                if not look[row, column] or filled[row, column] == np.inf:
                    continue
                look[row, column] = False
                cell = (row + away) * wide.shape[1] + column + away
                level[count] = level_around(flat, cell, steps, depth, around)
                if level[count] > -np.inf:
                    pit[count] = row, column
                    count += 1
        for k in range(count):
            row, column = pit[k]
            filled[row, column] = level[k]
            top, left = max(0, row - away), max(0, column - away)
            look[top : row + away + 1, left : column + away + 1] = True
    return np.where(filled == np.inf, np.nan, filled)
