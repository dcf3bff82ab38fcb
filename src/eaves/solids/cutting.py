"""A polygon cut into cells by lines."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from eaves.geometry.inside import (
    connected_groups_kernel,
    edges_of,
    members_kernel,
    points_in_polygons,
    unite_kernel,
)
from eaves.geometry.rings import COORDINATE_STEP
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
ROW = 2**32
"""Places of the grid in a row, when they are numbered."""


def arrange(polygon: Polygon, segments: Values) -> Coverage | None:
    """The cells that segments (S, 4: x, y, x, y) cut a polygon into, nodes on the grid of coordinates.

    Ends that hang free cut nothing. Necks and gaps narrower than `NARROWEST_NECK` are parted and filled
    first, and places where segments meet, that near to each other, are one. None when the polygon has no
    area on the grid.
    """
    outline = edges_on_grid(polygon)
    if not len(outline):
        return None
    knotted = knot_kernel(outline, segments / COORDINATE_STEP, NARROWEST_NECK / COORDINATE_STEP, ROUNDED)
    return cells_between(*knotted) if len(knotted[0]) else None


@lru_cache(maxsize=4)
def edges_on_grid(polygon: Polygon) -> Values:
    """The edges (E, 4; steps of the grid) of a polygon without necks, what is inside to their left."""
    clean = without_necks(shapely.set_precision(polygon, COORDINATE_STEP), COORDINATE_STEP)
    first, last, _ = edges_of(shapely.orient_polygons(shapely.get_parts(clean)))
    return np.asarray(np.round(np.hstack([first, last]) / COORDINATE_STEP))


def cut(plan: Coverage, segments: Values) -> Coverage | None:
    """The cells of a coverage cut on by segments (S, 4: x, y, x, y), which bend through its nodes."""
    inside = plan.cell != OUTSIDE
    first, last = plan.nodes[plan.start[inside]], plan.nodes[plan.end[inside]]
    borders = np.round(np.hstack([first, last]) / COORDINATE_STEP)
    reach = NARROWEST_NECK / COORDINATE_STEP
    knotted = knot_kernel(borders, segments / COORDINATE_STEP, reach, reach)
    return cells_between(*knotted) if len(knotted[0]) else None


@kernel
def knot_kernel(
    outline: Values, lines: Values, reach: float, bend: float
) -> tuple[Values, Integers, Integers, Mask]:
    """Nodes (V, 2), the pieces between them from `start` to `end` (K,), (K,), and which are of the outline.

    `outline` (E, 4) and `lines` (S, 4) are in steps of the grid, the outline on it. The lines bend through
    corners, ends and meeting places that they pass within the `reach`: four planes that meet in a point, or
    a ridge that runs into another of its height, meet a few millimetres apart once each pair is intersected
    for itself. Then pieces that cross are divided at the nearest point of the grid, until none do. No nodes
    where that does not end.
    """
    met, piece = meetings_kernel(np.vstack((outline, lines)))
    on_outline = piece < len(outline)
    corners = each_once_kernel(outline[:, :2])
    inside = np.vstack((met[~on_outline], np.rint(lines[:, :2]), np.rint(lines[:, 2:])))
    places = np.vstack((corners, met[on_outline], each_once_kernel(inside)))
    head = nearby_kernel(places, reach)
    apart = head == np.arange(len(head))
    nodes = np.vstack((places[apart], corners[~apart[: len(corners)]]))
    _, start, end = pieces_through_kernel(nodes, outline, bend)
    _, start_of_line, end_of_line = pieces_through_kernel(nodes[: np.sum(apart)], lines, reach)
    on_rim = np.arange(len(start) + len(start_of_line)) < len(start)
    start, end = np.append(start, start_of_line), np.append(end, end_of_line)
    for _ in range(MOST_ROUNDS):
        pieces = np.hstack((nodes[start], nodes[end]))
        met, _ = meetings_kernel(pieces)
        nodes = each_once_kernel(np.vstack((nodes, met)))
        piece, start, end = pieces_through_kernel(nodes, pieces, ROUNDED)
        on_rim = on_rim[piece]
        if len(met) == 0 and len(piece) == len(pieces):
            return nodes, start, end, on_rim
    return nodes[:0], start[:0], end[:0], on_rim[:0]


@kernel
def nearby_kernel(places: Values, reach: float) -> Integers:
    """The first (K,) of the places (K, 2) with which each is connected by steps no longer than `reach`."""
    order = np.argsort(places[:, 0], kind="mergesort")
    head = np.arange(len(places))
    for i in range(len(order)):
        x, y = places[order[i], 0], places[order[i], 1]
        for j in range(i + 1, len(order)):
            east, north = places[order[j], 0] - x, places[order[j], 1] - y
            if east > reach:
                break
            if east * east + north * north <= reach * reach:
                unite_kernel(head, order[i], order[j])
    for place in range(len(head)):  # what it leads to comes before it
        head[place] = head[head[place]]
    return head


@kernel
def each_once_kernel(places: Values) -> Values:
    """The places (K, 2) of the grid, each once, by x and then by y."""
    keys = np.empty(len(places), np.int64)
    for place in range(len(places)):
        keys[place] = int(places[place, 0]) * ROW + int(places[place, 1])
    keys = np.unique(keys)
    once = np.empty((len(keys), 2))
    for place in range(len(keys)):
        x = (keys[place] + ROW // 2) // ROW
        once[place, 0], once[place, 1] = x, keys[place] - x * ROW
    return once


@kernel
def meetings_kernel(pieces: Values) -> tuple[Values, Integers]:
    """Crossings of two of the pieces (M, 4), rounded (K, 2), and the lower number of the two (K,)."""
    order = np.argsort(np.minimum(pieces[:, 0], pieces[:, 2]), kind="mergesort")
    places, first, second = crossings_kernel(pieces[order])
    return np.rint(places), np.minimum(order[first], order[second])


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


@kernel
def pieces_through_kernel(nodes: Values, pieces: Values, reach: float) -> tuple[Integers, Integers, Integers]:
    """The pieces (M, 4) divided at the nodes (V, 2) that they pass within a `reach`: the piece (K,) that each
    part is of, and the nodes (K,), (K,) that it joins."""
    order = np.argsort(nodes[:, 0], kind="mergesort")
    piece, node, along = passing_kernel(nodes[order], pieces, reach)
    start, end, goes_on = np.empty_like(node), np.empty_like(node), np.zeros(len(node), np.bool_)
    first = 0
    while first < len(piece):
        last = np.searchsorted(piece, piece[first], side="right")
        passed = order[node[first:last][np.argsort(along[first:last], kind="mergesort")]]
        start[first : last - 1], end[first : last - 1] = passed[:-1], passed[1:]
        goes_on[first : last - 1] = True
        first = last
    return piece[goes_on], start[goes_on], end[goes_on]


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
    inner = np.unique(start[on_rim] * len(nodes) + end[on_rim])
    start, end, halves, first, area = rings_between_kernel(nodes, start, end)
    if len(start) == 0:
        return None
    ring = np.empty(len(start), np.int64)
    ring[halves] = np.repeat(np.arange(len(area)), np.diff(first))
    cell = np.where(area > 0.0, np.cumsum(area > 0.0) - 1, OUTSIDE)
    holes = np.flatnonzero(cell == OUTSIDE)
    if len(holes) > 1:
        part = connected_groups_kernel(ring, np.roll(ring, len(ring) // 2), len(area))
        around = halves[cell[ring[halves]] != OUTSIDE]
        places = nodes[start[halves[first[holes]]]]
        ring_edges = (nodes[start[around]], nodes[end[around]], cell[ring[around]], int(cell.max()) + 1)
        hole, cells = points_in_polygons(places, *ring_edges)
        outer = np.flatnonzero(area > 0.0)
        other = part[outer[cells]] != part[holes[hole]]
        hole, cells = hole[other], cells[other]
        least = np.argsort(-area[outer[cells]], kind="stable")
        cell[holes[hole[least]]] = cells[least]
    cell = covered_kernel(start * len(nodes) + end, inner, cell[ring])
    stays = halves[(cell != np.roll(cell, len(cell) // 2))[halves]]  # ring by ring, the outside last
    stays = stays[np.argsort(cell[stays] == OUTSIDE, kind="stable")]
    places = np.round(nodes * COORDINATE_STEP, 6)
    return Coverage(*compact_kernel(places, start[stays], end[stays], cell[stays])) if len(stays) else None


@kernel
def rings_between_kernel(
    nodes: Values, start: Integers, end: Integers
) -> tuple[Integers, Integers, Integers, Integers, Values]:
    """Starts and ends (H,) of the half-edges of pieces between nodes (V, 2), each twin H / 2 further on,
    these ring by ring (H,), where rings start (R + 1,), and their areas (R,). Pieces that hang free are left
    out."""
    edge = np.unique(np.minimum(start, end) * len(nodes) + np.maximum(start, end))
    while True:
        lower, upper, count = edge // len(nodes), edge % len(nodes), len(edge)
        start, end = np.append(lower, upper), np.append(upper, lower)
        clockwise = next_clockwise_kernel(nodes, start, end)
        halves, first = ring_order_kernel(np.append(clockwise[count:], clockwise[:count]))
        ring, area = np.empty(len(start), np.int64), np.zeros(len(first) - 1)
        for number in range(len(area)):
            for half in halves[first[number] : first[number + 1]]:
                ring[half] = number
                ax, ay = nodes[start[half], 0] - nodes[0, 0], nodes[start[half], 1] - nodes[0, 1]
                bx, by = nodes[end[half], 0] - nodes[0, 0], nodes[end[half], 1] - nodes[0, 1]
                area[number] += ax * by - bx * ay
        cuts = ring[:count] != ring[count:]
        if np.all(cuts):
            return start, end, halves, first, area
        edge = edge[cuts]


@kernel
def next_clockwise_kernel(nodes: Values, start: Integers, end: Integers) -> Integers:
    """For each half-edge from `start` (H,) to `end` (H,) the next one clockwise that leaves the same node."""
    leaving, first = members_kernel(start, len(nodes))
    following, angle = np.empty_like(start), np.empty(len(start))
    for half in range(len(start)):
        step = nodes[end[half]] - nodes[start[half]]
        angle[half] = np.arctan2(step[1], step[0])
    for node in range(len(nodes)):
        fan = leaving[first[node] : first[node + 1]]
        fan = fan[np.argsort(angle[fan], kind="mergesort")]
        for place in range(len(fan)):
            following[fan[place]] = fan[place - 1]
    return following


@kernel
def covered_kernel(key: Integers, inner: Integers, cell: Integers) -> Integers:
    """The cell (H,) of each half-edge, numbered anew without those that no piece of the outline encloses.

    `key` (H,) are the half-edges, the twins in the second half, `inner` those of the outline, ascending, with
    what is covered to their left.
    """
    count, half_way = cell.max() + 2, len(key) // 2
    twin = np.append(cell[half_way:], cell[:half_way])
    place = np.minimum(np.searchsorted(inner, key), len(inner) - 1)
    inside_left = inner[place] == key
    crossed = ~(inside_left | np.append(inside_left[half_way:], inside_left[:half_way]))
    region = connected_groups_kernel(cell[crossed] + 1, twin[crossed] + 1, count)
    covered = np.zeros(count, np.bool_)
    covered[region[cell[inside_left] + 1]] = True
    covered = covered[region]
    covered[0] = False
    number = np.where(covered, np.cumsum(covered) - 1, OUTSIDE)
    return number[cell + 1]


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
