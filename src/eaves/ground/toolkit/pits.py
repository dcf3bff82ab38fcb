"""Lowest points that pass for ground and are not: half way up a wall, or at the bottom of a hole."""

from __future__ import annotations

import numpy as np

from eaves.kernels import kernel
from eaves.methods import Method, parameter
from eaves.model import Grid, Mask, Raster


class StrayRules(Method):
    """When a lowest point is no ground."""

    hole_depth: float = parameter(
        1.0, "A cell so far under all ground around holds an echo gone astray.", unit="m", ge=0
    )
    hole_cells: int = parameter(2, "The ground around is that within so many cells.", ge=1)
    stray_rise: float = parameter(
        0.7, "A cell so far over ground beside it may be part of a wall.", unit="m", ge=0
    )
    stray_under: float = parameter(
        3.0, "It is when it lies so far under an object beside it.", unit="m", ge=0
    )
    stray_cells: float = parameter(
        1.5, "The terrain's slope over so many cells is added to `stray_rise`.", ge=0
    )
    stray_rounds: int = parameter(2, "Rows of cells in which a slanting wall may stand.", ge=0)
    island_cells: int = parameter(
        3, "More cells of ground together among objects are taken for what they are.", ge=0
    )
    island_nearest: int = parameter(
        12, "The terrain at fewer is foretold by so many of the nearest cells of ground.", ge=1
    )


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
