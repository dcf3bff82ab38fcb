"""Density and neighbourhoods of points."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from eaves.model import Bounds, Points, Values

POINTS_PER_CELL = 8
"""A cell this full tells occupied from empty ground: of mean 8, one Poisson cell in 3,000 is empty."""


def measure_spacing(xyz: Points) -> float:
    """Mean spacing (m) of points (N, 2 or 3) in plan: 1 / √density over the area where there are points.

    The area is counted in cells widened until the occupied ones hold `POINTS_PER_CELL` on average, so
    that gaps (water, the outside of an oblique scene) do not thin the answer.
    """
    if len(xyz) < 2:
        return 1.0
    extent = Bounds.of(xyz)
    side = 0.5
    while True:
        columns, rows = int(extent.width / side) + 1, int(extent.height / side) + 1
        cell = cells_kernel(xyz[:, 0], xyz[:, 1], extent.west, extent.south, side, columns)
        occupied = count_different(cell, rows * columns)
        if len(xyz) >= POINTS_PER_CELL * occupied or occupied == 1:
            return float(np.sqrt(occupied * side * side / len(xyz)))
        side *= 2.0


def count_different(keys: NDArray[np.int64], top: int) -> int:
    """How many different values under `top` there are among keys (N,) ≥ 0; by a table where it is not much
    larger than N."""
    if top > 64 * len(keys):
        return len(np.unique(keys))
    seen = np.zeros(top, bool)
    seen[keys] = True
    return int(np.count_nonzero(seen))


@njit(cache=True)
def cells_kernel(
    x: Values, y: Values, west: float, south: float, side: float, columns: int
) -> NDArray[np.int64]:
    """Number (N,) of the cell of each point, row by row from the south."""
    cell = np.empty(len(x), np.int64)
    for i in range(len(x)):
        cell[i] = int((y[i] - south) / side) * columns + int((x[i] - west) / side)
    return cell
