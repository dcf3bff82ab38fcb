"""Gross outliers: points far below or above everything near them (multipath, birds, clouds).

The stage finds them before any filter is asked, whichever that is, so what is one is defined here and is no
parameter of a method.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.geometry.neighbours import measure_spacing
from eaves.kernels import inlined_kernel, kernel
from eaves.model import Bounds, Mask, PointCloud, Points

CELL_M = 10.0
"""Side of the cells that are compared: 10 m, or ten spacings (about a hundred points) in thin data. A high
group lies as far above the rest of its cell, and no neighbour reaches as high: wires do."""
GROUP = 32
"""Most points of a cell that are looked at from either end."""
SHALLOW_GAP_M, SHALLOW_SHARE = 1.0, 0.25
"""A gap of 1 m parts at most half a group and a quarter of the cell from the rest: stray echoes."""
DEEP_GAP_M, DEEP_SHARE = 5.0, 0.4
"""A gap of 5 m parts at most four tenths of the cell from the rest: a mirror image of the ground."""


def find_outliers(cloud: PointCloud) -> tuple[Mask, Mask]:
    """Masks (N,) of low and of high outliers.

    The plane is cut into cells, and once more into cells shifted by half a side, so that a group is whole in
    one of them. A group is the lowest (highest) points of a cell that a gap parts from the rest. A small low
    group is an outlier when it lies a gap under the ground that the eight neighbours predict: their second
    lowest level, less the rise from there to their median (a slope repeats itself once more). A deep low
    group, which may spread over several cells, must lie a gap under all but six of the 24 cells around. A
    high group is an outlier when no neighbour has a point near its height. Cost: four passes over the
    points, 0.1 s per million.
    """
    xyz = cloud.xyz
    low, high = np.zeros(len(xyz), bool), np.zeros(len(xyz), bool)
    if len(xyz) < GROUP // 2:
        return low, high
    side, bounds = CELL_M * max(1.0, measure_spacing(xyz)), Bounds.of(xyz)
    for shift in (0.0, 0.5):
        # cells are fixed to the origin, not to the data
        west, south = (
            np.floor(bounds.west / side + shift) - shift,
            np.floor(bounds.south / side + shift) - shift,
        )
        columns, rows = int(bounds.east / side - west) + 1, int(bounds.north / side - south) + 1
        corner = np.array([west, south]) * side
        below, above = extremes_kernel(xyz, corner, side, rows, columns)
        mark_kernel(xyz, corner, side, *limits_kernel(below, above), low, high)
    return low, high & ~low


@kernel
def extremes_kernel(
    xyz: Points, corner: NDArray[np.float64], side: float, rows: int, columns: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The `GROUP` lowest z and lowest -z of each cell, sorted, and its count: (rows, columns, GROUP + 1)."""
    below = np.full((rows, columns, GROUP + 1), np.inf)
    above = np.full((rows, columns, GROUP + 1), np.inf)
    count = np.zeros((rows, columns))
    # the last of each group, side by side: most points are beyond it, and nothing else is looked at
    least, most = np.full((rows, columns), np.inf), np.full((rows, columns), np.inf)
    for i in range(len(xyz)):
        z = xyz[i, 2]
        row, column = int((xyz[i, 1] - corner[1]) / side), int((xyz[i, 0] - corner[0]) / side)
        count[row, column] += 1
        if z < least[row, column]:
            least[row, column] = keep_lowest(below[row, column], z)
        if -z < most[row, column]:
            most[row, column] = keep_lowest(above[row, column], -z)
    below[:, :, GROUP], above[:, :, GROUP] = count, count
    return below, above


@inlined_kernel
def keep_lowest(best: NDArray[np.float64], value: float) -> Any:
    """Sort a value into the first `GROUP` of a cell, which it is low enough for; the highest of them then."""
    k = GROUP - 1
    while k > 0 and best[k - 1] > value:
        best[k] = best[k - 1]
        k -= 1
    best[k] = value
    return best[GROUP - 1]


@kernel
def group_below(sorted_z: NDArray[np.float64], most: int, gap: float, level: float) -> int:
    """Points in the largest group of at most `most` that has a gap above it and lies under `level`."""
    for size in range(min(most, GROUP - 1), 0, -1):
        if sorted_z[size] - sorted_z[size - 1] >= gap and sorted_z[size - 1] <= level:
            return size
    return 0


@kernel
def limits_kernel(
    below: NDArray[np.float64], above: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Height of each cell (rows, columns) at and under which points are low, and at and over which high."""
    rows, columns = below.shape[0], below.shape[1]
    floor = np.full((rows, columns), -np.inf)
    ceiling = np.full((rows, columns), np.inf)
    near, wide = np.empty(8), np.empty(24)
    for row in range(rows):
        for column in range(columns):
            count = below[row, column, GROUP]
            if count == 0:
                continue
            close, far, top = 0, 0, -np.inf
            for r in range(max(0, row - 2), min(rows, row + 3)):
                for c in range(max(0, column - 2), min(columns, column + 3)):
                    if (r == row and c == column) or below[r, c, GROUP] == 0:
                        continue
                    wide[far] = below[r, c, 0]
                    far += 1
                    if abs(r - row) <= 1 and abs(c - column) <= 1:
                        near[close] = below[r, c, 0]
                        close += 1
                        top = max(top, -above[r, c, 0])
            if close < 3:
                continue
            around = np.sort(near[:close])
            level = 2 * around[1] - around[close // 2] - SHALLOW_GAP_M
            most = min(GROUP // 2, int(SHALLOW_SHARE * count))
            size = group_below(below[row, column], most, SHALLOW_GAP_M, level)
            level = np.sort(wide[:far])[far // 4] - DEEP_GAP_M
            most = int(DEEP_SHARE * count)
            size = max(size, group_below(below[row, column], most, DEEP_GAP_M, level))
            if size > 0:
                floor[row, column] = below[row, column, size - 1]
            most = min(GROUP // 2, int(SHALLOW_SHARE * count))
            size = group_below(above[row, column], most, CELL_M, -top - CELL_M)
            if size > 0:
                ceiling[row, column] = -above[row, column, size - 1]
    return floor, ceiling


@kernel
def mark_kernel(
    xyz: Points,
    corner: NDArray[np.float64],
    side: float,
    floor: NDArray[np.float64],
    ceiling: NDArray[np.float64],
    low: Mask,
    high: Mask,
) -> None:
    """Mark in `low` and `high` (N,) the points at or beyond the limits (rows, columns) of their cells."""
    lowest, highest = floor.max(), ceiling.min()
    for i in range(len(xyz)):
        if lowest < xyz[i, 2] < highest:
            continue
        row, column = int((xyz[i, 1] - corner[1]) / side), int((xyz[i, 0] - corner[0]) / side)
        if xyz[i, 2] <= floor[row, column]:
            low[i] = True
        if xyz[i, 2] >= ceiling[row, column]:
            high[i] = True
