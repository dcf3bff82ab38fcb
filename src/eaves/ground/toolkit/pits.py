"""Lowest points that pass for ground and are not: half way up a wall, or at the bottom of a hole."""

from __future__ import annotations

import numpy as np
from numba import njit

from eaves.model import Grid, Mask, Raster

HOLE_M, HOLE_CELLS = 1.0, 2
"""A cell this far under all ground within two cells holds an echo gone astray."""
WALL_M, ABOVE_M = 0.7, 3.0
"""A cell this far over ground beside it, and under an object beside it, is part of the object's wall."""
WALL_CELLS = 1.5
"""Ground beside a cell may lie lower by the slope of the terrain over this many cells."""
WALL_ROUNDS = 2
"""A slanting wall may stand in two rows of cells."""


def find_strays(surface: Raster, slope: Grid, objects: Mask, occupied: Mask) -> Mask:
    """The occupied cells (H, W) outside the objects that hold no ground after all.

    An opening cannot take away a hole. And it excuses the points low on the wall of a wide building when the
    terrain is higher on its other side: they lie between both. What gives them away is the object right over
    them. The cells lower or higher than their neighbours by the terrain's slope are left alone.
    """
    z, cell = surface.values, surface.cell
    strays = hole_kernel(z, slope, occupied & ~objects, cell)
    for _ in range(WALL_ROUNDS):
        taken = objects | strays
        walls = wall_kernel(z, slope, occupied & ~taken, occupied & taken, cell)
        if not walls.any():
            break
        strays |= walls
    return np.asarray(strays)


@njit(cache=True)
def hole_kernel(z: Grid, slope: Grid, ground: Mask, cell: float) -> Mask:
    """The ground cells (H, W) far under all others within `HOLE_CELLS`, of which there is at least one."""
    rows, columns = z.shape
    holes = np.zeros((rows, columns), np.bool_)
    for row in range(rows):
        for column in range(columns):
            if not ground[row, column]:
                continue
            most = z[row, column] + HOLE_M + HOLE_CELLS * cell * slope[row, column]
            alone, deep = True, True
            for r in range(max(0, row - HOLE_CELLS), min(rows, row + HOLE_CELLS + 1)):
                for c in range(max(0, column - HOLE_CELLS), min(columns, column + HOLE_CELLS + 1)):
                    if ground[r, c] and (r != row or c != column):
                        alone = False
                        deep = deep and z[r, c] > most
                if not deep:
                    break
            holes[row, column] = deep and not alone
    return holes


@njit(cache=True)
def wall_kernel(z: Grid, slope: Grid, ground: Mask, objects: Mask, cell: float) -> Mask:
    """The ground cells (H, W) over ground on one side and under an object on another."""
    rows, columns = z.shape
    walls = np.zeros((rows, columns), np.bool_)
    for row in range(rows):
        for column in range(columns):
            if not ground[row, column]:
                continue
            least = z[row, column] - WALL_M - WALL_CELLS * cell * slope[row, column]
            over, under = False, False
            for r in range(max(0, row - 1), min(rows, row + 2)):
                for c in range(max(0, column - 1), min(columns, column + 2)):
                    over = over or (ground[r, c] and z[r, c] < least)
                    under = under or (objects[r, c] and z[r, c] > z[row, column] + ABOVE_M)
            walls[row, column] = over and under
    return walls
