"""Seeds of a TIN of the ground: the lowest points that no object carries."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eaves.geometry.neighbours import TABLE_CELLS, measure_spacing
from eaves.ground.toolkit.floor import RING, empty_around, level_around, ring_of
from eaves.ground.toolkit.wide_objects import PlateauRules
from eaves.kernels import inlined_kernel, kernel
from eaves.methods import parameter
from eaves.model import Bounds, Grid, Integers, Labels, Mask, PointCloud, Points, Raster, Values
from eaves.raster.blur import BESIDE, group_cells, neighbour_pairs
from eaves.raster.grid import (
    EMPTY,
    heights_of,
    highest_in_squares,
    lowest_in_squares,
    lowest_points,
    whole_cells,
)
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


SIDE_M, SIDE_SPACINGS = 1.0, 3.0
"""Side of the cells whose lowest points are compared: 1 m, or three spacings in thin data, so that one of a
cell's nine points is ground. Echoes that come late together lie within a metre of each other."""
DEPTH_M, REACH_SPACINGS = 0.3, 2.0
"""Echoes lie deeper under the surface than 0.3 m, with which the filters bear, and in wider cells than that
times the square of their width: so far curved terrain leaves a plane. Points within two spacings in plan, a
dozen, cover those under them. As wide are the cells, each with a point, whose opening finds the terrain that
echoes lie under, or `SIDE_M`."""
CELL_M = 10.0
"""Side of the cells whose highest points are compared: 10 m, or ten spacings (about a hundred points) in thin
data. A high group lies as far above the rest of its cell, and no neighbour reaches as high: wires do."""
GROUP, GROUP_SHARE = 16, 0.25
"""Most points of a high group, and its largest share of the cell."""


class Cells(NamedTuple):
    """Points in square cells (rows, columns) of a `side` (m), the first with its south-west `corner` (2,).

    `order` (N,) numbers the points cell by cell, row by row; those of a cell begin at its `first`.
    """

    corner: Values
    side: float
    rows: int
    columns: int
    first: Integers
    order: NDArray[np.int32]


def find_outliers(cloud: PointCloud) -> tuple[Mask, Mask]:
    """Masks (N,) of low and of high outliers.

    Two things make a low outlier. It lies under the surface that the lowest points around make:
    where ground goes on at its level, as it does under crowns, along ditches and in corners of courts, it
    is none. And that surface, or what stands on it, goes on above it: most points as low, within a cell
    of it, have higher ones on all sides within two spacings in plan. A well, a ramp or a cellar has
    nothing above but at its walls, a slope nothing downhill. Once those found are gone others show, so it is
    done until there is none: the deepest are found first; and once more in cells three times as wide, for
    sheets of echoes. In a narrow court that surface is a roof's. So those found are held against the terrain
    that an opening leaves without them, where roofs are gone, and only what lies under it too is an outlier.

    High: the plane is cut into wide cells, and once more into cells shifted by half a side, so that a group
    is whole in one of them. The highest points of a cell that a gap parts from the rest are outliers when no
    neighbour has a point near their height. Cost: O(N), 0.2 s per million points, and an opening where low
    ones are found.
    """
    xyz = cloud.xyz
    low, high = np.zeros(len(xyz), bool), np.zeros(len(xyz), bool)
    if len(xyz) < GROUP:
        return low, high
    spacing, bounds = measure_spacing(xyz), Bounds.of(xyz)
    reach = REACH_SPACINGS * spacing
    wide = max(1.0, SIDE_SPACINGS * spacing / SIDE_M)
    for times in (1, 3):
        place = cells_of(bounds, side_within(bounds, times * SIDE_M * wide, len(xyz)), 0.0)
        cells = Cells(*place, *order_kernel(xyz, *place))
        mark_low_kernel(xyz, cells, ring_of(*RING), DEPTH_M * wide**2, reach, low)
    low = under_terrain(xyz, bounds, low, max(SIDE_M, reach), DEPTH_M * wide**2)
    for shift in (0.0, 0.5):
        mark_high_kernel(xyz, *cells_of(bounds, CELL_M * max(1.0, spacing), shift), high)
    return low, high & ~low


