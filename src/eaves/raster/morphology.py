"""Grey-scale morphology of rasters that may have empty cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from eaves.model import Grid


def disc(radius: int) -> NDArray[np.bool_]:
    """The cells within `radius` cells of the middle one, (2 r + 1, 2 r + 1)."""
    offset = np.arange(-radius, radius + 1)
    return np.asarray(offset[:, None] ** 2 + offset[None, :] ** 2 <= radius * radius)


def opened(values: Grid, radius: int) -> Grid:
    """The highest surface (H, W) under `values` that an octagon of about `radius` cells can touch everywhere.

    The octagon is a square after a diamond, each run over as one-dimensional filters; `values` holds no
    NaN. Beyond the rim the surface goes on as it ends.
    """
    return dilated(eroded(values, radius), radius)


def eroded(values: Grid, radius: int) -> Grid:
    """The lowest value within an octagon of about `radius` cells, (H, W)."""
    square, diamond = octagon_parts(radius)
    result = ndimage.minimum_filter(values, 2 * square + 1, mode="nearest") if square else values
    for _ in range(diamond):
        result = ndimage.minimum_filter(result, footprint=CROSS, mode="nearest")
    return np.asarray(result, np.float32)


def dilated(values: Grid, radius: int) -> Grid:
    """The highest value within an octagon of about `radius` cells, (H, W)."""
    return np.asarray(-eroded(-values, radius), np.float32)


CROSS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], bool)


def octagon_parts(radius: int) -> tuple[int, int]:
    """Half side of the square and steps of the diamond whose sum is nearest a disc of `radius` cells."""
    diamond = round(radius * (2 - 2**0.5))
    return radius - diamond, diamond
