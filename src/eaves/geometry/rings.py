"""Rings and polygons: area, direction, loops, and polygons from shapes."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain

import numpy as np
import shapely
from numpy.typing import NDArray
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


def area_vector(ring: Values) -> Values:
    """Area (m²) inside a ring (M, 3) times its unit normal, (3,): half of Newell's sum of cross products."""
    # column by column: np.cross and np.roll spend ten times the work on finding out what they were given
    shifted = ring - ring[0]
    x, y, z = shifted.T
    following = np.concatenate([shifted[1:], shifted[:1]])
    u, v, w = following.T
    cross = np.empty(shifted.shape)
    cross[:, 0], cross[:, 1], cross[:, 2] = y * w - z * v, z * u - x * w, x * v - y * u
    return np.asarray(0.5 * cross.sum(axis=0))


def ring_edges(
    rings: Sequence[Sequence[int]],
) -> tuple[Integers, Integers, Integers]:
    """Start and end of the edges of closed rings of vertex numbers (E,), (E,), and their rings (E,)."""
    size = np.array([len(ring) for ring in rings], np.int64)
    start = np.fromiter(chain.from_iterable(rings), np.int64, int(size.sum()))
    return start, start[following_places(size)], np.repeat(np.arange(len(size)), size)


def following_places(size: Integers) -> Integers:
    """The place (V,) of the corner after each, in rings of `size` (R,) corners that stand one behind the
    other."""
    after = np.cumsum(size)
    following = np.arange(1, int(size.sum()) + 1)
    following[after[size > 0] - 1] = (after - size)[size > 0]
    return following


def polygons_of(faces: Sequence[Sequence[Values]]) -> NDArray[np.object_]:
    """Polygons (F,) of the rings (M, 2 or 3) of faces, the outer one first, made together."""
    rings = [ring for face in faces for ring in face]
    if not rings:
        return np.empty(0, object)
    size = [len(ring) for ring in rings]
    lines = shapely.linearrings(np.concatenate(rings), indices=np.repeat(np.arange(len(size)), size))
    owner = np.repeat(np.arange(len(faces)), [len(face) for face in faces])
    return np.asarray(shapely.polygons(lines, indices=owner), object)


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