def side_within(bounds: Bounds, side: float, count: int) -> float:
    """A side (m), doubled until the table of cells fits some number of points: points far apart are rare."""
    while (bounds.width / side + 2.0) * (bounds.height / side + 2.0) > TABLE_CELLS * count:
        side *= 2.0
    return side


def under_terrain(xyz: Points, bounds: Bounds, low: Mask, side: float, depth: float) -> Mask:
    """Those of the low points (N,) that lie more than `depth` (m) under the terrain that an opening of the
    others leaves in cells of a side (m); `bounds` are those of all."""
    others, number = xyz.take(np.flatnonzero(~low), axis=0), np.flatnonzero(low)
    if len(number) == 0 or len(others) == 0:
        return low
    side = side_within(bounds, side, len(xyz))
    lowest = lowest_surface(others, bounds, side, np.zeros(len(others), bool))
    terrain = terrain_of(lowest, Opening())
    under = np.zeros(len(xyz), bool)
    under[number] = xyz[number, 2] < terrain.values[terrain.cell_of(xyz[number])] - depth
    return under


def cells_of(bounds: Bounds, side: float, shift: float) -> tuple[Values, float, int, int]:
    """The first fields of the `Cells` that hold `bounds`, fixed to the origin, not to the data, but for a
    `shift` in cells.
    """
    west, south = (np.floor(low / side + shift) - shift for low in (bounds.west, bounds.south))
    rows, columns = int(bounds.north / side - south) + 1, int(bounds.east / side - west) + 1
    return np.array([west, south]) * side, side, rows, columns


@inlined_kernel
def place_of(xyz: Points, i: int, corner: Values, side: float) -> Any:
    """Row and column of the cell that a point lies in."""
    return int((xyz[i, 1] - corner[1]) / side), int((xyz[i, 0] - corner[0]) / side)


@kernel
def order_kernel(
    xyz: Points, corner: Values, side: float, rows: int, columns: int
) -> tuple[Integers, NDArray[np.int32]]:
    """The last fields of `Cells`: where each cell begins (rows · columns + 1), and the points by cell."""
    first, order = np.zeros(rows * columns + 2, np.int64), np.empty(len(xyz), np.int32)
    cell = np.empty(len(xyz), np.int32)
    for i in range(len(xyz)):
        row, column = place_of(xyz, i, corner, side)
        cell[i] = row * columns + column
        first[cell[i] + 2] += 1
    for number in range(rows * columns):
        first[number + 2] += first[number + 1]
    for i in range(len(xyz)):  # once a cell is full, its begin has moved to that of the next
        order[first[cell[i] + 1]] = i
        first[cell[i] + 1] += 1
    return first[:-1], order


@kernel
def mark_low_kernel(xyz: Points, cells: Cells, ring: Integers, depth: float, reach: float, low: Mask) -> None:
    """Mark in `low` (N,) the low outliers, which lie deeper than `depth` (m) under what is within `reach`
    (m), round by round; a round judges all cells on the same surface.
    """
    rows, columns, away = cells.rows, cells.columns, 2 * ring.max()
    lowest, limit = empty_around(rows, columns, away), np.full((rows, columns), -np.inf)
    changed, look = np.ones((rows, columns), np.bool_), np.ones((rows, columns), np.bool_)
    steps, around = ring[:, 0] * lowest.shape[1] + ring[:, 1], np.empty(len(ring))
    flat = lowest.ravel()
    while changed.any():
        for row in range(rows):
            for column in range(columns):
                if not changed[row, column]:
                    continue
                least = np.inf
                for k in range(cells.first[row * columns + column], cells.first[row * columns + column + 1]):
                    i = cells.order[k]
                    if xyz[i, 2] < limit[row, column]:
                        low[i] = True
                    if not low[i]:
                        least = min(least, xyz[i, 2])
                lowest[row + away, column + away] = least
                if limit[row, column] > -np.inf:  # in the first round all cells are looked at
                    top, left = max(0, row - away), max(0, column - away)
                    look[top : row + away + 1, left : column + away + 1] = True
        changed[:] = False
        for row in range(rows):
            for column in range(columns):
                z = lowest[row + away, column + away]
                if not look[row, column] or z == np.inf:
                    continue
                look[row, column] = False
                cell = (row + away) * lowest.shape[1] + column + away
                level = level_around(flat, cell, steps, depth, around)
                limit[row, column] = 0.5 * (level + z)
                changed[row, column] = level > -np.inf and are_covered(
                    xyz, cells, row, column, limit[row, column], reach, low
                )


