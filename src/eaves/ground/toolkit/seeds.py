"""Seeds of a TIN of the ground: the lowest points that no object carries."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from eaves.ground.toolkit.morphology import openings
from eaves.ground.toolkit.terraces import TerraceRules, find_terraces
from eaves.kernels import kernel
from eaves.methods import parameter
from eaves.model import Bounds, Grid, Mask, Points, Raster
from eaves.raster.grid import EMPTY, heights_of, lowest_points, whole_cells
from eaves.raster.interpolate import fill_linear, fill_smooth


class Opening(TerraceRules):
    """Rules by which a morphological opening finds objects."""

    window: float = parameter(
        27.0, "Widest window of the opening; what is wider was found by its walls.", unit="m", gt=0
    )
    object_slope: float = parameter(
        0.08, "Rise over the opened surface, per metre of the window's radius, that makes an object.", gt=0
    )
    slope_share: float = parameter(0.3, "Share of the terrain's slope that is added to it.", ge=0)


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
    occupied = number != EMPTY
    above = occupied & over[np.maximum(number, 0)]
    heights = heights_of(number, xyz[:, 2])
    bare = Raster(np.where(above, np.float32(np.nan), heights), bounds.west, bounds.north, cell)
    south, east = slopes_of(bare, opening)
    rows, columns = np.nonzero(occupied)
    at = xyz.take(number[occupied], axis=0)
    moved = heights[occupied].astype(np.float64)
    moved += east[occupied] * (bounds.west + (columns + 0.5) * cell - at[:, 0])
    moved -= south[occupied] * (bounds.north - (rows + 0.5) * cell - at[:, 1])
    centred = np.full(bare.shape, np.nan, np.float32)
    centred[occupied] = moved
    slope = np.hypot(south, east).astype(np.float32)
    return LowestPoints(number, fill_linear(bare.with_(values=centred)), slope, above)


def slopes_of(lowest: Raster, opening: Opening) -> tuple[Grid, Grid]:
    """Rise of the terrain to the south and to the east in each cell (H, W), by a first opening of the lowest
    heights of cells twice as wide.

    It is measured over a quarter of the widest window, so that no car makes one.
    """
    rows, columns = lowest.shape
    even = np.pad(lowest.values, ((0, rows % 2), (0, columns % 2)), constant_values=np.nan)
    halves = np.fmin.reduce(even.reshape(even.shape[0] // 2, 2, -1, 2), axis=(1, 3))
    wide = Raster(fill_smooth(halves), lowest.west, lowest.north, 2.0 * lowest.cell)
    level = np.zeros(wide.shape, np.float32)
    if min(wide.shape) < 2:
        return np.zeros(lowest.shape, np.float32), np.zeros(lowest.shape, np.float32)
    objects = stands_out(wide, opening, level)
    terrain = fill_smooth(np.where(objects, np.float32(np.nan), halves))
    smooth = ndimage.gaussian_filter(terrain, opening.window / 4.0 / wide.cell, truncate=2)
    south, east = (
        np.repeat(np.repeat(rise, 2, axis=0), 2, axis=1)[:rows, :columns]
        for rise in np.gradient(smooth, wide.cell)
    )
    return south, east


def seeds_by_opening(lowest: LowestPoints, opening: Opening) -> NDArray[np.int64]:
    """Numbers (K,) of the lowest points that stand on no object up to the widest window wide.

    The opening is done twice: what stood between objects stands alone once they are gone. Then terraces
    return.
    """
    surface, occupied = lowest.surface, lowest.number != EMPTY
    objects = stands_out(surface, opening, lowest.slope) | lowest.over
    bare = surface.with_(values=np.where(objects | ~occupied, np.nan, surface.values).astype(np.float32))
    objects |= stands_out(fill_linear(bare), opening, lowest.slope)
    objects &= ~find_terraces(surface, objects, occupied, opening) | lowest.over
    return np.asarray(lowest.number[occupied & ~objects])


def stands_out(surface: Raster, opening: Opening, slope: Grid) -> Mask:
    """Cells (H, W) that rise over the surface opened with a growing window.

    A window of radius r takes away what is narrower than 2 r; a cell is an object's when it loses more than
    (`object_slope` + `slope_share` · slope) · r to one step [zhang2003, pingel2013].
    """
    objects = np.zeros(surface.shape, bool)
    rise = (opening.object_slope + opening.slope_share * slope).astype(np.float32)
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
        for column in range(columns):
            if surface[row, column] - lower[row, column] > rise[row, column] * radius:
                objects[row, column] = True
