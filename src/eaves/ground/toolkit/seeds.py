"""Seeds of a TIN of the ground: the lowest points that no object carries."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eaves.ground.toolkit.wide_objects import PlateauRules
from eaves.kernels import kernel
from eaves.methods import parameter
from eaves.model import Bounds, Grid, Labels, Mask, Points, Raster
from eaves.raster.grid import (
    EMPTY,
    heights_of,
    highest_in_squares,
    lowest_in_squares,
    lowest_points,
    whole_cells,
)
from eaves.raster.groups import BESIDE, group_cells, neighbour_pairs
from eaves.raster.interpolate import fill_linear


class TerraceRules(PlateauRules):
    """When an object cell is terrain."""

    terrace_steep: float = parameter(
        0.2,
        "Share of the height difference that counts as residual where the slope goes on: walls go on too.",
        ge=0,
        le=1,
    )


def find_terraces(surface: Raster, objects: Mask, occupied: Mask, rules: TerraceRules) -> Mask:
    """The object cells (H, W) that are terrain.

    Object cells that continue each other within the tolerance of the ground's roughness make a piece. Its rim
    is counted where it meets the ground level, and where it steps down; both cells must hold a point, for
    one interpolated between them makes a slope of a low wall. A roof steps down on nearly all sides, also
    when it is flush with the ground uphill; a spur, a terrace, or a high field at the rim of the data does
    not. The two are weighed as those of wide surfaces (`judge_surfaces`); as much rim as the window is wide
    counts as stepping down of every piece, for a short one says little.
    """
    z = surface.values.astype(np.float64)
    residual = residual_kernel(z, rules.terrace_steep)
    ground = occupied & ~objects
    beside = [ground[:, :-1] & ground[:, 1:], ground[:-1] & ground[1:]]
    even = np.concatenate([residual[0][:, :-1][beside[0]], residual[1][:-1][beside[1]]])
    step = rules.tolerance(float(np.median(even)) if len(even) else 0.0)
    piece, count = terrace_pieces(objects, residual, step)
    level, down = surface.cell * rim_kernel(objects, piece, count, residual, z, step, occupied)
    least = rules.window * float(np.mean(occupied)) ** 2  # so much of a rim is known
    terrain = rules.level_weight * level > down + least
    terrain[0] = False
    return np.asarray(terrain[piece])


def terrace_pieces(objects: Mask, residual: NDArray[np.float64], step: float) -> tuple[Labels, int]:
    """Numbers (H, W) of object cells joined by residuals under `step`, 0 elsewhere; how many there are."""
    first, second = neighbour_pairs(objects, steps=BESIDE)
    columns = objects.shape[1]
    joined = residual[np.where(second - first == columns, 1, 0), *np.divmod(first, columns)] < step
    return group_cells(objects, first[joined], second[joined])


@kernel
def residual_kernel(z: NDArray[np.float64], steep_share: float) -> NDArray[np.float64]:
    """Misfit (2, H, W), m, of each cell continued into its neighbour east (0) and south (1).

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
    occupied: Mask,
) -> NDArray[np.float64]:
    """Cell sides (2, count + 1) where each piece meets ground without a step, and where it steps down."""
    rims = np.zeros((2, count + 1))
    rows, columns = objects.shape
    for row in range(rows):
        for column in range(columns):
            for k in range(2):
                r, c = row + k, column + 1 - k
                if r >= rows or c >= columns or piece[r, c] == piece[row, column]:
                    continue
                if not occupied[r, c] or not occupied[row, column]:
                    continue
                if residual[k, row, column] < step:
                    if objects[row, column] != objects[r, c]:
                        rims[0, piece[row, column]] += 1
                        rims[0, piece[r, c]] += 1
                else:
                    rims[1, piece[row, column] if z[r, c] < z[row, column] else piece[r, c]] += 1
    return rims


