"""Lowest points that pass for ground and are not: half way up a wall, or at the bottom of a hole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eaves.kernels import kernel
from eaves.model import Grid, Mask, Raster


@dataclass(frozen=True)
class StrayRules:
    """When a lowest point is no ground; each is the method's parameter of that name."""

    hole_depth: float
    """A cell this far (m) under all ground within `hole_cells` holds an echo gone astray."""
    hole_cells: int
    """See `hole_depth`."""
    stray_rise: float
    """A cell this far (m) over ground beside it, and `stray_under` an object, is part of its wall."""
    stray_under: float
    """How far (m) a cell on a wall lies under the object beside it."""
    stray_cells: float
    """Ground beside a cell may lie lower by the slope of the terrain over this many cells."""
    stray_rounds: int
    """Rows of cells in which a slanting wall may stand."""
    island_cells: int
    """More cells of ground together are taken for what they are."""
    island_nearest: int
    """The terrain at an island is foretold by so many of the nearest cells of ground outside it."""


def find_strays(surface: Raster, slope: Grid, objects: Mask, occupied: Mask, rules: StrayRules) -> Mask:
    """The occupied cells (H, W) outside the objects that hold no ground after all.

    An opening cannot take away a hole. And it excuses the points low on the wall of a wide building when the
    terrain is higher on its other side: they lie between both. What gives them away is the object right over
    them. The cells lower or higher than their neighbours by the terrain's slope are left alone.
    """
    z, cell = surface.values, surface.cell
    strays = hole_kernel(z, slope, occupied & ~objects, cell, rules.hole_depth, rules.hole_cells)
    for _ in range(rules.stray_rounds):
        taken = objects | strays
        walls = wall_kernel(
            z,
            slope,
            occupied & ~taken,
            occupied & taken,
            cell,
            rules.stray_rise,
            rules.stray_under,
            rules.stray_cells,
        )
        if not walls.any():
            break
        strays |= walls
    return np.asarray(strays)


@kernel
def hole_kernel(z: Grid, slope: Grid, ground: Mask, cell: float, depth: float, around: int) -> Mask:
    """The ground cells (H, W) far under all others within `around`, of which there is at least one."""
    rows, columns = z.shape
    holes = np.zeros((rows, columns), np.bool_)
    for row in range(rows):
        for column in range(columns):
            if not ground[row, column]:
                continue
            most = z[row, column] + depth + around * cell * slope[row, column]
            alone, deep = True, True
            for r in range(max(0, row - around), min(rows, row + around + 1)):
                for c in range(max(0, column - around), min(columns, column + around + 1)):
                    if ground[r, c] and (r != row or c != column):
                        alone = False
                        deep = deep and z[r, c] > most
                if not deep:
                    break
            holes[row, column] = deep and not alone
    return holes


@kernel
def wall_kernel(
    z: Grid,
    slope: Grid,
    ground: Mask,
    objects: Mask,
    cell: float,
    rise: float,
    below: float,
    slope_cells: float,
) -> Mask:
    """The ground cells (H, W) over ground on one side and under an object on another."""
    rows, columns = z.shape
    walls = np.zeros((rows, columns), np.bool_)
    for row in range(rows):
        for column in range(columns):
            if not ground[row, column]:
                continue
            least = z[row, column] - rise - slope_cells * cell * slope[row, column]
            over, under = False, False
            for r in range(max(0, row - 1), min(rows, row + 2)):
                for c in range(max(0, column - 1), min(columns, column + 2)):
                    over = over or (ground[r, c] and z[r, c] < least)
                    under = under or (objects[r, c] and z[r, c] > z[row, column] + below)
            walls[row, column] = over and under
    return walls
