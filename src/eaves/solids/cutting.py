"""A polygon cut into cells by lines."""

from __future__ import annotations

import numpy as np
import shapely
from scipy.spatial import cKDTree
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from eaves.geometry.components import connected_groups_kernel
from eaves.geometry.inside import edges_of, points_in_polygons
from eaves.geometry.tolerance import COORDINATE_STEP
from eaves.kernels import kernel
from eaves.model import Integers, Mask, Values
from eaves.solids.coverage import (
    MOST_ROUNDS,
    NARROWEST_NECK,
    OUTSIDE,
    SMALLEST_PART,
    Coverage,
    compact_kernel,
    ring_order_kernel,
)

ROUNDED = 0.75
"""So near (steps of the grid) to a node a piece passes through it: what is rounded moves less."""


def arrange(polygon: Polygon, segments: Values) -> Coverage | None:
    """The cells that segments (S, 4: x, y, x, y) cut a polygon into, nodes on the grid of coordinates.

    Ends that hang free cut nothing. Necks and gaps narrower than `NARROWEST_NECK` are parted and filled
    first, and places where segments meet, that near to each other, are one. None when the polygon has no
    area on the grid.
    """
    clean = without_necks(shapely.set_precision(polygon, COORDINATE_STEP), COORDINATE_STEP)
    if clean.is_empty:
        return None
    first, last, _ = edges_of(shapely.orient_polygons(shapely.get_parts(clean)))
    outline = np.round(np.hstack([first, last]) / COORDINATE_STEP)
    knotted = knot(outline, segments / COORDINATE_STEP)
    return None if knotted is None else cells_between(*knotted)


def knot(outline: Values, lines: Values) -> tuple[Values, Integers, Integers, Mask] | None:
    """Nodes (V, 2), the pieces between them from `start` to `end` (K,), (K,), and which are of the outline.

    `outline` (E, 4) and `lines` (S, 4) are in steps of the grid, the outline on it. The lines bend through
    corners, ends and meeting places that they pass within `NARROWEST_NECK`: four planes that meet in a point,
    or a ridge that runs into another of its height, meet a few millimetres apart once each pair is
    intersected for itself. Then pieces that cross are divided at the nearest point of the grid, until none
    do. None where that does not end.
    """
    met, piece = meetings(np.vstack([outline, lines]))
    on_outline = piece < len(outline)
    corners = each_once(outline[:, :2])
    inside = np.vstack([met[~on_outline], np.round(lines.reshape(-1, 2))])
    crossings = np.vstack([met[on_outline], each_once(inside)])
    reach = NARROWEST_NECK / COORDINATE_STEP
    nodes, count = one_place_each(corners, crossings, reach)
    _, start, end = pieces_through(nodes, outline, ROUNDED)
    _, start_of_line, end_of_line = pieces_through(nodes[:count], lines, reach)
    on_rim = np.arange(len(start) + len(start_of_line)) < len(start)
    start, end = np.append(start, start_of_line), np.append(end, end_of_line)
    for _ in range(MOST_ROUNDS):
        pieces = np.hstack([nodes[start], nodes[end]])
        met, _ = meetings(pieces)
        nodes = each_once(np.vstack([nodes, met]))
        piece, start, end = pieces_through(nodes, pieces, ROUNDED)
        on_rim = on_rim[piece]
        if len(met) == 0 and len(piece) == len(pieces):
            return nodes, start, end, on_rim
    return None


def one_place_each(corners: Values, crossings: Values, reach: float) -> tuple[Values, int]:
    """One place for those of the corners (K, 2) and the other places (M, 2) that are connected by steps as
    short as `reach`, the first of them; after so many the corners that are none of these."""
    places = np.vstack([corners, crossings])
    pairs = cKDTree(places).query_pairs(reach, output_type="ndarray")
    group = connected_groups_kernel(pairs[:, 0], pairs[:, 1], len(places))
    first = np.unique(group, return_index=True)[1]
    left_out = np.ones(len(corners), bool)
    left_out[first[first < len(corners)]] = False
    return places[np.append(first, np.flatnonzero(left_out))], len(first)


def each_once(places: Values) -> Values:
    """The places (K, 2), each once, by x and then by y."""
    numbers = np.unique(places @ np.array([1.0, 1.0j]))
    return np.column_stack([numbers.real, numbers.imag])


def meetings(pieces: Values) -> tuple[Values, Integers]:
    """Crossings of two of the pieces (M, 4), rounded (K, 2), and the lower number of the two (K,)."""
    order = np.argsort(np.minimum(pieces[:, 0], pieces[:, 2]), kind="stable")
    places, first, second = crossings_kernel(pieces[order])
    return np.round(places), np.minimum(order[first], order[second])


