"""Rings and polygons: area, direction, loops, and polygons from shapes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TypeVar

import numpy as np
import shapely
from shapely import Polygon, STRtree
from shapely.geometry.base import BaseGeometry

from eaves.model import Integers, Values

COORDINATE_STEP = 0.001
"""Resolution of written coordinates (m); the CityJSON transform uses it."""

PLANARITY = 0.01
"""Largest distance of a face's vertex from its plane (m); val3dity's default `planarity_d2p_tol`."""

SNAP = 0.001
"""Vertices nearer than this (m) are one; val3dity's default `snap_tol`."""

FLAT_SLOPE_DEG = 2.0
"""Slope under which a face has no azimuth (degrees)."""


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


def pieces_between(outline: Polygon, lines: Sequence[BaseGeometry]) -> list[Polygon]:
    """The pieces that lines cut an outline into."""
    net = shapely.union_all([outline.boundary, *lines], grid_size=COORDINATE_STEP)
    pieces = shapely.get_parts(shapely.polygonize([net]))
    return [piece for piece in pieces if outline.covers(piece.representative_point())]


def joined_pieces(pieces: Sequence[Polygon], owner: list[int], count: int) -> list[Polygon | None]:
    """One polygon for each of `count` owners; what does not hang together with it goes to its neighbours."""
    loose = [
        number
        for label in range(count)
        for number in loose_pieces(pieces, [k for k, holder in enumerate(owner) if holder == label])
    ]
    for number in loose:
        border = borders_of(number, pieces, owner, count)
        border[owner[number]] = 0.0
        if border.max(initial=0.0) > 0.0:
            owner[number] = int(np.argmax(border))
    joined: list[Polygon | None] = []
    for label in range(count):
        members = [piece for piece, number in zip(pieces, owner, strict=True) if number == label]
        parts = polygon_parts(shapely.union_all(members, grid_size=COORDINATE_STEP)) if members else []
        joined.append(max(parts, key=lambda part: part.area, default=None))
    found = {number: part for number, part in enumerate(joined) if part is not None}
    for number, part in zip(found, welded_outlines(list(found.values())), strict=True):
        plain = shapely.remove_repeated_points(part, 3.0 * COORDINATE_STEP)
        joined[number] = shapely.orient_polygons(plain if plain.is_valid else part)
    return joined


def loose_pieces(pieces: Sequence[Polygon], members: Sequence[int]) -> list[int]:
    """Those of the pieces numbered `members` that are not in the largest part of their union."""
    parts = polygon_parts(shapely.union_all([pieces[k] for k in members], grid_size=COORDINATE_STEP))
    if len(parts) < 2:
        return []
    largest = max(parts, key=lambda part: part.area)
    return [k for k in members if not largest.covers(pieces[k].representative_point())]


def borders_of(number: int, pieces: Sequence[Polygon], owner: Sequence[int], count: int) -> Values:
    """Length (count,) of the border that a piece shares with the pieces of each owner (m)."""
    border = np.zeros(count)
    for k, (piece, holder) in enumerate(zip(pieces, owner, strict=True)):
        if holder >= 0 and k != number and piece.intersects(pieces[number]):
            border[holder] += piece.intersection(pieces[number]).length
    return border


def owned_by_neighbours(pieces: Sequence[Polygon], owner: Sequence[int], count: int) -> list[int]:
    """The owner of each piece, those without one (-1) given to the owner of the longest border with it.

    The piece with the longest border is given first, and its own borders count from then on: a sliver goes
    along its side, not across its tip, which would leave a spike. What touches no owner keeps -1.
    """
    owners, shapes = np.array(owner, np.int64), np.array(pieces, object)
    border = np.zeros((len(shapes), count))
    here, there = shapely.STRtree(shapes).query(shapes, predicate="intersects")
    here, there = here[here != there], there[here != there]
    length = shapely.length(shapely.intersection(shapes[here], shapes[there]))

    def count_borders(pairs: Integers) -> None:
        np.add.at(border, (here[pairs], owners[there[pairs]]), length[pairs])

    count_borders(np.flatnonzero(owners[there] >= 0))
    while (free := np.where(owners < 0, border.max(axis=1, initial=0.0), 0.0)).max(initial=0.0) > 0.0:
        given = int(np.argmax(free))
        owners[given] = np.argmax(border[given])
        count_borders(np.flatnonzero(there == given))
    return list(map(int, owners))


SAME_PLACE_M = 0.02
"""Vertices and edges of neighbours nearer than this (m, a tolerance) are the same."""


def share_edges(polygons: Sequence[Polygon]) -> list[Polygon]:
    """The polygons with what two of them have in common left to the larger one."""
    shapes = list(polygons)
    area = shapely.area(shapes)
    pairs = STRtree(shapes).query(shapes, predicate="intersects").T
    for a, b in sorted(pairs[pairs[:, 0] < pairs[:, 1]].tolist()):
        loser, keeper = (a, b) if (area[a], a) < (area[b], b) else (b, a)
        if shapes[loser].intersection(shapes[keeper]).area > 0.0:
            rest = polygon_parts(shapely.difference(shapes[loser], shapes[keeper], grid_size=COORDINATE_STEP))
            shapes[loser] = max(rest, key=lambda part: part.area, default=shapes[loser])
    return shapes


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
    return share_edges(answers)


def shared_rings(
    polygons: Sequence[Polygon],
) -> tuple[Values, list[Integers], list[int]]:
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
    rings: list[Integers] = []
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


One = TypeVar("One")
Other = TypeVar("Other")

HALF = 0.5
"""Polygons are at one place that share this part of either."""


def half_shared(ones: Sequence[BaseGeometry], others: Sequence[BaseGeometry]) -> list[tuple[float, int, int]]:
    """Area (m²) in common, and the numbers in both sets, of polygons at one place."""
    first, second = np.array([*ones], object), np.array([*others], object)
    if not len(first) or not len(second):
        return []
    j, i = shapely.STRtree(first).query(second)
    least = np.minimum(shapely.area(first)[i], shapely.area(second)[j])
    low, high = np.split(np.stack([shapely.bounds(first)[i], shapely.bounds(second)[j]]), 2, axis=2)
    boxes = np.prod(np.maximum(high.min(axis=0) - low.max(axis=0), 0.0), axis=1)
    near = boxes >= HALF * least  # neighbours that touch are many, and to cut them takes long
    i, j, least = i[near], j[near], least[near]
    shared = shapely.area(shapely.intersection(first[i], second[j]))
    large = (shared > 0) & (shared >= HALF * least)
    return list(zip(shared[large].tolist(), i[large].tolist(), j[large].tolist(), strict=True))


def pair_off(
    ranked: Iterable[tuple[One, Other]], known: Mapping[One, Other] | None = None
) -> dict[One, Other]:
    """Pairs, the best first, of which each of either set is in one at most; beside those `known`."""
    pairs = dict(known or {})
    partners = set(pairs.values())
    for item, partner in ranked:
        if item not in pairs and partner not in partners:
            pairs[item] = partner
            partners.add(partner)
    return pairs
