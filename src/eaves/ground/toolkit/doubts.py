"""Places where a filter may err: ground that ends without a step, and what depends on where cells lie."""

from __future__ import annotations

import numpy as np

from eaves.ground.toolkit.floor import COARSEST_M
from eaves.kernels import kernel
from eaves.model import GRID_STEP, Bounds, Doubt, Integers, Mask, PointCloud, Points
from eaves.model.block import extremes
from eaves.model.scene import DOUBTFUL
from eaves.raster.grid import EMPTY, lowest_points, whole_cells
from eaves.raster.groups import group_cells, neighbour_pairs

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
    # whole numbers in floats, which divide several times as fast
    quanta = np.rint(cloud.xyz[:, :2] / GRID_STEP) + np.rint(np.divide(cloud.origin, GRID_STEP))
    cell = np.floor(quanta / round(COARSEST_M / GRID_STEP))
    low, high = extremes(cell)
    shape = int(high[0] - low[0]) + 1, int(high[1] - low[1]) + 1
    number = ((cell[:, 0] - low[0]) * shape[1] + cell[:, 1] - low[1]).astype(np.int64)
    total, unsure = (
        np.bincount(cells, minlength=shape[0] * shape[1]) for cells in (number, number[doubtful])
    )
    mask = (unsure > 0).reshape(shape)
    group, count = group_cells(mask, *neighbour_pairs(mask))
    area = np.bincount(group.ravel(), COARSEST_M**2 * unsure / np.maximum(total, 1), count + 1)
    home = group.ravel()[number[doubtful]]
    middle = np.zeros((count + 1, 2), np.int64)
    np.add.at(middle, home, quanta[doubtful].astype(np.int64))
    size = np.bincount(home, minlength=count + 1)
    doubts = []
    for k in np.flatnonzero(area >= LEAST_M2):
        x, y = (round(float(value) * GRID_STEP, 2) for value in middle[k] // size[k])
        if bounds.contains(np.array([[x, y]]))[0]:
            doubts.append(Doubt(x, y, round(float(area[k]), 1), REASON, "ground"))
    return tuple(doubts)
