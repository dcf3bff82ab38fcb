"""The lowest heights of a survey in cells fixed to the world: what is wide is looked for in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import kernel
from eaves.model import GRID_STEP, Bounds, Doubt, Grid, Integers, Mask, PointCloud, Points, Values
from eaves.model.block import extremes
from eaves.model.scene import DOUBTFUL
from eaves.raster.blur import group_cells, neighbour_pairs
from eaves.raster.grid import EMPTY, WorldGrids, lowest_points, whole_cells

FINEST_M = 1.5
"""Side of the finest cells: two of them are as wide as a way that a car takes. Fixed, for floors are kept
with their blocks before a method is asked, and squares of the world are whole multiples of all cells."""
COARSEST_M = 6.0
"""Side of the widest cells: they are doubled twice."""

RING, RING_SHARE = (3, 4), 6
"""A cell is compared with those 3 and 4 cells away, for a cluster of echoes meets three in a row. The
surface is as low as a sixth of them: roofs and crowns may fill the rest, other echoes not so much."""
PIT_DEPTH_M, ENOUGH_POINTS = 1.0, 2.5
"""See `Floor.heights` and `Floor.in_wide_cells`."""


@dataclass(frozen=True, eq=False)
class Floor(WorldGrids):
    """The lowest height of each cell (H, W), NaN where there is none, and how many points it has."""

    lowest: Grid
    count: NDArray[np.int32]

    def heights(self) -> Grid:
        """The height (H, W) of each cell: its lowest, or where that lies in a pit deeper than `PIT_DEPTH_M`,
        as echoes from below the ground and wells do, that of the surface around.
        """
        return without_pits(self.lowest, PIT_DEPTH_M)

    @classmethod
    def empty(cls, bounds: Bounds) -> Floor:
        """No points, in the finest cells that hold `bounds` (world metres)."""
        west, south, east, north = (
            int(np.floor(round(value / GRID_STEP) / QUANTA))
            for value in (bounds.west, bounds.south, bounds.east, bounds.north)
        )
        shape = north - south + 1, east - west + 1
        return cls(west, north, FINEST_M, np.full(shape, np.nan, np.float32), np.zeros(shape, np.int32))

    @classmethod
    def of(cls, cloud: PointCloud) -> Floor:
        """The floor of a cloud of at least one point."""
        floor = cls.empty(cloud.bounds.translated(*cloud.origin))
        corner = [round(value / GRID_STEP) for value in cloud.origin]
        floor.add(cloud.xyz, 1.0 / GRID_STEP, corner)
        return floor

    def add(self, xyz: Points | NDArray[np.int32], scale: float, corner: Sequence[int]) -> None:
        """Lower the cells to points (N, 3) that are whole quanta about `corner` (quanta) once multiplied by
        `scale`; those outside are left out. Only for who made the floor.
        """
        add_kernel(xyz, scale, corner[0], corner[1], self.west, self.north, self.lowest, self.count)

    def merge(self, other: Floor) -> None:
        """Take in what another floor of the same cells knows of the ground they share."""
        rows, columns = self.shape
        above, left = self.north - other.north, other.west - self.west
        r0, r1 = max(0, above), min(rows, above + other.shape[0])
        c0, c1 = max(0, left), min(columns, left + other.shape[1])
        if r0 >= r1 or c0 >= c1:
            return
        source = np.s_[r0 - above : r1 - above, c0 - left : c1 - left]
        target = np.s_[r0:r1, c0:c1]
        self.lowest[target] = np.fmin(self.lowest[target], other.lowest[source])
        self.count[target] += other.count[source]

    def doubled(self) -> Floor:
        """The same in cells twice as wide."""
        top, left = (self.north + 1) % 2, self.west % 2
        rows, columns = self.shape
        bottom, right = (rows + top) % 2, (columns + left) % 2
        pad = ((top, bottom), (left, right))
        shape = (rows + top + bottom) // 2, 2, (columns + left + right) // 2, 2
        lowest = np.pad(self.lowest, pad, constant_values=np.nan).reshape(shape)
        count = np.pad(self.count, pad).reshape(shape)
        return Floor(
            self.west // 2,
            self.north // 2,
            2.0 * self.cell,
            np.fmin.reduce(lowest, axis=(1, 3)),
            count.sum(axis=(1, 3), dtype=np.int32),
        )

    def in_wide_cells(self) -> Floor:
        """The same in cells so wide that half of those that hold points hold more than `ENOUGH_POINTS`."""
        floor = self
        while floor.cell < COARSEST_M:
            points = floor.count[floor.count > 0]
            if len(points) == 0 or np.median(points) > ENOUGH_POINTS:
                break
            floor = floor.doubled()
        return floor

    def in_shifted_cells(self, times: int, right: int, up: int) -> Floor:
        """The same in cells `times` (1, 2 or 4) as wide, their borders `right` and `up` cells to the west and
        south of where they are else: they are counted as if the origin of the world lay there.
        """
        floor = self.with_(west=self.west + right, north=self.north + up)
        for _ in range(times.bit_length() - 1):
            floor = floor.doubled()
        return floor

    def with_(self, **changes: object) -> Floor:
        """A copy with some fields replaced."""
        return replace(self, **changes)  # type: ignore[arg-type]


QUANTA = round(FINEST_M / GRID_STEP)
"""Quanta a finest cell."""


@kernel
def add_kernel(
    xyz: Points,
    scale: float,
    right: int,
    up: int,
    west: int,
    north: int,
    lowest: Grid,
    count: NDArray[np.int32],
) -> None:
    """Lower the cells (H, W) to the points (N, 3)."""
    rows, columns = lowest.shape
    for i in range(len(xyz)):
        column = (np.int64(np.rint(xyz[i, 0] * scale)) + right) // QUANTA - west
        row = north - (np.int64(np.rint(xyz[i, 1] * scale)) + up) // QUANTA
        if row < 0 or column < 0 or row >= rows or column >= columns:
            continue
        z = np.float32(np.rint(xyz[i, 2] * scale) * GRID_STEP)
        count[row, column] += 1
        if not (lowest[row, column] <= z):
            lowest[row, column] = z


def ring_of(least: int, most: int) -> Integers:
    """Rows and columns (K, 2) of the cells that lie `least` to `most` cells away."""
    row, column = np.indices((2 * most + 1, 2 * most + 1)).reshape(2, -1) - most
    away = np.hypot(row, column)
    return np.column_stack([row, column])[(away >= least) & (away < most + 0.5)]


@kernel
def level_around(lowest: Values, cell: int, steps: Integers, depth: float, around: Values) -> float:
    """The level that the surface around a cell (of those in a row) has there; -inf where that is no more than
    `depth` (m) over its lowest point, or unknown.

    A slope goes on: a cell of the ring, `steps` (K,) of cells away, counts as high as the surface is halfway
    to the cell across, but no higher than where what falls from it to the cell twice as far leads back to. A
    plane is met as it is. `around` (K,) is written to.
    """
    count, as_low, least = 0, 0, lowest[cell] + depth
    for k in range(len(steps)):
        z = lowest[cell + steps[k]]
        if z == np.inf:
            continue
        beyond, across = lowest[cell + 2 * steps[k]], lowest[cell - steps[k]]
        z += max(0.0, min(z - beyond, 0.5 * (across - z)))
        around[count] = z
        count += 1
        as_low += z <= least
        if as_low > len(steps) // RING_SHARE:
            return -np.inf
    if count == 0:
        return -np.inf
    level = float(np.sort(around[:count])[count // RING_SHARE])
    return level if level > least else -np.inf


@kernel
def empty_around(rows: int, columns: int, away: int) -> Values:
    """Heights of cells (rows + 2 away, columns + 2 away), inf everywhere: cells, and none as far around."""
    return np.full((rows + 2 * away, columns + 2 * away), np.inf)


def without_pits(heights: Grid, depth: float) -> Grid:
    """A surface (H, W), NaN where there is none, raised to what is around where it lies deeper than `depth`
    (m) in a pit narrower than the ring: no more than what is wide needs to know."""
    return np.asarray(fill_kernel(np.nan_to_num(heights, nan=np.inf), ring_of(*RING), depth), np.float32)


@kernel
def fill_kernel(lowest: Grid, ring: Integers, depth: float) -> Values:
    """The surface (rows, columns), inf where there is none, without pits, and NaN for inf. A round judges the
    cells near those that changed, all on the same surface.
    """
    (rows, columns), away, look = lowest.shape, 2 * ring.max(), np.ones(lowest.shape, np.bool_)
    wide = empty_around(rows, columns, away)
    filled, flat = wide[away : away + rows, away : away + columns], wide.ravel()
    filled[:] = lowest
    steps, around = ring[:, 0] * wide.shape[1] + ring[:, 1], np.empty(len(ring))
    pit, level, count = np.empty((rows * columns, 2), np.int32), np.empty(rows * columns), 1
    while count > 0:
        count = 0
        for row in range(rows):
            for column in range(columns):
                if not look[row, column] or filled[row, column] == np.inf:
                    continue
                look[row, column] = False
                cell = (row + away) * wide.shape[1] + column + away
                level[count] = level_around(flat, cell, steps, depth, around)
                if level[count] > -np.inf:
                    pit[count] = row, column
                    count += 1
        for k in range(count):
            row, column = pit[k]
            filled[row, column] = level[k]
            top, left = max(0, row - away), max(0, column - away)
            look[top : row + away + 1, left : column + away + 1] = True
    return np.where(filled == np.inf, np.nan, filled)


LEAST_M2 = 50.0
"""Terrain in doubt of less area (m²) is not said: a car, the foot of a hedge."""

REASON = "ground or object: no step in height bounds it, or the result depends on where the grid lies"


def edges_without_step(xyz: Points, ground: Mask, cell: float, step: float) -> Mask:
    """The points (N,) in cells of a side (m) beside each other, of which the lowest of one is ground and that
    of the other is not, though they differ by `step` (m) or less.

    Objects end in walls, and terrain ends nowhere: where there is none, one of the two was misjudged.
    """
    cells = whole_cells(Bounds.of(xyz), cell)
    number = lowest_points(xyz, cells, cell)
    return np.asarray(edges_kernel(xyz, number, ground, cells.west, cells.north, cell, step))


@kernel
def edges_kernel(
    xyz: Points, number: Integers, ground: Mask, west: float, north: float, cell: float, step: float
) -> Mask:
    """The points (N,) of `edges_without_step`, of which those numbered are the lowest of the cells (H, W)."""
    (rows, columns), open_ = number.shape, np.zeros(number.shape, np.bool_)
    for row in range(rows):
        for column in range(columns):
            a = number[row, column]
            for r, c in ((row, column + 1), (row + 1, column)):
                if a == EMPTY or r == rows or c == columns or number[r, c] == EMPTY:
                    continue
                b = number[r, c]
                if ground[a] != ground[b] and abs(xyz[a, 2] - xyz[b, 2]) <= step:
                    open_[row, column] = open_[r, c] = True
    marked = np.empty(len(xyz), np.bool_)
    for i in range(len(xyz)):
        row, column = int((north - xyz[i, 1]) / cell), int((xyz[i, 0] - west) / cell)
        marked[i] = open_[row, column]
    return marked


def doubts_within(cloud: PointCloud, bounds: Bounds) -> tuple[Doubt, ...]:
    """One doubt for each group of cells of `COARSEST_M` of the world that hold doubtful points, as large
    as their share of the points; those with their middle in `bounds` (world metres) and of `LEAST_M2` or
    more.

    Cells are fixed to the world, so blocks and tiles have the same.
    """
    doubtful = np.zeros(0, np.int64) if cloud.part is None else np.flatnonzero(cloud.part == DOUBTFUL)
    if len(doubtful) == 0:
        return ()
    corner, side = np.rint(np.divide(cloud.origin, GRID_STEP)), float(round(COARSEST_M / GRID_STEP))
    quanta = np.rint(cloud.xyz.take(doubtful, axis=0)[:, :2] / GRID_STEP) + corner
    cell = np.floor(quanta / side)
    low, high = extremes(cell)
    total = np.zeros((int(high[0] - low[0]) + 1, int(high[1] - low[1]) + 1), np.int64)
    count_kernel(cloud.xyz, *corner.tolist(), *low.tolist(), side, total)
    number = np.ravel_multi_index(tuple((cell - low).astype(np.int64).T), total.shape)
    unsure = np.bincount(number, minlength=total.size)
    mask = (unsure > 0).reshape(total.shape)
    group, count = group_cells(mask, *neighbour_pairs(mask))
    area = np.bincount(group.ravel(), COARSEST_M**2 * unsure / np.maximum(total.ravel(), 1), count + 1)
    home = group.ravel()[number]
    middle = np.zeros((count + 1, 2), np.int64)
    np.add.at(middle, home, quanta.astype(np.int64))
    size = np.bincount(home, minlength=count + 1)
    doubts = []
    for k in np.flatnonzero(area >= LEAST_M2):
        x, y = (round(float(value) * GRID_STEP, 2) for value in middle[k] // size[k])
        if bounds.contains(np.array([[x, y]]))[0]:
            doubts.append(Doubt(x, y, round(float(area[k]), 1), REASON, "ground"))
    return tuple(doubts)


@kernel
def count_kernel(
    xyz: Points, right: float, up: float, west: float, south: float, side: float, total: Integers
) -> None:
    """Count the points (N, 3), moved by whole quanta, in cells (columns, rows) of a side (quanta), numbered
    from the first in the west and south."""
    columns, rows = total.shape
    for i in range(len(xyz)):
        # whole numbers in floats, which divide several times as fast
        column = int(np.floor((np.rint(xyz[i, 0] / GRID_STEP) + right) / side) - west)
        row = int(np.floor((np.rint(xyz[i, 1] / GRID_STEP) + up) / side) - south)
        if 0 <= column < columns and 0 <= row < rows:
            total[column, row] += 1
