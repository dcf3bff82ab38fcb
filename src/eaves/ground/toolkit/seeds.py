"""Seeds of a TIN of the ground: the lowest points that no object carries."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from eaves.ground.toolkit.wide_objects import PlateauRules
from eaves.kernels import kernel
from eaves.methods import parameter
from eaves.model import Bounds, Grid, Integers, Labels, Mask, Points, Raster
from eaves.raster.grid import (
    EMPTY,
    heights_of,
    highest_in_squares,
    lowest_in_squares,
    lowest_points,
    whole_cells,
)
from eaves.raster.groups import BESIDE, group_cells, neighbour_pairs
from eaves.raster.interpolate import fill_linear, fill_smooth


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
        "Rise over the opened surface, per metre of the window's radius, that makes an object; on a slope "
        "of 1 twice as much.",
        gt=0,
    )


@dataclass(frozen=True, eq=False)
class LowestPoints:
    """The lowest point of each cell: its number (H, W), and its height moved to the centre of the cell."""

    number: NDArray[np.int64]
    surface: Raster
    slope: Grid
    over: Mask
    """Mask (H, W) of the cells that hold nothing but what stands over the terrain."""


def lowest_of_cells(xyz: Points, side: float, bounds: Bounds | None = None) -> NDArray[np.int64]:
    """Numbers (K,) of the lowest point in each cell of the given side (m), cells fixed to the origin.

    `bounds` are those of the points, where they are known.
    """
    number = lowest_points(xyz, whole_cells(bounds or Bounds.of(xyz), side), side)
    return np.asarray(number[number != EMPTY])


def lowest_surface(xyz: Points, bounds: Bounds, cell: float, opening: Opening, over: Mask) -> LowestPoints:
    """The surface of the lowest points (N, 3) within `bounds`, and the slope of the terrain in it as a first
    pass finds it; `over` (N,) are points that stand over the terrain.

    A lowest point lies anywhere in its cell, which on a slope is a height error of slope × cell. So the
    heights are moved along the slope to the centre of the cell.
    """
    bounds = whole_cells(bounds, cell)
    number = lowest_points(xyz, bounds, cell)
    (rows, columns), occupied = number.shape, number != EMPTY
    above = occupied & over[np.maximum(number, 0)]
    heights = heights_of(number, xyz[:, 2])
    bare = Raster(np.where(above, np.float32(np.nan), heights), bounds.west, bounds.north, cell)
    south, east = slopes_of(bare, opening)
    centred = centred_kernel(xyz, number, heights, east, south, bounds.west, bounds.north, cell)
    slope = np.repeat(np.repeat(np.hypot(south, east), 2, axis=0), 2, axis=1)[:rows, :columns]
    return LowestPoints(number, fill_linear(bare.with_(values=centred)), slope, above)


@kernel
def centred_kernel(
    xyz: Points,
    number: Integers,
    heights: Grid,
    east: Grid,
    south: Grid,
    west: float,
    north: float,
    cell: float,
) -> Grid:
    """Heights (H, W) of the points numbered (H, W), moved to the centres of their cells along the rise to
    east and south, which is that of two by two cells; NaN where there is none."""
    rows, columns = number.shape
    centred = np.full((rows, columns), np.nan, np.float32)
    for row in range(rows):
        for column in range(columns):
            i = number[row, column]
            if i == EMPTY:
                continue
            z = np.float64(heights[row, column])
            z += east[row // 2, column // 2] * (west + (column + 0.5) * cell - xyz[i, 0])
            z -= south[row // 2, column // 2] * (north - (row + 0.5) * cell - xyz[i, 1])
            centred[row, column] = z
    return centred


def slopes_of(lowest: Raster, opening: Opening) -> tuple[Grid, Grid]:
    """Rise of the terrain to the south and to the east in each square of two by two cells (H, W), by a first
    opening of its lowest heights.

    It is measured over a quarter of the widest window, so that no car makes one.
    """
    rows, columns = lowest.shape
    even = np.pad(lowest.values, ((0, rows % 2), (0, columns % 2)), constant_values=np.nan)
    upper, lower = (np.fmin(even[k::2, ::2], even[k::2, 1::2]) for k in range(2))
    halves = np.fmin(upper, lower)
    wide = Raster(fill_smooth(halves), lowest.west, lowest.north, 2.0 * lowest.cell)
    level = np.zeros(wide.shape, np.float32)
    if min(wide.shape) < 2:
        return level, level
    objects = stands_out(wide, opening, level)
    terrain = fill_smooth(np.where(objects, np.float32(np.nan), halves))
    smooth = ndimage.gaussian_filter(terrain, opening.window / 4.0 / wide.cell, truncate=2)
    south, east = np.gradient(smooth, wide.cell)
    return south, east


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
    objects = stands_out(surface, opening, lowest.slope) | lowest.over
    bare = surface.with_(values=np.where(objects | ~occupied, np.nan, surface.values).astype(np.float32))
    objects |= stands_out(fill_linear(bare), opening, lowest.slope)
    objects &= ~find_terraces(surface, objects, occupied, opening) | lowest.over
    return objects


def stands_out(surface: Raster, opening: Opening, slope: Grid) -> Mask:
    """Cells (H, W) that rise over the surface opened with a growing window.

    A window of radius r takes away what is narrower than 2 r; a cell is an object's when it loses more than
    `object_slope` · (1 + slope) · r to one step [zhang2003, pingel2013].
    """
    objects = np.zeros(surface.shape, bool)
    rise = (opening.object_slope * (1.0 + slope)).astype(np.float32)
    widest = max(1, round(opening.window / 2.0 / surface.cell))
    # a few cells more at a time, and an eighth once that is more
    radii = [1]
    while radii[-1] < widest:
        radii.append(min(widest, radii[-1] + max(1, radii[-1] // 8)))
    higher = surface.values
    # opened with a window, a surface is the same as opened with the windows before it, too
    for radius, lower in zip(radii, openings(higher, radii), strict=True):
        stand_out_kernel(objects, higher, lower, rise, np.float32(radius * surface.cell))
        higher = lower
    return objects


@kernel
def stand_out_kernel(objects: Mask, surface: Grid, lower: Grid, rise: Grid, radius: float) -> None:
    """Mark in `objects` (H, W) the cells of `surface` that rise over `lower`."""
    rows, columns = objects.shape
    for row in range(rows):
        line, upper, low, most = objects[row], surface[row], lower[row], rise[row]
        for column in range(columns):
            line[column] |= upper[column] - low[column] > most[column] * radius
