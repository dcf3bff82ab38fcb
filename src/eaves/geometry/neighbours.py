"""Density and neighbourhoods of points."""

from __future__ import annotations

import numpy as np

from eaves.kernels import kernel
from eaves.model import Points

POINTS_PER_CELL = 8
"""Mean number of points in a cell that is occupied: of mean 8, one Poisson cell in 3,000 is empty."""
FINEST_M = 0.5
"""Side of the first cells that are tried; a power of two, so that counting is exact at every width."""
TABLE_CELLS = 64
"""Cells are counted in a table of no more cells for each point; points farther apart are rare, and sorted."""


def measure_spacing(xyz: Points) -> float:
    """Mean spacing (m) of points (N, 2 or 3) in plan: 1 / √density over the area where there are points.

    The area is counted in cells widened until the occupied ones hold `POINTS_PER_CELL` on average, so
    that gaps (water, the outside of an oblique scene) do not lower the density.
    """
    if len(xyz) < 2:
        return 1.0
    return float(spacing_kernel(xyz))


@kernel
def spacing_kernel(xyz: Points) -> float:
    """The spacing (m) as `measure_spacing` says."""
    count = len(xyz)
    west, south, east, north = np.inf, np.inf, -np.inf, -np.inf
    for i in range(count):
        west, east = min(west, xyz[i, 0]), max(east, xyz[i, 0])
        south, north = min(south, xyz[i, 1]), max(north, xyz[i, 1])
    side = FINEST_M
    occupied = np.zeros((0, 0), np.bool_)
    while True:
        columns, rows = int((east - west) / side) + 1, int((north - south) / side) + 1
        filled = 0
        if columns * rows > TABLE_CELLS * count:
            cell = np.empty(count, np.int64)
            for i in range(count):
                cell[i] = int((xyz[i, 1] - south) / side) * columns + int((xyz[i, 0] - west) / side)
            cell.sort()
            for i in range(count):
                filled += i == 0 or cell[i] != cell[i - 1]
        else:
            finer = occupied
            occupied = np.zeros((rows, columns), np.bool_)
            if finer.size == 0:
                for i in range(count):
                    occupied[int((xyz[i, 1] - south) / side), int((xyz[i, 0] - west) / side)] = True
            else:  # sides are powers of two: cells twice as wide hold four whole ones
                for row in range(finer.shape[0]):
                    for column in range(finer.shape[1]):
                        if finer[row, column]:
                            occupied[row // 2, column // 2] = True
            for row in range(rows):
                for column in range(columns):
                    filled += occupied[row, column]
        if count >= POINTS_PER_CELL * filled or filled == 1:
            return float(np.sqrt(filled * side * side / count))
        side *= 2.0
