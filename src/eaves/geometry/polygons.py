"""Polygons: made valid, made single."""

from __future__ import annotations

import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from eaves.geometry.tolerance import COORDINATE_STEP


def polygon_parts(shape: BaseGeometry, grid: float = COORDINATE_STEP) -> list[Polygon]:
    """The valid polygons a shape consists of, with coordinates on the grid (m); none for points and lines."""
    whole = shapely.set_precision(shapely.make_valid(shape), grid)
    return [
        piece
        for part in shapely.get_parts(whole)
        for piece in shapely.get_parts(part)  # a collection may hold a multipolygon
        if piece.geom_type == "Polygon" and piece.area > 0
    ]


def as_polygon(shape: BaseGeometry, grid: float = COORDINATE_STEP) -> Polygon | None:
    """The largest valid polygon of a shape with coordinates on the grid (m), or None when it has no area."""
    return max(polygon_parts(shape, grid), key=lambda part: part.area, default=None)
