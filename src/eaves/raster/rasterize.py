"""Polygons burnt into raster cells."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rasterio import Affine, features
from shapely import Polygon

from eaves.model import Bounds, Raster


def rasterize(polygons: Sequence[Polygon], bounds: Bounds, cell: float) -> Raster:
    """1 in every cell whose centre lies in a polygon, else 0; `bounds` run along cell borders."""
    shape = (round(bounds.height / cell), round(bounds.width / cell))
    values = np.zeros(shape, np.float32)
    if polygons:
        features.rasterize(
            ((polygon, 1) for polygon in polygons),
            out=values,
            transform=Affine(cell, 0.0, bounds.west, 0.0, -cell, bounds.north),
        )
    return Raster(values, bounds.west, bounds.north, cell)