@kernel
def crossings_kernel(pieces: Values) -> tuple[Values, Integers, Integers]:
    """Crossings of two of the pieces (M, 4), ascending by their least x, between their ends (K, 2), and the
    two that cross, (K,), (K,)."""
    room, hits = 2 * len(pieces) + 16, 0
    places, pairs = np.empty((room, 2)), np.empty((2, room), np.int64)
    for i in range(len(pieces)):
        ax, ay, bx, by = pieces[i, 0], pieces[i, 1], pieces[i, 2], pieces[i, 3]
        east, south, north = max(ax, bx), min(ay, by), max(ay, by)
        for j in range(i + 1, len(pieces)):
            cx, cy, dx, dy = pieces[j, 0], pieces[j, 1], pieces[j, 2], pieces[j, 3]
            if min(cx, dx) > east:
                break
            if min(cy, dy) > north or max(cy, dy) < south:
                continue
            cross = (bx - ax) * (dy - cy) - (by - ay) * (dx - cx)
            if cross == 0.0:
                continue
            along = ((cx - ax) * (dy - cy) - (cy - ay) * (dx - cx)) / cross
            across = ((cx - ax) * (by - ay) - (cy - ay) * (bx - ax)) / cross
            if 0.0 < along < 1.0 and 0.0 < across < 1.0:
                if hits == room:
                    room *= 2
                    more_places, more_pairs = np.empty((room, 2)), np.empty((2, room), np.int64)
                    more_places[:hits], more_pairs[:, :hits] = places, pairs
                    places, pairs = more_places, more_pairs
                places[hits, 0], places[hits, 1] = ax + along * (bx - ax), ay + along * (by - ay)
                pairs[0, hits], pairs[1, hits] = i, j
                hits += 1
    return places[:hits], pairs[0, :hits], pairs[1, :hits]


def pieces_through(nodes: Values, pieces: Values, reach: float) -> tuple[Integers, Integers, Integers]:
    """The pieces (M, 4) divided at the nodes (V, 2) that they pass within a `reach`: the piece (K,) that each
    part is of, and the nodes (K,), (K,) that it joins."""
    order = np.argsort(nodes[:, 0], kind="stable")
    among = nodes[order]
    piece, node, along = passing_kernel(among, pieces, reach)
    turn = np.lexsort((node, along, piece))
    piece, node = piece[turn], order[node[turn]]
    goes_on = piece[1:] == piece[:-1]
    return piece[1:][goes_on], node[:-1][goes_on], node[1:][goes_on]


@kernel
def passing_kernel(nodes: Values, pieces: Values, reach: float) -> tuple[Integers, Integers, Values]:
    """Pairs of piece and node (K,), (K,) that are within a `reach` of each other, and how far along the piece
    the node is. The nodes (V, 2) ascend by x."""
    room, hits = 4 * len(pieces) + 16, 0
    pairs, places = np.empty((2, room), np.int64), np.empty(room)
    for piece in range(len(pieces)):
        ax, ay, bx, by = pieces[piece, 0], pieces[piece, 1], pieces[piece, 2], pieces[piece, 3]
        dx, dy = bx - ax, by - ay
        square = max(dx * dx + dy * dy, 1e-9)
        for node in range(np.searchsorted(nodes[:, 0], min(ax, bx) - reach), len(nodes)):
            x, y = nodes[node, 0] - ax, nodes[node, 1] - ay
            if x > max(dx, 0.0) + reach:
                break
            along = (x * dx + y * dy) / square
            inside = min(max(along, 0.0), 1.0)
            if (x - inside * dx) ** 2 + (y - inside * dy) ** 2 > reach * reach:
                continue
            if hits == room:
                room *= 2
                more_pairs, more_places = np.empty((2, room), np.int64), np.empty(room)
                more_pairs[:, :hits], more_places[:hits] = pairs, places
                pairs, places = more_pairs, more_places
            pairs[0, hits], pairs[1, hits], places[hits] = piece, node, along
            hits += 1
    return pairs[0, :hits], pairs[1, :hits], places[:hits]


