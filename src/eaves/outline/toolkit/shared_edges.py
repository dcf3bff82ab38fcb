"""Neighbours that overlap made to share their edges."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon, STRtree

from eaves.geometry.rings import COORDINATE_STEP, following_places, polygon_parts

SAME_PLACE_M = 0.02
"""Vertices and edges of neighbours nearer than this (m, a tolerance) are the same."""


def share_edges(polygons: Sequence[Polygon]) -> list[Polygon]:
    """The polygons with overlaps given to the larger one. Vertices of one on the edge of another become
    vertices of both."""
    shapes = list(polygons)
    pairs = meeting_pairs(shapes)
    if not pairs:
        return shapes
    give_overlaps(shapes, pairs, [polygon.area for polygon in polygons])
    touched = sorted({number for pair in pairs for number in pair})
    for number, polygon in zip(touched, welded_outlines([shapes[number] for number in touched]), strict=True):
        shapes[number] = polygon
    return shapes


def meeting_pairs(shapes: Sequence[Polygon]) -> list[tuple[int, int]]:
    """The numbers of shapes that meet, pair by pair in their order."""
    one, other = STRtree(shapes).query(shapes, predicate="intersects")
    return sorted((int(a), int(b)) for a, b in zip(one, other, strict=True) if a < b)


def give_overlaps(
    shapes: list[Polygon], pairs: Sequence[tuple[int, int]], area: Sequence[float], least: float = 0.0
) -> None:
    """Leave what two shapes have in common, more than `least` (m²), to that of the larger `area`."""
    for a, b in pairs:
        loser, keeper = (a, b) if (area[a], a) < (area[b], b) else (b, a)
        if shapes[loser].intersection(shapes[keeper]).area > least:
            rest = polygon_parts(shapely.difference(shapes[loser], shapes[keeper], grid_size=COORDINATE_STEP))
            if rest:
                shapes[loser] = max(rest, key=lambda part: part.area)


def welded_outlines(polygons: Sequence[Polygon]) -> list[Polygon]:
    """The polygons with their common vertices in both; one that would become invalid stays as it is, but for
    what its neighbours have then."""
    nodes, rings, owner = shared_rings(polygons)
    nodes = np.round(nodes / COORDINATE_STEP) * COORDINATE_STEP
    answers = []
    for number, polygon in enumerate(polygons):
        outer, *holes = [nodes[ring] for ring, one in zip(rings, owner, strict=True) if one == number]
        joined = Polygon(outer, holes)
        answers.append(joined if joined.is_valid and joined.area > 0.0 else polygon)
    give_overlaps(answers, meeting_pairs(answers), [polygon.area for polygon in polygons], COORDINATE_STEP)
    return answers


def shared_rings(
    polygons: Sequence[Polygon],
) -> tuple[NDArray[np.float64], list[NDArray[np.int64]], list[int]]:
    """Common vertices (V, 2), every ring as numbers of them, building on the left, and whose it is.

    A vertex of a neighbour that lies on an edge becomes a vertex of that edge too.
    """
    loops, owner = [], []
    for number, polygon in enumerate(polygons):
        whole = shapely.orient_polygons(polygon)
        for ring in (whole.exterior, *whole.interiors):
            loops.append(np.asarray(ring.coords)[:-1, :2])
            owner.append(number)
    corners = np.concatenate(loops)
    tree = STRtree(shapely.points(corners))
    one, other = tree.query(shapely.points(corners), predicate="dwithin", distance=SAME_PLACE_M)
    leader = np.arange(len(corners))
    np.minimum.at(leader, one, other)
    kept, number_of = np.unique(leader, return_inverse=True)
    nodes = corners[kept]
    tree = STRtree(shapely.points(nodes))
    size = np.array([len(loop) for loop in loops])
    head, tail = number_of, number_of[following_places(size)]
    lines = shapely.linestrings(np.stack([nodes[head], nodes[tail]], axis=1))
    edge, between = tree.query(lines, predicate="dwithin", distance=SAME_PLACE_M)
    others = (between != head[edge]) & (between != tail[edge])
    edge, between = edge[others], between[others]
    on_edge: dict[int, list[int]] = {}
    for line, node in zip(edge.tolist(), between.tolist(), strict=True):
        on_edge.setdefault(line, []).append(node)
    rings: list[NDArray[np.int64]] = []
    start = 0
    for loop in loops:
        path: list[int] = []
        for line in range(start, start + len(loop)):
            path.append(int(head[line]))
            if line in on_edge:
                some = np.array(on_edge[line])
                along = (nodes[some] - nodes[head[line]]) @ (nodes[tail[line]] - nodes[head[line]])
                path += some[np.argsort(along, kind="stable")].tolist()
        start += len(loop)
        rings.append(
            np.array([v for v, before in zip(path, path[-1:] + path[:-1], strict=True) if v != before])
        )
    return nodes, rings, owner
