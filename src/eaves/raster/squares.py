"""Masks of cells grown, shrunk, opened and closed by squares, a row at a time: scipy goes cell by cell."""

from __future__ import annotations

import numpy as np

from eaves.model import Mask


def grown_by_square(mask: Mask, size: int) -> Mask:
    """The cells (H, W) that a square of `size` cells about one of a mask (H, W) covers."""
    return any_near(mask, size // 2 - size + 1, size // 2)


def shrunk_by_square(mask: Mask, size: int) -> Mask:
    """The cells (H, W) about which a square of `size` cells lies in a mask (H, W), and in the raster."""
    inside = ~any_near(~mask, -(size // 2), size - 1 - size // 2)
    for axis in (0, 1):
        line = np.moveaxis(inside, axis, 0)
        line[: size // 2] = False
        line[max(0, len(line) - (size - 1 - size // 2)) :] = False
    return inside


def opened_by_square(mask: Mask, size: int) -> Mask:
    """The cells (H, W) of a mask that squares of `size` cells within it cover."""
    return grown_by_square(shrunk_by_square(mask, size), size)


def closed_by_square(mask: Mask, size: int) -> Mask:
    """The cells (H, W) that a mask grown by squares of `size` cells keeps when it is shrunk by them."""
    return shrunk_by_square(grown_by_square(mask, size), size)


def any_near(mask: Mask, first: int, last: int) -> Mask:
    """Mask (H, W) of the cells that have a set cell of a mask `first` to `last` rows, and columns, away."""
    for axis in (0, 1):
        grown = np.zeros(mask.shape, bool)
        line, source = np.moveaxis(grown, axis, 0), np.moveaxis(mask, axis, 0)
        for step in range(max(first, -len(line)), min(last, len(line)) + 1):
            line[max(0, -step) : len(line) - max(0, step)] |= source[max(0, step) : len(line) + min(0, step)]
        mask = grown
    return mask
