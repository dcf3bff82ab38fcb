"""Neighbours that touch made to share their edges, without gap or overlap."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon, STRtree

from eaves.geometry.rings import following_places, polygon_parts
from eaves.geometry.tolerance import COORDINATE_STEP

SAME_PLACE_M = 0.02
"""Vertices and edges of neighbours nearer than this (m, a tolerance) are the same."""


def share_edges(polygons: Sequence[Polygon], gap: float, facing: float, shortest: float) -> list[Polygon]:
    """The polygons with gaps up to `gap` (m) between facing edges closed, and overlaps given to one.

    Edges face each other when they turn by at most `facing` (degrees) along a stretch of at least `shortest`
    (m). Of two facing edges the shorter one's polygon is carried on to the longer one, so that the wall gets
    no jog. An overlap stays with the larger polygon. Vertices of one on the edge of another become vertices
    of both.
    """
    shapes = list(polygons)
    tree = STRtree(shapes)
    one, other = tree.query(shapes, predicate="dwithin", distance=gap)
    pairs = sorted((int(a), int(b)) for a, b in zip(one, other, strict=True) if a < b)
    if not pairs:
        return shapes
    for a, b in pairs:
        for grower, base in ((a, b), (b, a)):
            bridges = bridges_to(polygons[grower], polygons[base], gap, facing, shortest)
            if bridges:
                shapes[grower] = grown(shapes[grower], bridges)
    give_overlaps(shapes, pairs, [polygon.area for polygon in polygons])
    touched = sorted({number for pair in pairs for number in pair})
    for number, polygon in zip(touched, welded_outlines([shapes[number] for number in touched]), strict=True):
        shapes[number] = polygon
    return shapes


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


def outline_edges(polygon: Polygon) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Starts and ends (E, 2) of a polygon's edges, area on the left."""
    whole = shapely.orient_polygons(polygon)
    rings = [np.asarray(ring.coords) for ring in (whole.exterior, *whole.interiors)]
    return np.concatenate([ring[:-1] for ring in rings]), np.concatenate([ring[1:] for ring in rings])


def bridges_to(
    grower: Polygon, base: Polygon, gap: float, most_turn: float, shortest: float
) -> list[Polygon]:
    """Strips that carry edges of `grower` on to longer edges of `base` that face them within `gap` (m).

    Facing edges are turned by at most `most_turn` (degrees), along at least `shortest` (m).
    """
    start, end = outline_edges(grower)
    base_start, base_end = outline_edges(base)
    strips = []
    for p, q in zip(start, end, strict=True):
        length = np.hypot(*(q - p))
        if length < shortest:
            continue
        along = (q - p) / length
        outward = np.array([along[1], -along[0]])
        run = base_end - base_start
        base_length = np.hypot(*run.T)
        facing = (run @ along) < -np.cos(np.radians(most_turn)) * base_length
        for k in np.flatnonzero(facing & (base_length >= length)):
            first, last = sorted(((base_start[k] - p) @ along, (base_end[k] - p) @ along))
            low, high = max(0.0, first), min(length, last)
            slope = (run[k] @ outward) / (run[k] @ along)
            depth = [
                (base_start[k] - p) @ outward + slope * (t - (base_start[k] - p) @ along) for t in (low, high)
            ]
            if high - low < shortest or min(depth) < 0.0 or max(depth) > gap:
                continue
            strip = [p + low * along, p + high * along]
            strip += [strip[1] + depth[1] * outward, strip[0] + depth[0] * outward]
            polygon = Polygon(strip)
            if polygon.area > 0.0:
                strips.append(polygon)
    return strips


def grown(polygon: Polygon, strips: list[Polygon]) -> Polygon:
    """The polygon with the strips, without vertices that lie on a straight edge."""
    united = polygon_parts(shapely.union_all([polygon, *strips], grid_size=COORDINATE_STEP))
    largest = max(united, key=lambda part: part.area)
    return shapely.simplify(largest, 2.0 * COORDINATE_STEP)


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
    one, other = STRtree(answers).query(answers, predicate="intersects")
    pairs = sorted((int(a), int(b)) for a, b in zip(one, other, strict=True) if a < b)
    give_overlaps(answers, pairs, [polygon.area for polygon in polygons], COORDINATE_STEP)
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
