"""Cells without a value get one from the cells that have."""

from __future__ import annotations

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from eaves.geometry.tin import Tin
from eaves.model import Grid, Mask, Points, Raster, Values


def fill_nearest(raster: Raster, within: float = np.inf) -> Raster:
    """Empty cells take the value of the nearest filled cell, if it is at most `within` (m) away."""
    known = np.isfinite(raster.values)
    if known.all() or not known.any():
        return raster
    distance, source = ndimage.distance_transform_edt(~known, sampling=raster.cell, return_indices=True)
    values = raster.values[source[0], source[1]]
    return raster.with_(values=np.where(distance <= within, values, np.nan).astype(np.float32))


def fill_linear(raster: Raster) -> Raster:
    """Empty cells take the height of the Delaunay triangle of filled cells they lie in, or the nearest
    outside the hull.
    """
    known = np.isfinite(raster.values)
    if known.all() or not known.any():
        return raster
    rim = known & ndimage.binary_dilation(~known, np.ones((3, 3), bool))
    rows, columns = np.nonzero(rim)
    filled = raster.values.copy()
    filled[~known] = interpolate_cells(
        np.c_[columns, -rows].astype(np.float64), raster.values[rim].astype(np.float64), ~known
    )
    return raster.with_(values=filled)


def interpolate_cells(xy: Points, heights: Values, wanted: Mask) -> Grid:
    """Heights at the wanted cells (H, W), as (K,), linear between points (N, 2) given in columns and minus
    rows.
    """
    rows, columns = np.nonzero(wanted)
    target = np.c_[columns, -rows].astype(np.float64)
    values = Tin(xy).interpolated(heights, target)
    outside = ~np.isfinite(values)
    if outside.any():
        values[outside] = heights[cKDTree(xy).query(target[outside])[1]]
    return values.astype(np.float32)