def cells_between(nodes: Values, start: Integers, end: Integers, on_rim: Mask) -> Coverage | None:
    """The coverage of what lies to the left of the pieces of the outline, which are `on_rim` (K,), cut by the
    others; None where nothing does. Pieces meet in nodes (V, 2; steps of the grid) only."""
    size = len(nodes)
    inner = np.unique(start[on_rim] * size + end[on_rim])
    edge = np.unique(np.minimum(start, end) * size + np.maximum(start, end))
    while True:
        cell_a, cell_b = edge // size, edge % size
        start, end = np.concatenate([cell_a, cell_b]), np.concatenate([cell_b, cell_a])
        twin = np.roll(np.arange(len(start)), len(edge))
        halves, first = ring_order_kernel(next_clockwise(nodes, start, end)[twin])
        ring = np.empty(len(start), np.int64)
        ring[halves] = np.repeat(np.arange(len(first) - 1), np.diff(first))
        cuts = ring[: len(edge)] != ring[len(edge) :]
        if cuts.all():
            break
        edge = edge[cuts]
    if len(edge) == 0:
        return None
    x, y = (nodes - nodes[0]).T
    area = np.add.reduceat((x[start] * y[end] - x[end] * y[start])[halves], first[:-1])
    cell = np.where(area > 0.0, np.cumsum(area > 0.0) - 1, OUTSIDE)
    holes = np.flatnonzero(cell == OUTSIDE)
    if len(holes) > 1:
        part = connected_groups_kernel(ring, ring[twin], len(area))
        around = halves[cell[ring[halves]] != OUTSIDE]
        places = nodes[start[halves[first[holes]]]]
        ring_edges = (nodes[start[around]], nodes[end[around]], cell[ring[around]], int(cell.max()) + 1)
        hole, cells = points_in_polygons(places, *ring_edges)
        outer = np.flatnonzero(area > 0.0)
        cell_b = part[outer[cells]] != part[holes[hole]]
        hole, cells = hole[cell_b], cells[cell_b]
        least = np.argsort(-area[outer[cells]], kind="stable")
        cell[holes[hole[least]]] = cells[least]
    cell = cell[ring]
    key = start * size + end
    inside_left = inner[np.minimum(np.searchsorted(inner, key), len(inner) - 1)] == key
    crossed = ~(inside_left | inside_left[twin])
    count = int(cell.max()) + 2
    region = connected_groups_kernel(cell[crossed] + 1, cell[twin][crossed] + 1, count)
    covered = np.zeros(count, bool)
    covered[region[cell[inside_left] + 1]] = True
    covered = covered[region]
    covered[0] = False
    number = np.where(covered, np.cumsum(covered) - 1, OUTSIDE)
    cell = number[cell + 1]
    stays = halves[(cell != cell[twin])[halves]]  # ring by ring, the outside last
    stays = stays[np.argsort(cell[stays] == OUTSIDE, kind="stable")]
    places = np.round(nodes * COORDINATE_STEP, 6)
    return Coverage(*compact_kernel(places, start[stays], end[stays], cell[stays])) if len(stays) else None


def next_clockwise(nodes: Values, start: Integers, end: Integers) -> Integers:
    """For each half-edge from `start` (H,) to `end` (H,) the next one clockwise that leaves the same node."""
    step = nodes[end] - nodes[start]
    order = np.lexsort((np.arctan2(step[:, 1], step[:, 0]), start))
    leaving = start[order]
    opens = np.append(True, leaving[1:] != leaving[:-1])[: len(order)]
    last = np.append(np.flatnonzero(opens)[1:], len(order)) - 1
    before = np.roll(order, 1)
    before[opens] = order[last]
    following = np.empty_like(order)
    following[order] = before
    return following


def without_necks(polygon: BaseGeometry, grid: float) -> BaseGeometry:
    """The polygonal shape, parted at necks and with clefts filled where they are too narrow to be built.

    A shape that is nowhere so narrow comes back as it is.
    """
    if shapely.minimum_clearance(polygon) < NARROWEST_NECK:
        reach = 0.5 * NARROWEST_NECK
        for distance in (reach, -2.0 * reach, reach):
            polygon = shapely.buffer(polygon, distance, join_style="mitre", mitre_limit=3.0)
        polygon = shapely.set_precision(polygon, grid)
    for _ in range(MOST_ROUNDS):
        if shapely.minimum_clearance(polygon) >= 0.5 * NARROWEST_NECK:
            break
        neck = shapely.buffer(shapely.minimum_clearance_line(polygon), NARROWEST_NECK, cap_style="square")
        polygon = shapely.set_precision(shapely.difference(polygon, neck), grid)
    parts = [
        part
        for part in shapely.get_parts(polygon)
        if part.geom_type == "Polygon" and part.area > SMALLEST_PART
    ]
    return shapely.MultiPolygon(parts)
