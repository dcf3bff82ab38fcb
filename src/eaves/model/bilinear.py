"""Values between the middles of raster cells."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from eaves.model.arrays import Points, Values


@njit(cache=True)
def bilinear_kernel(values: NDArray[Any], west: float, north: float, cell: float, xy: Points) -> Values:
    """Bilinear values (N,) of a raster (H, W) at points (N, 2 or 3), NaN at those without coordinates."""
    rows, columns = values.shape
    found = np.empty(len(xy))
    for i in range(len(xy)):
        x, y = (xy[i, 0] - west) / cell - 0.5, (north - xy[i, 1]) / cell - 0.5
        if np.isnan(x) or np.isnan(y):
            found[i] = np.nan
            continue
        x, y = min(max(x, 0.0), columns - 1.0), min(max(y, 0.0), rows - 1.0)
        column, row = min(int(x), max(columns - 2, 0)), min(int(y), max(rows - 2, 0))
        east, south = min(column + 1, columns - 1), min(row + 1, rows - 1)
        fx, fy = x - column, y - row
        top = values[row, column] * (1.0 - fx) + values[row, east] * fx
        bottom = values[south, column] * (1.0 - fx) + values[south, east] * fx
        found[i] = top * (1.0 - fy) + bottom * fy
    return found
