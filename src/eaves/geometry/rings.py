"""Rings and polygons: area, direction, loops, and polygons from shapes."""

from __future__ import annotations

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from eaves.geometry.tolerance import COORDINATE_STEP
from eaves.model import Integers, Values


def signed_area(ring: Values) -> float:
    """Area (m²) inside a ring (M, 2) in the plane, positive when it runs counter-clockwise."""
    if len(ring) < 3:
        return 0.0
    x, y = (ring - ring[0]).T
    return float(0.5 * (np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))


def following_places(size: Integers) -> Integers:
    """The place (V,) of the corner after each, in rings of `size` (R,) corners that stand one behind the
    other."""
    after = np.cumsum(size)
    following = np.arange(1, int(size.sum()) + 1)
    following[after[size > 0] - 1] = (after - size)[size > 0]
    return following


def split_loops(ring: Integers) -> list[Integers]:
    """The loops of a closed walk over vertex numbers (M,), each of which visits a vertex once."""
    if len(np.unique(ring)) == len(ring):
        return [ring]
    loops: list[Integers] = []
    path: list[int] = []
    place: dict[int, int] = {}
    for vertex in ring.tolist():
        if vertex in place:
            start = place[vertex]
            loops.append(np.array(path[start:], np.int64))
            for passed in path[start + 1 :]:
                del place[passed]
            del path[start + 1 :]
        else:
            place[vertex] = len(path)
            path.append(vertex)
    loops.append(np.array(path, np.int64))
    return loops


def polygon_parts(shape: BaseGeometry, grid: float = COORDINATE_STEP) -> list[Polygon]:
    """The valid polygons a shape consists of, with coordinates on the grid (m); none for points and lines."""
    valid = shapely.set_precision(shapely.make_valid(shape), grid)
    return [
        piece
        for part in shapely.get_parts(valid)
        for piece in shapely.get_parts(part)  # a collection may hold a multipolygon
        if piece.geom_type == "Polygon" and piece.area > 0
    ]


def as_polygon(shape: BaseGeometry, grid: float = COORDINATE_STEP) -> Polygon | None:
    """The largest valid polygon of a shape with coordinates on the grid (m), or None when it has no area."""
    return max(polygon_parts(shape, grid), key=lambda part: part.area, default=None)
