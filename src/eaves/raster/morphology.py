"""Grey-scale morphology of rasters, with square windows."""

from __future__ import annotations

import numpy as np
from numba import njit

from eaves.model import Grid


def opened(values: Grid, radius: int) -> Grid:
    """The highest surface (H, W) under `values` that a square of 2 `radius` + 1 cells touches everywhere.

    `values` holds no NaN. Beyond the rim the surface goes on as it ends.
    """
    down = lowest_along_columns_kernel(np.ascontiguousarray(values, np.float32), radius)
    across = lowest_along_columns_kernel(np.ascontiguousarray(down.T), radius)
    across = lowest_along_columns_kernel(-across, radius)
    return np.asarray(-lowest_along_columns_kernel(np.ascontiguousarray(across.T), radius))


@njit(cache=True)
def lowest_along_columns_kernel(values: Grid, radius: int) -> Grid:
    """The lowest value within `radius` rows of each cell (H, W), three comparisons a cell (van Herk 1992).

    Rows are cut into blocks as long as the window. A window covers the end of one block and the start of the
    next, so its minimum is that of two running minima. The inner loops go along rows, which a processor does
    several cells at a time.
    """
    rows, columns = values.shape
    width = 2 * radius + 1
    blocks = (rows + 2 * radius + width - 1) // width
    ahead = np.full((blocks * width, columns), np.inf, np.float32)
    ahead[radius : radius + rows] = values
    behind = ahead.copy()
    for block in range(blocks):
        for row in range(block * width + 1, (block + 1) * width):
            here, before = behind[row], behind[row - 1]
            for column in range(columns):
                here[column] = here[column] if here[column] < before[column] else before[column]
        for row in range((block + 1) * width - 2, block * width - 1, -1):
            here, after = ahead[row], ahead[row + 1]
            for column in range(columns):
                here[column] = here[column] if here[column] < after[column] else after[column]
    lowest = np.empty((rows, columns), np.float32)
    for row in range(rows):
        first, last, out = ahead[row], behind[row + width - 1], lowest[row]
        for column in range(columns):
            out[column] = first[column] if first[column] < last[column] else last[column]
    return lowest
