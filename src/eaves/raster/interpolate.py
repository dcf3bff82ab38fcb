"""Cells without a value get one from the cells that have."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from eaves.geometry.tin import Tin
from eaves.model import Grid, Mask, Raster, Values
from eaves.raster.nearest import ADJOINING, near_cells, nearest_cells, places


def fill_nearest(raster: Raster, within: float = np.inf) -> Raster:
    """Empty cells take the value of the nearest filled cell, if it is at most `within` (m) away."""
    known = np.isfinite(raster.values)
    if known.all() or not known.any():
        return raster
    rows, columns = np.nonzero(~known)
    row, column = nearest_cells(known, rows, columns)
    near = np.hypot(row - rows, column - columns) * raster.cell <= within
    values = raster.values.copy()
    values[rows[near], columns[near]] = raster.values[row[near], column[near]]
    return raster.with_(values=values)


def fill_linear(raster: Raster) -> Raster:
    """Empty cells take the height of the Delaunay triangle of filled cells they lie in, or the nearest
    outside the hull.
    """
    known = np.isfinite(raster.values)
    if known.all() or not known.any():
        return raster
    rim = known & near_cells(~known, ADJOINING)
    filled = raster.values.copy()
    filled[~known] = interpolate_cells(raster.values, rim, ~known)
    return raster.with_(values=filled)


def fill_linear_twice(raster: Raster, richer: Raster) -> tuple[Raster, Raster]:
    """A raster and a richer one, in which more of the same cells are filled or their values are others, both
    filled as `fill_linear` does: the cells that only the second has join the triangles of the first.
    """
    known, more = np.isfinite(raster.values), np.isfinite(richer.values)
    if known.all() or not known.any() or more.all():
        return fill_linear(raster), fill_linear(richer)
    rim, second_rim = (cells & near_cells(~cells, ADJOINING) for cells in (known, more))
    rows, columns = np.concatenate([np.nonzero(rim), np.nonzero(second_rim & ~known)], axis=1)
    count = np.count_nonzero(rim)
    tin = Tin(places(rows, columns), np.arange(count))

    def filled(one: Raster, around: Mask, wanted: Mask) -> Raster:
        values = one.values.copy()
        heights = one.values[rows, columns].astype(np.float64)
        values[wanted] = interpolate_in(tin, heights, one.values, around, wanted)
        return one.with_(values=values)

    first = filled(raster, rim, ~known)
    tin.insert(np.arange(count, len(rows)))
    return first, filled(richer, second_rim, ~more)


def interpolate_cells(values: Grid, known: Mask, wanted: Mask) -> Grid:
    """Values (K,) at the wanted cells (H, W), linear between the known cells (H, W) of `values` (H, W)."""
    known_rows, known_columns = np.nonzero(known)
    heights = values[known_rows, known_columns].astype(np.float64)
    return interpolate_in(Tin(places(known_rows, known_columns)), heights, values, known, wanted)


def interpolate_in(tin: Tin, heights: Values, values: Grid, known: Mask, wanted: Mask) -> Grid:
    """Values (K,) at the wanted cells (H, W) of a TIN of cells with heights (N,); beyond its hull those of
    the nearest known cell (H, W) of `values` (H, W)."""
    rows, columns = np.nonzero(wanted)
    result = tin.interpolate(heights, places(rows, columns)).astype(np.float32)
    outside = np.flatnonzero(~np.isfinite(result))
    if len(outside):
        result[outside] = values[nearest_cells(known, rows[outside], columns[outside])]
    return result


def fill_smooth(values: Grid) -> Grid:
    """Empty cells (H, W) take the mean of ever wider neighbourhoods, blended: rough, and fast.

    Means of 2 by 2 cells, and of those, until none is empty; then each level fills the finer one bilinearly.
    """
    known = np.isfinite(values)
    if known.all() or not known.any():
        return values
    coarse = fill_smooth(halve(values))
    fine = ndimage.zoom(coarse, 2, order=1, mode="nearest", grid_mode=True)
    return np.where(known, values, fine[: values.shape[0], : values.shape[1]]).astype(np.float32)


def halve(values: Grid) -> Grid:
    """Means of the filled cells in squares of 2 by 2, NaN where all are empty."""
    rows, columns = values.shape
    even = np.full((rows + rows % 2, columns + columns % 2), np.nan, np.float32)
    even[:rows, :columns] = values
    known = np.isfinite(even)
    total = np.where(known, even, 0.0).reshape(even.shape[0] // 2, 2, -1, 2).sum(axis=(1, 3))
    count = known.reshape(even.shape[0] // 2, 2, -1, 2).sum(axis=(1, 3))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan).astype(np.float32)
