"""Terrain that an opening took for an object: wide, and joined to the ground without a step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import kernel
from eaves.methods import Method, parameter
from eaves.model import Labels, Mask, Raster
from eaves.raster.groups import BESIDE, group_cells, neighbour_pairs
from eaves.raster.nearest import ADJOINING, near_cells


class TerraceRules(Method):
    """When an object cell is terrain."""

    level_share: float = parameter(
        0.2, "A wide piece that meets the ground level on more of its rim is terrain.", ge=0, le=1
    )
    terrace_step: float = parameter(
        0.3,
        "A larger residual between two cells of 1 m parts pieces; it grows with the root of the cell.",
        unit="m",
        gt=0,
    )
    terrace_steep: float = parameter(
        0.2,
        "Share of the height difference that counts as residual where the slope goes on: walls go on too.",
        ge=0,
        le=1,
    )
    terrace_area: float = parameter(
        200.0, "Smaller pieces must be level on twice `level_share` of the rim.", unit="m²", ge=0
    )
    terrace_area_least: float = parameter(
        80.0, "Smaller pieces have a rim too short to judge.", unit="m²", ge=0
    )
    roof_height: float = parameter(
        2.0, "A wide piece that is nowhere so high over the ground is no roof.", unit="m", gt=0
    )
    roof_share: float = parameter(0.1, "Share of its rim that may be higher all the same.", ge=0, le=1)
    roof_cells: int = parameter(
        5, "Wide, for that, is a piece with a cell so many cells from its rim: no car, hedge or boat.", ge=1
    )
    reached_share: float = parameter(
        0.75, "A piece over `terrace_area` is terrain when a way leads to so much of it.", ge=0, le=1
    )
    terrace_rounds: int = parameter(2, "Terraces that may join the ground over one another.", ge=0)


def find_terraces(surface: Raster, objects: Mask, occupied: Mask, reached: Mask, rules: TerraceRules) -> Mask:
    """The object cells (H, W) that are terrain.

    Object cells that continue each other smoothly make a piece. Its rim is counted where it meets the ground:
    level, or as a step down; both cells must hold a point, for one interpolated between them makes a slope
    of a low wall. A roof meets the ground by steps on nearly all sides, also when it is flush with the ground
    uphill; a spur, a terrace, or a high field at the rim of the data does not. A piece is terrain when more
    than `level_share` of its counted rim is level. So is a wide one that is lower than any roof: a strip of a
    terrace that the rim of the data cuts off; and a wide one whose cells are `reached` by a way.
    """
    z = surface.values.astype(np.float64)
    cell = surface.cell
    step = rules.terrace_step * np.sqrt(max(1.0, cell))
    residual = residual_kernel(z, rules.terrace_steep)
    left = objects.copy()
    for _ in range(rules.terrace_rounds):
        piece, count = terrace_pieces(left, residual, step)
        # cells without a point of their own kind beside them were interpolated, and have no area
        near = [near_cells(occupied & kind, ADJOINING) for kind in (left, ~left)]
        known = np.where(left, *near)
        level, down, high = rim_kernel(left, piece, count, residual, z, step, occupied, rules.roof_height)
        area = np.bincount(piece[known], minlength=count + 1) * cell * cell
        wide = area >= rules.terrace_area
        terrain = level > np.where(wide, 1.0, 2.0) * rules.level_share * (level + down)
        deep = np.bincount(piece[~near_cells(~left, rules.roof_cells**2 - 1)], minlength=count + 1) > 0
        terrain |= deep & (high <= rules.roof_share * (level + down)) & (down > 0)
        ways, held = (np.bincount(piece[some], minlength=count + 1) for some in (reached, occupied))
        terrain |= wide & (ways >= rules.reached_share * held)
        terrain &= area >= rules.terrace_area_least
        terrain[0] = False
        if not terrain.any():
            break
        left &= ~terrain[piece]
    return objects & ~left


def terrace_pieces(objects: Mask, residual: NDArray[np.float64], step: float) -> tuple[Labels, int]:
    """Numbers (H, W) of object cells joined by residuals under `step`, 0 elsewhere; how many there are."""
    one, two = neighbour_pairs(objects, steps=BESIDE)
    columns = objects.shape[1]
    joined = residual[np.where(two - one == columns, 1, 0), *np.divmod(one, columns)] < step
    return group_cells(objects, one[joined], two[joined])


@kernel
def residual_kernel(z: NDArray[np.float64], steep_share: float) -> NDArray[np.float64]:
    """How badly each cell goes on into its neighbour east (0) and south (1), (2, H, W), m.

    The height difference, or its deviation from the difference just before or just after, whichever is least:
    a steep but even slope goes on, a wall between two levels does not.
    """
    rows, columns = z.shape
    residual = np.full((2, rows, columns), np.inf)
    for row in range(rows):
        for column in range(columns):
            for k in range(2):
                r, c = row + k, column + 1 - k
                if r >= rows or c >= columns:
                    continue
                here = z[r, c] - z[row, column]
                before, after = 0.0, 0.0
                if row - k >= 0 and column - 1 + k >= 0:
                    before = z[row, column] - z[row - k, column - 1 + k]
                if r + k < rows and c + 1 - k < columns:
                    after = z[r + k, c + 1 - k] - z[r, c]
                bend = min(abs(here - before), abs(here - after)) + steep_share * abs(here)
                residual[k, row, column] = min(abs(here), bend)
    return residual


@kernel
def rim_kernel(
    objects: Mask,
    piece: Labels,
    count: int,
    residual: NDArray[np.float64],
    z: NDArray[np.float64],
    step: float,
    known: Mask,
    roof: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Cell sides where each piece (count + 1,) meets ground without a step, where it steps down, and where it
    does by more than `roof` (m).
    """
    level, down, high = np.zeros(count + 1), np.zeros(count + 1), np.zeros(count + 1)
    rows, columns = objects.shape
    for row in range(rows):
        for column in range(columns):
            for k in range(2):
                r, c = row + k, column + 1 - k
                if r >= rows or c >= columns or piece[r, c] == piece[row, column]:
                    continue
                if not known[r, c] or not known[row, column]:
                    continue
                if residual[k, row, column] < step:
                    if objects[row, column] != objects[r, c]:
                        level[piece[row, column]] += 1
                        level[piece[r, c]] += 1
                    continue
                upper = piece[row, column] if z[r, c] < z[row, column] else piece[r, c]
                down[upper] += 1
                if abs(z[r, c] - z[row, column]) > roof:
                    high[upper] += 1
    return level, down, high