@kernel
def are_covered(
    xyz: Points, cells: Cells, row: int, column: int, middle: float, reach: float, low: Mask
) -> bool:
    """True if most points under `middle` (m), within a cell of one, are covered from there on."""
    balance = 0
    for r in range(max(0, row - 1), min(cells.rows, row + 2)):
        first = r * cells.columns + max(0, column - 1)
        last = r * cells.columns + min(cells.columns, column + 2)
        for k in range(cells.first[first], cells.first[last]):
            i = cells.order[k]
            if not low[i] and xyz[i, 2] < middle:
                balance += 1 if is_covered(xyz, cells, i, middle, reach) else -1
    return balance > 0


@kernel
def is_covered(xyz: Points, cells: Cells, i: int, middle: float, reach: float) -> bool:
    """True if points over `middle` (m) lie all around a point within `reach` (m) in plan, not to one side."""
    x, y, west, south = xyz[i, 0], xyz[i, 1], cells.corner[0], cells.corner[1]
    left = max(0, int((x - reach - west) / cells.side))
    right = min(cells.columns - 1, int((x + reach - west) / cells.side))
    bottom = max(0, int((y - reach - south) / cells.side))
    top = min(cells.rows - 1, int((y + reach - south) / cells.side))
    # they are seen from a, counter-clockwise to b
    ax, ay, bx, by, any_above = 0.0, 0.0, 0.0, 0.0, False
    for r in range(bottom, top + 1):
        cell = r * cells.columns
        for k in range(cells.first[cell + left], cells.first[cell + right + 1]):
            j = cells.order[k]
            u, v = xyz[j, 0] - x, xyz[j, 1] - y
            if xyz[j, 2] <= middle or not 0.0 < u * u + v * v <= reach * reach:
                continue
            after_a, after_b = ax * v - ay * u, bx * v - by * u
            if not any_above:
                ax, ay, bx, by, any_above = u, v, u, v, True
            elif after_a < 0.0 < after_b:
                return True
            elif after_a < 0.0:
                ax, ay = u, v
            elif after_b > 0.0 or (after_a == after_b == 0.0 and ax * u + ay * v < 0.0):
                bx, by = u, v
    return False


@kernel
def mark_high_kernel(xyz: Points, corner: Values, side: float, rows: int, columns: int, high: Mask) -> None:
    """Mark in `high` (N,) the points of high groups in cells (rows, columns), few of which rise over all
    around.
    """
    top = -empty_around(rows, columns, 1)
    level, highest, cell = np.full(top.shape, np.inf), top.ravel(), np.empty(len(xyz), np.int32)
    for i in range(len(xyz)):
        row, column = place_of(xyz, i, corner, side)
        cell[i] = (row + 1) * (columns + 2) + column + 1
        highest[cell[i]] = max(highest[cell[i]], xyz[i, 2])
    for row in range(1, rows + 1):
        for column in range(1, columns + 1):
            around = top[row - 1 : row + 2, column - 1 : column + 2].copy()
            around[1, 1] = -np.inf
            if (around > -np.inf).sum() >= 3:
                level[row, column] = around.max() + CELL_M
    rises, limit = (top >= level).ravel(), level.ravel()
    if not rises.any():
        return
    size, above = np.zeros(len(rises)), np.zeros(len(rises))
    least, rest = np.full(len(rises), np.inf), np.full(len(rises), -np.inf)
    for i in range(len(xyz)):
        place, z = cell[i], xyz[i, 2]
        if not rises[place]:
            continue
        size[place] += 1
        if z >= limit[place]:
            above[place] += 1
            least[place] = min(least[place], z)
        else:
            rest[place] = max(rest[place], z)
    alone = rises & (above <= np.minimum(GROUP, GROUP_SHARE * size)) & (least - rest >= CELL_M)
    for i in range(len(xyz)):
        high[i] |= alone[cell[i]] and xyz[i, 2] >= limit[cell[i]]
