"""Where a TIN of the ground begins: the lowest points that no object carries."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from eaves.ground.toolkit.islands import find_islands
from eaves.ground.toolkit.morphology import openings
from eaves.ground.toolkit.pits import StrayRules, find_strays
from eaves.ground.toolkit.terraces import TerraceRules, find_terraces
from eaves.ground.toolkit.wide_objects import OVER, REACHED, Standing
from eaves.kernels import kernel
from eaves.methods import parameter
from eaves.model import Bounds, Grid, Mask, Points, Raster
from eaves.raster.grid import EMPTY, heights_of, lowest_points, whole_cells
from eaves.raster.interpolate import fill_linear, fill_smooth


class Opening(TerraceRules, StrayRules):
    """What an opening takes for objects."""

    window: float = parameter(
        36.0, "Widest window of the opening; what is wider was found by its walls.", unit="m", gt=0
    )
    window_growth: float = parameter(
        1.15, "Ratio of one window to the next, once they differ by more than a cell.", ge=1
    )
    first_slope: float = parameter(
        0.12, "Rise, per metre of the window's radius, that makes an object in the first, rough pass.", gt=0
    )
    first_height: float = parameter(0.2, "Height that is added to it.", unit="m", ge=0)
    slope_scale: float = parameter(
        8.0,
        "Standard deviation of the smoothing before the terrain's slope is measured: wider than a car.",
        unit="m",
        gt=0,
    )
    object_slope: float = parameter(
        0.12, "Rise over the opened surface, per metre of the window's radius, that makes an object.", gt=0
    )
    slope_share: float = parameter(0.3, "Part of the terrain's slope that is added to it.", ge=0)
    rough_share: float = parameter(
        0.2, "Height that a cell of sloping terrain may rise more, per metre of cell and slope.", ge=0
    )


@dataclass(frozen=True, eq=False)
class LowestPoints:
    """The lowest point of each cell: its number (H, W), and its height moved to the centre of the cell."""

    number: NDArray[np.int64]
    surface: Raster
    slope: Grid
    standing: Standing
    """Where the lowest point of each cell (H, W) stands."""


def lowest_of_cells(xyz: Points, side: float, bounds: Bounds | None = None) -> NDArray[np.int64]:
    """Numbers (K,) of the lowest point in each cell of the given side (m), cells fixed to the origin.

    `bounds` are those of the points, where they are known.
    """
    number = lowest_points(xyz, whole_cells(bounds or Bounds.of(xyz), side), side)
    return np.asarray(number[number != EMPTY])


def lowest_surface(
    xyz: Points, bounds: Bounds, cell: float, opening: Opening, standing: Standing
) -> LowestPoints:
    """The surface of the lowest points (N, 3) within `bounds`, and the slope of the terrain in it as a first
    pass finds it; `standing` (N,) tells where points stand.

    A lowest point lies anywhere in its cell, which on a slope is a height error of slope × cell. So the
    heights are moved along the slope to the centre of the cell.
    """
    bounds = whole_cells(bounds, cell)
    number = lowest_points(xyz, bounds, cell)
    occupied = number != EMPTY
    place = np.where(occupied, standing[np.maximum(number, 0)], 0).astype(np.uint8)
    heights = fill_smooth(heights_of(number, xyz[:, 2]))
    raw = Raster(heights, bounds.west, bounds.north, cell)
    level = np.zeros(raw.shape, np.float32)
    first = level + np.float32(opening.first_slope)
    objects = stands_out(raw.values, cell, opening, first, opening.first_height, level)
    terrain = fill_smooth(
        np.where(objects | (place == OVER) | ~occupied, np.nan, raw.values).astype(np.float32)
    )
    smooth = ndimage.gaussian_filter(terrain, opening.slope_scale / cell, truncate=2.5)
    south, east = (level, level) if min(raw.shape) < 2 else np.asarray(np.gradient(smooth, cell))
    rows, columns = np.nonzero(occupied)
    at = xyz[number[occupied]]
    moved = raw.values[occupied].astype(np.float64)
    moved += east[occupied] * (bounds.west + (columns + 0.5) * cell - at[:, 0])
    moved -= south[occupied] * (bounds.north - (rows + 0.5) * cell - at[:, 1])
    centred = np.full(raw.shape, np.nan, np.float32)
    centred[occupied] = moved
    slope = np.hypot(south, east).astype(np.float32)
    return LowestPoints(number, fill_linear(raw.with_(values=centred)), slope, place)


def seeds_by_opening(lowest: LowestPoints, opening: Opening) -> NDArray[np.int64]:
    """Numbers (K,) of the lowest points that stand on no object up to the widest window wide.

    The opening is done twice: what stood between objects stands alone once they are gone. Then terraces
    return, and what is half way up a wall or in a hole goes.
    """
    surface, occupied = lowest.surface, lowest.number != EMPTY
    cell = surface.cell
    rise = (opening.object_slope + opening.slope_share * lowest.slope).astype(np.float32)
    rough = (opening.rough_share * cell * lowest.slope).astype(np.float32)
    over = lowest.standing == OVER
    objects = stands_out(surface.values, cell, opening, rise, 0.0, rough) | over
    bare = surface.with_(values=np.where(objects | ~occupied, np.nan, surface.values).astype(np.float32))
    objects |= stands_out(fill_linear(bare).values, cell, opening, rise, 0.0, rough)
    reached = lowest.standing == REACHED
    objects &= ~find_terraces(surface, objects, occupied, reached, opening) | over
    objects |= find_strays(surface, lowest.slope, objects, occupied, opening)
    objects |= find_islands(surface, lowest.slope, occupied & ~objects, occupied, opening)
    return np.asarray(lowest.number[occupied & ~objects])


def stands_out(surface: Grid, cell: float, opening: Opening, rise: Grid, height: float, rough: Grid) -> Mask:
    """Cells (H, W) that rise over the surface opened with a growing window.

    A window of radius r takes away what is narrower than 2 r; a cell is an object's when it loses more than
    `rise` · r + `height` + `rough` to one step [zhang2003, pingel2013].
    """
    objects = np.zeros(surface.shape, bool)
    radii, widest_radius = [0], max(1, round(opening.window / 2.0 / cell))
    while radii[-1] < widest_radius:
        radii.append(min(widest_radius, max(radii[-1] + 1, round(radii[-1] * opening.window_growth))))
    # opened with a window, a surface is the same as opened with the windows before it, too
    for radius, lower in zip(radii[1:], openings(surface, radii[1:]), strict=True):
        stand_out_kernel(objects, surface, lower, rise, rough, np.float32(radius * cell), np.float32(height))
        surface = lower
    return objects


@kernel
def stand_out_kernel(
    objects: Mask, surface: Grid, lower: Grid, rise: Grid, rough: Grid, radius: float, height: float
) -> None:
    """Mark in `objects` (H, W) the cells of `surface` that rise over `lower`."""
    rows, columns = objects.shape
    for row in range(rows):
        for column in range(columns):
            most = rise[row, column] * radius + height + rough[row, column]
            if surface[row, column] - lower[row, column] > most:
                objects[row, column] = True
