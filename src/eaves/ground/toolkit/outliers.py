"""Gross outliers: late echoes under the ground (multipath), and points far above all (birds, clouds).

The stage finds them before any filter is asked, whichever that is, so what is one is defined here and is no
parameter of a method.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eaves.geometry.neighbours import TABLE_CELLS, measure_spacing
from eaves.ground.toolkit.floor import RING, empty_around, level_around, ring_of
from eaves.ground.toolkit.seeds import Opening, lowest_surface, terrain_of
from eaves.kernels import inlined_kernel, kernel
from eaves.model import Bounds, Integers, Mask, PointCloud, Points, Values

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
    low = under_terrain(xyz, low, max(SIDE_M, reach), DEPTH_M * wide**2)
    for shift in (0.0, 0.5):
        mark_high_kernel(xyz, *cells_of(bounds, CELL_M * max(1.0, spacing), shift), high)
    return low, high & ~low


def side_within(bounds: Bounds, side: float, count: int) -> float:
    """A side (m), doubled until the table of cells fits some number of points: points far apart are rare."""
    while (bounds.width / side + 2.0) * (bounds.height / side + 2.0) > TABLE_CELLS * count:
        side *= 2.0
    return side


def under_terrain(xyz: Points, low: Mask, side: float, depth: float) -> Mask:
    """Those of the low points (N,) that lie more than `depth` (m) under the terrain that an opening of the
    others leaves in cells of a side (m)."""
    others, number = xyz.take(np.flatnonzero(~low), axis=0), np.flatnonzero(low)
    if len(number) == 0 or len(others) == 0:
        return low
    bounds, rules = Bounds.of(xyz), Opening()
    side = side_within(bounds, side, len(xyz))
    lowest = lowest_surface(others, bounds, side, np.zeros(len(others), bool))
    terrain = terrain_of(lowest, rules)
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
    top, level = -empty_around(rows, columns, 1), np.full((rows, columns), np.inf)
    for i in range(len(xyz)):
        row, column = place_of(xyz, i, corner, side)
        top[row + 1, column + 1] = max(top[row + 1, column + 1], xyz[i, 2])
    for row in range(rows):
        for column in range(columns):
            around = top[row : row + 3, column : column + 3].copy()
            around[1, 1] = -np.inf
            if (around > -np.inf).sum() >= 3:
                level[row, column] = around.max() + CELL_M
    if not (top[1:-1, 1:-1] >= level).any():
        return
    size, above = np.zeros((rows, columns)), np.zeros((rows, columns))
    least, rest = np.full((rows, columns), np.inf), np.full((rows, columns), -np.inf)
    for i in range(len(xyz)):
        place, z = place_of(xyz, i, corner, side), xyz[i, 2]
        size[place] += 1
        if z >= level[place]:
            above[place] += 1
            least[place] = min(least[place], z)
        else:
            rest[place] = max(rest[place], z)
    alone = (above <= np.minimum(GROUP, GROUP_SHARE * size)) & (least - rest >= CELL_M)
    for i in range(len(xyz)):
        place = place_of(xyz, i, corner, side)
        high[i] |= alone[place] and xyz[i, 2] >= level[place]
