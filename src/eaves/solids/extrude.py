"""From a plan whose cells carry planes to closed solids, tidied until they are sound."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from operator import itemgetter

import numpy as np
import shapely
from shapely import Polygon

from eaves.geometry.inside import connected_groups_kernel, members_kernel
from eaves.geometry.rings import COORDINATE_STEP, PLANARITY
from eaves.kernels import inlined_kernel, kernel
from eaves.model import (
    GROUND_SURFACE,
    NO_PLANE,
    OUTER_CEILING_SURFACE,
    ROOF_SURFACE,
    WALL_SURFACE,
    Face,
    Integers,
    Mask,
    Points,
    Solid,
    Values,
)
from eaves.solids.coverage import (
    MOST_ROUNDS,
    NARROWEST_NECK,
    OUTSIDE,
    Coverage,
    contract_kernel,
    corner_rank_kernel,
    coverage_of,
    cut_polygons,
    sliver_kernel,
    straighten_kernel,
)
from eaves.solids.soundness import find_defect

STRAIGHT = 0.005
"""A node this near (m) to the line between its neighbours is not needed."""

SHORTEST_EDGE = 0.10
"""Edges inside the coverage shorter than this (m) become a node."""

NEAR_NODE = 0.02
"""Two planes that cross nearer to a node than this (m) cross at it."""


def contract(coverage: Coverage, target: Integers) -> tuple[Coverage, Integers] | None:
    """The coverage with every node moved into node `target` (V,), and the cells kept.

    Cells that lose their area vanish and their neighbours close up. None where edges would fall together
    otherwise.
    """
    half_edges = (coverage.nodes, coverage.start, coverage.end, coverage.cell, coverage.count)
    *parts, numbers = contract_kernel(*half_edges, target)
    return (Coverage(*parts), numbers) if len(numbers) else None


def is_sound(coverage: Coverage) -> bool:
    """True if the cells are valid polygons that fill the outline without overlap."""
    polygons = coverage.polygons()
    if not shapely.is_valid(polygons).all() or shapely.is_empty(polygons).any():
        return False
    covered = float(shapely.area(polygons).sum())
    outer = -sum(coverage.ring_area[coverage.ring_cell == OUTSIDE].tolist())
    return bool(abs(covered - outer) <= 1e-6 * max(covered, 1.0))


def drop_straight_nodes(coverage: Coverage, labels: Integers) -> tuple[Coverage, Integers]:
    """The coverage, and its labels (C,), without nodes of two edges on the line of their neighbours."""
    half_edges = (coverage.nodes, coverage.start, coverage.end, coverage.cell, coverage.count)
    *parts, numbers = straighten_kernel(*half_edges, STRAIGHT, MOST_ROUNDS)
    if len(parts[1]) == len(coverage.start):
        return coverage, labels
    return Coverage(*parts), labels[numbers]


def merge_short_edges(
    coverage: Coverage, labels: Integers, shortest: float, part: Integers
) -> tuple[Coverage, Integers]:
    """The coverage with its short edges shrunk to a node, together where that is sound, else one by one."""
    refused: set[tuple[float, ...]] = set()
    for _ in range(MOST_ROUNDS):
        pairs = short_edges(coverage, shortest, rims_of(coverage, part[labels]))
        moved = make_moves(coverage, labels, pairs, refused)
        if moved is None:
            break
        coverage, labels = moved
    return coverage, labels


def make_moves(
    coverage: Coverage,
    labels: Integers,
    pairs: Integers,
    refused: set[tuple[float, ...]],
    careful: bool = True,
) -> tuple[Coverage, Integers] | None:
    """The coverage and its labels with the first of the `pairs` of nodes made one, and all those after it
    that do not touch it; one alone when they do not go together. None where there are none.

    Pairs between the places `refused` stay out, and those found to fold the plan join them; `careful` looks
    at all cells for that.
    """
    if refused:
        keys = map(tuple, coverage.nodes[pairs].reshape(-1, 4).tolist())
        pairs = pairs[[key not in refused for key in keys]]
    chosen = apart_kernel(coverage.start, coverage.end, pairs, len(coverage.nodes))
    for batch in [chosen, *chosen[:, None]] if len(chosen) else []:
        target = np.arange(len(coverage.nodes))
        target[batch[:, 0]] = batch[:, 1]
        moved = contract(coverage, target)
        if moved is not None and (not careful or is_sound(moved[0])):
            plan, plan_labels = moved[0], labels[moved[1]]
            return (plan, plan_labels) if plan.count == coverage.count else plan.merged(plan_labels)
        if len(batch) == 1:
            refused.add(tuple(coverage.nodes[batch[0]].ravel().tolist()))
    return None


@kernel
def apart_kernel(start: Integers, end: Integers, pairs: Integers, size: int) -> Integers:
    """Those of the `pairs` (K, 2) of nodes of `size` that touch none of those before them: the first node of
    a pair and its neighbours, and the second."""
    touched, chosen, count = np.zeros(size, np.bool_), np.empty(pairs.shape, np.int64), 0
    leaving, first = members_kernel(start, size)
    for k in range(len(pairs)):
        node, into = pairs[k]
        clash = touched[node] or touched[into]
        for half in leaving[first[node] : first[node + 1]]:
            clash |= touched[end[half]]
        if clash:
            continue
        chosen[count, 0], chosen[count, 1] = node, into
        count += 1
        touched[node] = touched[into] = True
        for half in leaving[first[node] : first[node + 1]]:
            touched[end[half]] = True
    return chosen[:count]


def short_edges(coverage: Coverage, shortest: float, is_rim: Mask) -> Integers:
    """Pairs (K, 2) of nodes, the ends of edges too short to be meant, shortest first: one moves to the other.

    Corners of the rims stay, other nodes on them move along them, nodes inside move freely.
    """
    rank = corner_rank(coverage, is_rim)
    limit = np.where((rank[coverage.start] == 2) & (rank[coverage.end] == 2), NARROWEST_NECK, shortest)
    one_way = (coverage.start < coverage.end) & (
        is_rim | (rank[coverage.start] == 0) | (rank[coverage.end] == 0)
    )
    halves = np.flatnonzero(one_way & (coverage.length < limit))
    halves = halves[np.argsort(coverage.length[halves], kind="stable")]
    start, end = coverage.start[halves], coverage.end[halves]
    ahead = rank[start] <= rank[end]
    return np.column_stack([np.where(ahead, start, end), np.where(ahead, end, start)])


def corner_rank(coverage: Coverage, is_rim: Mask) -> Integers:
    """2 for corners of the rims `is_rim` (H,), 1 for other nodes on them, 0 for nodes inside (V,)."""
    return np.asarray(corner_rank_kernel(coverage.nodes, coverage.start, coverage.end, is_rim))


def rims_of(coverage: Coverage, part: Integers) -> Mask:
    """Mask (H,) of the half-edges on the outline, and on walls between cells of one `part` (C,) and
    another."""
    beside = np.append(part, OUTSIDE)[coverage.cell]
    return np.asarray(beside != beside[coverage.twin])


def absorb_slivers(
    coverage: Coverage,
    labels: Integers,
    smallest_area: float,
    narrowest: float,
    part: Integers,
) -> tuple[Coverage, Integers]:
    """The coverage with cells too small (m²) or narrow (m) given to the neighbour of their part that they
    share most with."""
    for _ in range(MOST_ROUNDS):
        if coverage.count < 2:
            break
        half_edges = (coverage.nodes, coverage.start, coverage.end, coverage.cell, coverage.twin)
        rims = rims_of(coverage, part[labels])
        target = sliver_kernel(*half_edges, rims, coverage.area, float(smallest_area), float(narrowest))
        if np.array_equal(target, np.arange(len(target))):
            break
        coverage, labels = coverage.merged(labels[target])
    return coverage, labels


LOWEST_ROOF = 0.5
"""A roof is at least this high (m) above the base: nothing is built lower, and solids keep a wall."""

SAME_HEIGHT = 0.4 * PLANARITY
"""Heights over one node that are nearer than this (m) become one vertex, half of it off each plane: with the
rounding of coordinates within 0.01 feet of it, the limit for files in feet."""

PATCH = SHORTEST_EDGE
"""Distance (m) by which cells step back from a node where they would touch in an upright edge, between its
edges."""


@inlined_kernel
def on_grid(value: float) -> float:
    """A coordinate (m) on the grid of those that are written, as `numpy.round` has it."""
    return float(np.rint(np.rint(value / COORDINATE_STEP) * COORDINATE_STEP * 1e6) / 1e6)


@kernel
def crossings_kernel(
    nodes: Values,
    start: Integers,
    end: Integers,
    cell: Integers,
    twin: Integers,
    tops: Values,
    floors: Values,
) -> tuple[Integers, Values]:
    """First crossings of a top or floor of one cell with one of the other along their edge: half (K,), place
    (K, 2)."""
    halves, places, count = np.empty(len(start), np.int64), np.empty((len(start), 2)), 0
    for half in range(len(start)):
        inside, beyond, share = cell[half], cell[twin[half]], np.inf
        if not inside > beyond >= 0:
            continue
        ax, ay, bx, by = (
            nodes[start[half], 0],
            nodes[start[half], 1],
            nodes[end[half], 0],
            nodes[end[half], 1],
        )
        for plane in (tops[inside], floors[inside]):
            for rival in (tops[beyond], floors[beyond]):
                a, b, c = plane[0] - rival[0], plane[1] - rival[1], plane[2] - rival[2]
                before, after = a * ax + b * ay + c, a * bx + b * by + c
                if before * after < 0.0 and min(abs(before), abs(after)) > SAME_HEIGHT:
                    share = min(share, before / (before - after))
        if share == np.inf:
            continue
        x, y = on_grid(ax * (1.0 - share) + bx * share), on_grid(ay * (1.0 - share) + by * share)
        if min(np.hypot(x - ax, y - ay), np.hypot(x - bx, y - by)) > 1.5 * COORDINATE_STEP:
            halves[count], places[count, 0], places[count, 1] = half, x, y
            count += 1
    return halves[:count], places[:count]


@kernel
def columns_kernel(
    nodes: Values,
    start: Integers,
    cell: Integers,
    twin: Integers,
    following: Integers,
    tops: Values,
    floors: Values,
    over: Integers,
    under: Integers,
) -> tuple[Values, Integers, Integers, Mask, Integers]:
    """Vertices (V, 3), one for each group of nearly equal heights of the cells over a node; those (H, 2) of
    each half-edge's cell over its start, of floor and top; the walls; which vertices are used (V,); the nodes
    (K,) at which walls touch.

    Vertices of a node have consecutive numbers, from low to high. A wall (W, 4) is foot and top over the
    start of an edge, foot and top over its end. Walls touch in a stretch of a column that more than two of
    them share. Tops, and floors, of neighbours with one number `over` (C,), and `under` (C,), are one face.
    """
    leaving, first = members_kernel(start, len(nodes))
    vertices, vertex = np.empty((2 * len(start), 3)), np.zeros((len(start), 2), np.int64)
    node_of, count = np.empty(2 * len(start), np.int64), 0
    for node in range(len(nodes)):
        fan = leaving[first[node] : first[node + 1]]
        fan = fan[cell[fan] != OUTSIDE]
        height = np.empty(2 * len(fan))
        for k in range(len(height)):
            plane = floors[cell[fan[k // 2]]] if k % 2 == 0 else tops[cell[fan[k // 2]]]
            height[k] = plane[0] * nodes[node, 0] + plane[1] * nodes[node, 1] + plane[2]
        order, low = np.argsort(height, kind="mergesort"), 0
        for k in range(1, len(order) + 1):
            if k < len(order) and not height[order[k]] - height[order[k - 1]] > SAME_HEIGHT:
                continue
            vertices[count, 0], vertices[count, 1] = nodes[node, 0], nodes[node, 1]
            vertices[count, 2] = on_grid(0.5 * (height[order[low]] + height[order[k - 1]]))
            for place in order[low:k]:
                vertex[fan[place // 2], place % 2] = count
            node_of[count] = node
            count, low = count + 1, k
    spans, walls = np.empty((2 * len(start), 4), np.int64), 0
    in_use, change = np.zeros(count, np.bool_), np.zeros(count + 1, np.int64)
    for half in range(len(start)):
        inside, beyond = cell[half], cell[twin[half]]
        if inside == OUTSIDE:
            continue
        (low, high), (low_end, high_end) = vertex[half], vertex[following[half]]
        if beyond == OUTSIDE or over[inside] != over[beyond]:
            in_use[high] = in_use[high_end] = True
        if beyond == OUTSIDE or under[inside] != under[beyond]:
            in_use[low] = in_use[low_end] = True
        (floor, top), (floor_end, top_end) = vertex[following[twin[half]]], vertex[twin[half]]
        for above in range(2):
            foot, foot_end, head, head_end = low, low_end, high, high_end
            if beyond == OUTSIDE:
                if above:
                    continue
            elif above:
                foot, foot_end = max(top, low), max(top_end, low_end)
            else:
                head, head_end = min(floor, high), min(floor_end, high_end)
            if head < foot or head_end < foot_end or (head == foot and head_end == foot_end):
                continue
            spans[walls, 0], spans[walls, 1], spans[walls, 2], spans[walls, 3] = (
                foot,
                head,
                foot_end,
                head_end,
            )
            walls += 1
            in_use[foot : head + 1] = True
            in_use[foot_end : head_end + 1] = True
            change[foot] += 1
            change[foot_end] += 1
            change[head] -= 1
            change[head_end] -= 1
    touching = np.unique(node_of[:count][np.cumsum(change)[:count] > 2])
    return vertices[:count], vertex, spans[:walls], in_use, touching


def extrude(coverage: Coverage, planes: Values, base: float) -> list[Solid] | None:
    """The solids between the base (m) and the planes (C, 3: a, b, c) of the cells, one for each connected
    part.

    `Face.plane` of a roof face is the number of its cell. None when the plan keeps touching itself.

    Over each node of the plan stands a column of vertices, one for each height that occurs among the
    cells around it and one for the base where the outside meets it. Every face takes its vertices from
    the columns, so faces share them, and a wall takes all those between its foot and its top, so none
    lies on another's edge. Edges along which two planes cross are split there first. A column's stretch
    that more than two walls share is a self-contact: there the cells step back from the lowest.
    """
    names = np.arange(coverage.count)
    for _ in range(MOST_ROUNDS):
        floors, stands = np.tile([0.0, 0.0, base], (len(names), 1)), np.ones(len(names), bool)
        plan = split_crossings(coverage, planes, floors)
        solids, places = close_cells(plan, planes, floors, stands, np.arange(len(names)), names.tolist())
        if len(places) == 0:
            return solids
        stepped = step_back(plan, planes, places)
        if stepped is None:
            break
        coverage, numbers = stepped
        planes, names = planes[numbers], names[numbers]
    return None


def split_crossings(coverage: Coverage, tops: Values, floors: Values) -> Coverage:
    """The coverage with a node on every edge along which planes, tops or floors (C, 3), of its cells cross.

    A crossing beside a node inside the plan is at that node, which moves there: an edge as short as the rest
    would lie askew once it is rounded, and fold the faces beside it.
    """
    free = np.ones(len(coverage.nodes), bool)
    free[coverage.start[coverage.cell == OUTSIDE]] = False
    for _ in range(MOST_ROUNDS):
        half_edges = (coverage.nodes, coverage.start, coverage.end, coverage.cell, coverage.twin)
        halves, places = crossings_kernel(*half_edges, tops, floors)
        if len(halves) == 0:
            break
        moved = node_moved(coverage, halves, places, free)
        coverage, free = (
            (coverage.split(halves, places), np.append(free, np.zeros(len(halves), bool)))
            if moved is None
            else (moved, free)
        )
    return coverage


def node_moved(coverage: Coverage, halves: Integers, places: Values, free: Mask) -> Coverage | None:
    """The coverage with one of the nodes that are `free` (V,) moved to one of the `places` (K, 2) beside it
    on the edges `halves` (K,); None where none can. A node tried is free no more.
    """
    for half, place in zip(halves.tolist(), places, strict=True):
        for node in (int(coverage.start[half]), int(coverage.end[half])):
            if free[node] and np.hypot(*(coverage.nodes[node] - place)) < NEAR_NODE:
                free[node] = False
                nodes = coverage.nodes.copy()
                nodes[node] = place
                moved = coverage.translated(nodes)
                if is_sound(moved):
                    return moved
    return None


def close_cells(
    plan: Coverage,
    tops: Values,
    floors: Values,
    stands: Mask,
    over: Integers,
    names: Sequence[int | None],
) -> tuple[list[Solid], Values]:
    """The solids between the planes `floors` and `tops` (C, 3) of the cells, and the places (K, 2) where they
    touch themselves.

    Neighbours whose tops have one number `over` (C,) have one roof face; it is called by that of the `names`.
    Cells that do not `stand` (C,) on the ground have undersides.
    """
    group = joined_cells(plan, tops, floors)
    under = np.where(stands, 0, over + 1)
    solids, touching = [], [np.zeros((0, 2))]
    for number in range(int(group.max(initial=-1)) + 1):
        part, cells = plan, np.arange(plan.count)
        if group.any():
            part, cells = plan.merged(np.where(group == number, cells, OUTSIDE))
        half_edges = (part.nodes, part.start, part.cell, part.twin, part.following)
        faces = (over[cells], under[cells])
        vertices, vertex, spans, in_use, nodes = columns_kernel(
            *half_edges, tops[cells], floors[cells], *faces
        )
        solids.append(close_solid(part, vertices, vertex, spans, in_use, *faces, names))
        touching.append(part.nodes[nodes])
    return solids, np.concatenate(touching)


def close_solid(
    plan: Coverage,
    vertices: Points,
    vertex: Integers,
    spans: Integers,
    in_use: Mask,
    over: Integers,
    under: Integers,
    names: Sequence[int | None],
) -> Solid:
    """The solid of a connected plan by its columns (`columns_kernel`): ground faces, roof faces in the order
    of their numbers, undersides, walls."""
    number = np.cumsum(in_use) - 1
    vertex, spans = number[vertex], number[spans]
    below = [
        (name, tuple(ring[::-1] for ring in rings)) for name, rings in rings_of(plan, under, vertex[:, 0])
    ]
    faces = [Face(rings, GROUND_SURFACE) for name, rings in below if name == 0]
    roofs = sorted(rings_of(plan, over, vertex[:, 1]), key=itemgetter(0))
    faces += [Face(rings, ROOF_SURFACE, names[name]) for name, rings in roofs]
    faces += [Face(rings, OUTER_CEILING_SURFACE) for name, rings in below if name != 0]
    for foot, top, foot_end, top_end in spans.tolist():
        up, down = range(foot_end, top_end + 1), range(top, foot - 1, -1)
        faces.append(Face(((*up, *down),), WALL_SURFACE))
    return Solid.of(vertices[in_use], faces)


def rings_of(
    plan: Coverage, label: Integers, vertex: Integers
) -> list[tuple[int, tuple[tuple[int, ...], ...]]]:
    """The label of each connected region of like label (C,), and its rings, the outer first: the `vertex`
    (H,) over the start of each half-edge.
    """
    region, first = plan.regions(label)
    cell_region = np.append(region, OUTSIDE)[plan.cell]
    stays = np.flatnonzero(cell_region != cell_region[plan.twin])
    part = Coverage(plan.nodes, plan.start[stays], plan.end[stays], cell_region[stays])
    halves, begin = part.ring_order
    corners = vertex[stays[halves]].tolist()
    rings: list[list[tuple[int, ...]]] = [[] for _ in first]
    loops = zip(part.ring_cell.tolist(), part.ring_area.tolist(), pairwise(begin.tolist()), strict=True)
    for number, area, (start, end) in loops:
        if number != OUTSIDE:
            rings[number].insert(0 if area > 0.0 else len(rings[number]), tuple(corners[start:end]))
    return list(zip(label[first].tolist(), map(tuple, rings), strict=True))


def segment_ends(plan: Coverage, halves: Integers, planes: Values) -> Values:
    """Heights (H, 2) of planes (H, 3) over start and end of half-edges (H,)."""
    places = np.stack([plan.nodes[plan.start[halves]], plan.nodes[plan.end[halves]]], axis=1)
    return np.asarray(
        planes[:, None, 0] * places[..., 0] + planes[:, None, 1] * places[..., 1] + planes[:, None, 2]
    )


def inner_halves(plan: Coverage) -> Integers:
    """One half of every edge between two cells."""
    return np.flatnonzero((plan.cell > plan.cell[plan.twin]) & (plan.cell[plan.twin] >= 0))


def joined_cells(plan: Coverage, tops: Values, floors: Values) -> Integers:
    """The number (C,) of the body each cell belongs to: neighbours whose heights overlap along an edge."""
    halves = inner_halves(plan)
    inner, outer = plan.cell[halves], plan.cell[plan.twin[halves]]
    top = np.minimum(segment_ends(plan, halves, tops[inner]), segment_ends(plan, halves, tops[outer]))
    floor = np.maximum(segment_ends(plan, halves, floors[inner]), segment_ends(plan, halves, floors[outer]))
    joined = (top - floor).max(axis=1) > 2.0 * SAME_HEIGHT
    return np.asarray(connected_groups_kernel(inner[joined], outer[joined], plan.count))


def step_back(coverage: Coverage, planes: Values, places: Values) -> tuple[Coverage, Integers] | None:
    """The coverage with a little patch around each of the nodes at `places` (K, 2) given to the lowest cell
    there, to the outside where that touches itself, and the cells kept; None where that cannot be drawn.
    """
    patches, lowest = [], []
    for place in places:
        leaving = np.flatnonzero((coverage.nodes[coverage.start] == place).all(axis=1))
        step, cell = coverage.nodes[coverage.end[leaving]] - place, coverage.cell[leaving]
        angle = np.sort(np.arctan2(step[:, 1], step[:, 0]))
        between = angle + 0.5 * np.mod(np.roll(angle, -1) - angle, 2.0 * np.pi)
        patches.append(Polygon(place + PATCH * np.column_stack([np.cos(between), np.sin(between)])))
        inside = cell[cell != OUTSIDE]
        least = inside[np.argmin(planes[inside] @ np.append(place, 1.0))]
        lowest.append(least if len(inside) >= len(cell) - 1 else OUTSIDE)
    polygons = coverage.polygons()
    cells, owner = cut_polygons(polygons, shapely.boundary([*polygons, *patches]))
    patch, cell = shapely.STRtree(shapely.point_on_surface(cells)).query(patches, predicate="contains")
    owner[cell] = np.array(lowest)[patch]
    cut = coverage_of(cells, COORDINATE_STEP)
    return None if cut is None else cut.merged(owner)


FIRMNESS, TURNS = 2.5, range(4)
"""Factor on the shortest edge where solids are not sound, and how often it is applied."""


@dataclass(frozen=True, eq=False)
class Extrusion:
    """Solids over a plan, and the number of the label (F,) each of their roof faces carries, in order.

    `Face.plane` counts the roof faces. Without solids, `defect` says what was wrong with the last try.
    """

    solids: tuple[Solid, ...]
    labels: Integers
    defect: str = ""


def extrude_plan(
    plan: Coverage,
    labels: Integers,
    planes: Values,
    ground: float,
    smallest: float,
) -> Extrusion:
    """The solids over a plan whose cells carry `labels` (C,) of `planes` (P, 3), or why there are none.

    Faces smaller than the limit (m²), or narrower than the shortest edge, go to their neighbours.
    """
    part = np.zeros(len(planes), np.int64)
    return extrude_first((tidy(plan, labels, smallest, turn, part) for turn in TURNS), planes, ground)


def extrude_first(drafts: Iterable[tuple[Coverage, Integers]], planes: Values, ground: float) -> Extrusion:
    """The solids over the first of the plans, with the labels of `planes` (P, 3) of their cells, that gives
    sound ones."""
    defect = ""
    for tidied, numbers in drafts:
        solids = extrude(tidied, planes[numbers], ground)
        if solids is None:
            defect = "the plan touches itself"
            continue
        defect = next(filter(None, map(find_defect, solids)), "")
        if not defect:
            return number_faces(solids, numbers)
    return Extrusion((), np.zeros(0, np.int64), defect)


def tidy(
    plan: Coverage, labels: Integers, smallest: float, turn: int, part: Integers
) -> tuple[Coverage, Integers]:
    """The plan without slivers, short edges and needless nodes, and the label (C,) of each cell; more firmly
    from turn to turn. Walls between labels of one `part` (L,) and another stay, with their corners."""
    shortest = FIRMNESS**turn * SHORTEST_EDGE
    plan, labels = absorb_slivers(plan, labels, smallest, shortest, part)
    plan, labels = drop_straight_nodes(plan, labels)
    plan, labels = merge_short_edges(plan, labels, shortest, part)
    plan, labels = plan.merged(labels)
    plan, labels = absorb_slivers(plan, labels, smallest, shortest, part)
    return drop_straight_nodes(plan, labels)


def number_faces(solids: list[Solid], labels: Integers) -> Extrusion:
    """The solids with their roof faces counted through, and the label of each."""
    numbered, plane_labels, count = [], [np.zeros(0, np.int64)], 0
    for solid in solids:
        roof = (solid.surfaces == ROOF_SURFACE) & (solid.planes != NO_PLANE)
        plane_labels.append(labels[solid.planes[roof]])
        planes = solid.planes.copy()
        planes[roof] = count + np.arange(len(plane_labels[-1]))
        count += len(plane_labels[-1])
        numbered.append(replace(solid, planes=planes))
    return Extrusion(tuple(numbered), np.concatenate(plane_labels))


def without_numbers(solids: tuple[Solid, ...]) -> tuple[Solid, ...]:
    """The solids with roof faces that belong to no roof plane, as at the coarser levels."""
    return tuple(replace(solid, planes=np.full_like(solid.planes, NO_PLANE)) for solid in solids)
