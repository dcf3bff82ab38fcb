"""Density and neighbourhoods of points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import kernel
from eaves.model import Bounds, Mask, Points, Values

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
    extent = Bounds.of(xyz)
    side = FINEST_M
    occupied = np.zeros((0, 0), bool)
    while True:
        columns, rows = int(extent.width / side) + 1, int(extent.height / side) + 1
        if columns * rows > TABLE_CELLS * len(xyz):
            cell = cells_kernel(xyz[:, 0], xyz[:, 1], extent.west, extent.south, side, columns)
            count = len(np.unique(cell))
        else:
            # sides are powers of two: cells twice as wide hold four whole ones
            fresh = occupied.size == 0
            occupied = (
                occupied_kernel(xyz, extent.west, extent.south, side, rows, columns)
                if fresh
                else halve(occupied)
            )
            count = int(np.count_nonzero(occupied))
        if len(xyz) >= POINTS_PER_CELL * count or count == 1:
            return float(np.sqrt(count * side * side / len(xyz)))
        side *= 2.0


def halve(occupied: Mask) -> Mask:
    """Whether any of the four cells (H, W) that make a cell twice as wide is set."""
    rows, columns = occupied.shape
    even = np.zeros((rows + rows % 2, columns + columns % 2), bool)
    even[:rows, :columns] = occupied
    return np.asarray(even[::2, ::2] | even[1::2, ::2] | even[::2, 1::2] | even[1::2, 1::2])


@kernel
def occupied_kernel(xyz: Points, west: float, south: float, side: float, rows: int, columns: int) -> Mask:
    """Which cells (rows, columns) hold a point, row by row from the south."""
    occupied = np.zeros((rows, columns), np.bool_)
    for i in range(len(xyz)):
        occupied[int((xyz[i, 1] - south) / side), int((xyz[i, 0] - west) / side)] = True
    return occupied


@kernel
def cells_kernel(
    x: Values, y: Values, west: float, south: float, side: float, columns: int
) -> NDArray[np.int64]:
    """Number (N,) of the cell of each point, row by row from the south."""
    cell = np.empty(len(x), np.int64)
    for i in range(len(x)):
        cell[i] = int((y[i] - south) / side) * columns + int((x[i] - west) / side)
    return cell
