"""Grey-scale morphology of rasters, with square windows."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from eaves.model import Grid


def opened(values: Grid, radius: int) -> Grid:
    """The highest surface (H, W) under `values` that a square of 2 `radius` + 1 cells touches everywhere.

    `values` holds no NaN. Beyond the rim the surface goes on as it ends.
    """
    return dilated(eroded(values, radius), radius)


def closed(values: Grid, radius: int) -> Grid:
    """The lowest surface (H, W) over `values` that a square of 2 `radius` + 1 cells touches everywhere."""
    return eroded(dilated(values, radius), radius)


def eroded(values: Grid, radius: int) -> Grid:
    """The lowest value within `radius` cells along rows and columns, (H, W)."""
    return np.asarray(ndimage.minimum_filter(values, 2 * radius + 1, mode="nearest"), np.float32)


def dilated(values: Grid, radius: int) -> Grid:
    """The highest value within `radius` cells along rows and columns, (H, W)."""
    return np.asarray(ndimage.maximum_filter(values, 2 * radius + 1, mode="nearest"), np.float32)
