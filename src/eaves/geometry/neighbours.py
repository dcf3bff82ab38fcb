"""Density and neighbourhoods of points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.model import Points

POINTS_PER_CELL = 8
"""A cell this full tells occupied from empty ground: of mean 8, one Poisson cell in 3,000 is empty."""


def measure_spacing(xyz: Points) -> float:
    """Mean spacing (m) of points (N, 2 or 3) in plan: 1 / √density over the area where there are points.

    The area is counted in cells widened until the occupied ones hold `POINTS_PER_CELL` on average, so
    that gaps (water, the outside of an oblique scene) do not thin the answer.
    """
    if len(xyz) < 2:
        return 1.0
    x, y = xyz[:, 0] - xyz[:, 0].min(), xyz[:, 1] - xyz[:, 1].min()
    side = 0.5
    while True:
        column, row = (x / side).astype(np.int64), (y / side).astype(np.int64)
        occupied = count_different(row * (int(column.max()) + 1) + column)
        if len(xyz) >= POINTS_PER_CELL * occupied or occupied == 1:
            return float(np.sqrt(occupied * side * side / len(xyz)))
        side *= 2.0


def count_different(keys: NDArray[np.int64]) -> int:
    """How many different values there are among keys (N,) ≥ 0; a table where it is not much larger than N."""
    top = int(keys.max()) + 1
    if top > 64 * len(keys):
        return len(np.unique(keys))
    seen = np.zeros(top, bool)
    seen[keys] = True
    return int(np.count_nonzero(seen))