def openings(values: Grid, radii: Iterable[int]) -> Iterator[Grid]:
    """The highest surface (H, W) under `values` that a square of 2 r + 1 cells touches everywhere, for radii
    r that grow.

    `values` holds no NaN. Beyond the rim the surface goes on as it ends. The lowest values of a square are
    those of the square before, a little farther around.
    """
    lowest, before = np.ascontiguousarray(values, np.float32), 0
    for radius in radii:
        lowest, before = lowest_in_squares(lowest, radius - before), radius
        yield highest_in_squares(lowest, radius)


class Opening(TerraceRules):
    """Rules by which a morphological opening finds objects."""

    object_slope: float = parameter(
        0.1,
        "Rise over the opened surface, per metre of the window's radius, that makes an object.",
        gt=0,
    )


@dataclass(frozen=True, eq=False)
class LowestPoints:
    """The lowest point of each cell: its number (H, W), and its height, which goes on between them."""

    number: NDArray[np.int64]
    surface: Raster
    over: Mask
    """Mask (H, W) of the cells that hold nothing but what stands over the terrain."""


def lowest_of_cells(xyz: Points, side: float, bounds: Bounds | None = None) -> NDArray[np.int64]:
    """Numbers (K,) of the lowest point in each cell of the given side (m), cells fixed to the origin.

    `bounds` are those of the points, where they are known.
    """
    number = lowest_points(xyz, whole_cells(bounds or Bounds.of(xyz), side), side)
    return np.asarray(number[number != EMPTY])


def lowest_surface(xyz: Points, bounds: Bounds, cell: float, over: Mask) -> LowestPoints:
    """The surface of the lowest points (N, 3) within `bounds`; `over` (N,) are points that stand over the
    terrain.
    """
    bounds = whole_cells(bounds, cell)
    number = lowest_points(xyz, bounds, cell)
    above = (number != EMPTY) & over[np.maximum(number, 0)]
    heights = Raster(heights_of(number, xyz[:, 2]), bounds.west, bounds.north, cell)
    return LowestPoints(number, fill_linear(heights), above)


def seeds_by_opening(lowest: LowestPoints, opening: Opening) -> NDArray[np.int64]:
    """Numbers (K,) of the lowest points that stand on no object up to the widest window wide.

    The opening is done twice: what stood between objects stands alone once they are gone. Then terraces
    return.
    """
    return np.asarray(lowest.number[(lowest.number != EMPTY) & ~stands_over(lowest, opening)])


def terrain_of(lowest: LowestPoints, opening: Opening) -> Raster:
    """The surface (H, W) of the seeds, which goes on between them."""
    bare = (lowest.number == EMPTY) | stands_over(lowest, opening)
    values = np.where(bare, np.float32(np.nan), lowest.surface.values)
    return fill_linear(lowest.surface.with_(values=values))


def stands_over(lowest: LowestPoints, opening: Opening) -> Mask:
    """Cells (H, W) of objects up to the widest window wide."""
    surface, occupied = lowest.surface, lowest.number != EMPTY
    objects = stands_out(surface, opening) | lowest.over
    bare = surface.with_(values=np.where(objects | ~occupied, np.nan, surface.values).astype(np.float32))
    objects |= stands_out(fill_linear(bare), opening)
    objects &= ~find_terraces(surface, objects, occupied, opening) | lowest.over
    return objects


def stands_out(surface: Raster, opening: Opening) -> Mask:
    """Cells (H, W) that rise over the surface opened with a growing window.

    A window of radius r takes away what is narrower than 2 r; a cell is an object's when it loses more than
    `object_slope` · r to one step [zhang2003, pingel2013].
    """
    objects = np.zeros(surface.shape, bool)
    widest = max(1, round(opening.window / 2.0 / surface.cell))
    # a few cells more at a time, and an eighth once that is more
    radii = [1]
    while radii[-1] < widest:
        radii.append(min(widest, radii[-1] + max(1, radii[-1] // 8)))
    higher = surface.values
    # opened with a window, a surface is the same as opened with the windows before it, too
    for radius, lower in zip(radii, openings(higher, radii), strict=True):
        objects |= higher - lower > np.float32(opening.object_slope * radius * surface.cell)
        higher = lower
    return objects
