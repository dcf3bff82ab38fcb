"""Polygons: made valid, made single."""

from __future__ import annotations

import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from eaves.geometry.tolerance import COORDINATE_STEP


def as_polygon(shape: BaseGeometry, grid: float = COORDINATE_STEP) -> Polygon | None:
    """The largest valid polygon of a shape with coordinates on the grid (m), or None when it has no area."""
    whole = shapely.set_precision(shapely.make_valid(shape), grid)
    parts = [part for part in shapely.get_parts(whole) if part.geom_type == "Polygon" and part.area > 0]
    return max(parts, key=lambda part: part.area) if parts else None
