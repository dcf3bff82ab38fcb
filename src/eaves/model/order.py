"""The keys that put points in canonical order, in one pass each over the points."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from eaves.model.arrays import Points

PER_METRE = 1000
"""Keys count millimetres."""
LARGEST_KEY = 2.0**62


@njit(cache=True, inline="always")
def millimetres(value: float, level: float) -> Any:
    """Whole millimetres over a level; a value that is not finite counts as 0."""
    return int(np.rint(((value if np.isfinite(value) else 0.0) - level) * PER_METRE))


@njit(cache=True)
def keys_kernel(xyz: Points) -> tuple[NDArray[np.int64], bool, bool]:
    """Keys (N,) that rise by 1 m cell, row by row, and inside a cell by y, x, z; whether 63 bits hold them,
    and whether they rise already.
    """
    count = len(xyz)
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for i in range(count):
        for axis in range(3):
            value = xyz[i, axis] if np.isfinite(xyz[i, axis]) else 0.0
            low[axis], high[axis] = min(low[axis], value), max(high[axis], value)
    west, south, bottom = np.floor(low[0]), np.floor(low[1]), np.floor(low[2])
    key, rising = np.empty(count, np.int64), True
    cells = (high[0] - west + 2.0) * (high[1] - south + 2.0)
    if not cells * PER_METRE**2 * (high[2] - bottom + 1.0) * PER_METRE < LARGEST_KEY:
        return key, False, False
    columns = millimetres(high[0], west) // PER_METRE + 1
    heights = millimetres(high[2], bottom) + 1
    for i in range(count):
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        x_mm, y_mm = millimetres(x, west), millimetres(y, south)
        cell = (y_mm // PER_METRE) * columns + x_mm // PER_METRE
        inside = (y_mm % PER_METRE) * PER_METRE + x_mm % PER_METRE
        key[i] = (cell * PER_METRE * PER_METRE + inside) * heights + millimetres(z, bottom)
        rising = rising and (i == 0 or key[i] >= key[i - 1])
    return key, True, rising
