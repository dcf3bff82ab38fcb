"""From a plan whose cells carry planes to closed solids, tidied until they are sound."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

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
    Integers,
    Mask,
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
    follow_kernel,
    merge_kernel,
    regions_kernel,
    rings_kernel,
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
        is_rim = part_rims_kernel(coverage.cell, coverage.twin, part[labels])
        pairs = short_edges_kernel(coverage.nodes, coverage.start, coverage.end, is_rim, shortest)
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


@kernel
def short_edges_kernel(
    nodes: Values, start: Integers, end: Integers, is_rim: Mask, shortest: float
) -> Integers:
    """Pairs (K, 2) of nodes, the ends of edges too short to be meant, shortest first: one moves to the other.

    Corners of the rims stay, other nodes on them move along them, nodes inside move freely.
    """
    rank = corner_rank_kernel(nodes, start, end, is_rim)
    pairs, length, count = np.empty((len(start), 2), np.int64), np.empty(len(start)), 0
    for half in range(len(start)):
        a, b = start[half], end[half]
        if a >= b or not (is_rim[half] or rank[a] == 0 or rank[b] == 0):
            continue
        length[count] = np.hypot(nodes[b, 0] - nodes[a, 0], nodes[b, 1] - nodes[a, 1])
        if length[count] < (NARROWEST_NECK if rank[a] == 2 and rank[b] == 2 else shortest):
            ahead = rank[a] <= rank[b]
            pairs[count, 0], pairs[count, 1] = a if ahead else b, b if ahead else a
            count += 1
    return pairs[np.argsort(length[:count], kind="mergesort")]


@kernel
def part_rims_kernel(cell: Integers, twin: Integers, part: Integers) -> Mask:
    """Mask (H,) of the half-edges on the outline, and on walls between cells of one `part` (C,) and
    another."""
    is_rim = np.empty(len(cell), np.bool_)
    for half in range(len(cell)):
        inside, beyond = cell[half], cell[twin[half]]
        is_rim[half] = inside != beyond
        if inside != OUTSIDE and beyond != OUTSIDE:
            is_rim[half] = part[inside] != part[beyond]
    return is_rim


def absorb_slivers(
    coverage: Coverage,
    labels: Integers,
    smallest_area: float,
    narrowest: float,
    part: Integers,
) -> tuple[Coverage, Integers]:
    """The coverage with cells too small (m²) or narrow (m) given to the neighbour of their part that they
    share most with."""
    half_edges = (coverage.nodes, coverage.start, coverage.end, coverage.cell, coverage.twin)
    limits = (float(smallest_area), float(narrowest), MOST_ROUNDS)
    *parts, absorbed = absorb_kernel(*half_edges, coverage.area, labels, part, *limits)
    return (coverage, labels) if len(absorbed) == len(labels) else (Coverage(*parts), absorbed)


@kernel
def absorb_kernel(
    nodes: Values,
    start: Integers,
    end: Integers,
    cell: Integers,
    twin: Integers,
    area: Values,
    labels: Integers,
    part: Integers,
    smallest: float,
    narrowest: float,
    rounds: int,
) -> tuple[Values, Integers, Integers, Integers, Integers]:
    """Nodes, starts, ends, cells and labels of the coverage that `absorb_slivers` makes in so many rounds."""
    for _ in range(rounds):
        if len(labels) < 2:
            break
        is_rim = part_rims_kernel(cell, twin, part[labels])
        target = sliver_kernel(nodes, start, end, cell, twin, is_rim, area, smallest, narrowest)
        if np.all(target == np.arange(len(target))):
            break
        label = labels[target]
        nodes, start, end, cell, first = merge_kernel(nodes, start, end, cell, twin, label)
        labels = label[first]
        twin, following = follow_kernel(nodes, start, end, cell)
        area = rings_kernel(nodes, start, end, cell, following, len(labels))[4]
    return nodes, start, end, cell, labels


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
    group = bodies_kernel(plan.nodes, plan.start, plan.end, plan.cell, plan.twin, tops, floors)
    under = np.where(stands, 0, over + 1)
    solids, touching = [], [np.zeros((0, 2))]
    for number in range(int(group.max(initial=-1)) + 1):
        part, cells = plan, np.arange(plan.count)
        if group.any():
            part, cells = plan.merged(np.where(group == number, cells, OUTSIDE))
        half_edges = (part.nodes, part.start, part.end, part.cell, part.twin, part.following)
        faces = (over[cells], under[cells])
        shell = shell_kernel(*half_edges, tops[cells], floors[cells], *faces)
        vertices, corners, sizes, counts, kind, label, nodes = shell
        surfaces = np.array([SHELL_SURFACES[one] for one in kind.tolist()], np.str_)
        planes = np.full(len(kind), NO_PLANE)
        called = [names[number] for number in label[kind == SHELL_SURFACES.index(ROOF_SURFACE)].tolist()]
        planes[kind == SHELL_SURFACES.index(ROOF_SURFACE)] = [
            NO_PLANE if name is None else name for name in called
        ]
        solids.append(Solid(vertices, corners, sizes, counts, surfaces, planes))
        touching.append(part.nodes[nodes])
    return solids, np.concatenate(touching)


SHELL_SURFACES = (GROUND_SURFACE, ROOF_SURFACE, OUTER_CEILING_SURFACE, WALL_SURFACE)
"""Surfaces of faces in the order in which they come in a solid."""


@kernel
def shell_kernel(
    nodes: Values,
    start: Integers,
    end: Integers,
    cell: Integers,
    twin: Integers,
    following: Integers,
    tops: Values,
    floors: Values,
    over: Integers,
    under: Integers,
) -> tuple[Values, Integers, Integers, Integers, Integers, Integers, Integers]:
    """Vertices (V, 3), corners (C,), ring sizes (R,) and ring counts (F,) of the solid of a connected plan by
    its columns (`columns_kernel`); of each face (F,) which of `SHELL_SURFACES` it is, and its number `over`
    or `under`; the nodes (K,) at which walls touch.

    Roof faces come in the order of their numbers, the outer ring of a face is its first.
    """
    half_edges = (nodes, start, cell, twin, following, tops, floors, over, under)
    columns, vertex, spans, in_use, touching = columns_kernel(*half_edges)
    number = np.cumsum(in_use) - 1
    room, rise = 2 * len(start) + len(spans), 0
    for wall in range(len(spans)):
        rise += spans[wall, 1] - spans[wall, 0] + spans[wall, 3] - spans[wall, 2]
    corners = np.empty(2 * room + rise, np.int64)
    sizes, counts, kinds, labels = np.empty((4, room), np.int64)
    corner, ring, face = 0, 0, 0
    for kind in range(3):
        up = kind == 1
        label = over if up else under
        region, first = regions_kernel(cell, twin, label)
        beside = np.full(len(cell), OUTSIDE)
        for half in range(len(cell)):
            if cell[half] != OUTSIDE:
                beside[half] = region[cell[half]]
        rims = np.flatnonzero(beside != beside[twin])
        rim_edges = (nodes, start[rims], end[rims], beside[rims])
        _, after = follow_kernel(*rim_edges)
        halves, opens, owner, area, _, _ = rings_kernel(*rim_edges, after, len(first))
        rings, begin = members_kernel(owner + 1, len(first) + 1)
        for of in np.argsort((1.0 if up else 0.0) * label[first], kind="mergesort"):
            if not up and (label[first[of]] == 0) != (kind == 0):
                continue
            own = rings[begin[of + 1] : begin[of + 2]]
            for place in range(2 * len(own)):
                outer = place < len(own)
                one = own[len(own) - 1 - place] if outer else own[place - len(own)]
                if (area[one] > 0.0) != outer:
                    continue
                sizes[ring] = opens[one + 1] - opens[one]
                for step in range(sizes[ring]):
                    half = rims[halves[opens[one] + step if up else opens[one + 1] - 1 - step]]
                    corners[corner] = number[vertex[half, 1 if up else 0]]
                    corner += 1
                ring += 1
            counts[face], kinds[face], labels[face] = len(own), kind, label[first[of]]
            face += 1
    for wall in range(len(spans)):
        foot, top, foot_end, top_end = spans[wall]
        sizes[ring], counts[face], kinds[face], labels[face] = top_end - foot_end + top - foot + 2, 1, 3, 0
        for place in range(sizes[ring]):
            up_to = foot_end + place
            corners[corner] = number[up_to if up_to <= top_end else top + top_end + 1 - up_to]
            corner += 1
        ring, face = ring + 1, face + 1
    return (
        columns[in_use],
        corners[:corner],
        sizes[:ring],
        counts[:face],
        kinds[:face],
        labels[:face],
        touching,
    )


def inner_halves(plan: Coverage) -> Integers:
    """One half of every edge between two cells."""
    return np.flatnonzero((plan.cell > plan.cell[plan.twin]) & (plan.cell[plan.twin] >= 0))


@kernel
def bodies_kernel(
    nodes: Values,
    start: Integers,
    end: Integers,
    cell: Integers,
    twin: Integers,
    tops: Values,
    floors: Values,
) -> Integers:
    """The number (C,) of the body each cell belongs to: neighbours whose heights between `floors` and `tops`
    (C, 3) overlap along an edge."""
    joined = np.zeros(len(start), np.bool_)
    for half in range(len(start)):
        inside, beyond = cell[half], cell[twin[half]]
        if not inside > beyond >= 0:
            continue
        for place in (nodes[start[half]], nodes[end[half]]):
            top = min(height_at(tops[inside], place), height_at(tops[beyond], place))
            floor = max(height_at(floors[inside], place), height_at(floors[beyond], place))
            joined[half] |= top - floor > 2.0 * SAME_HEIGHT
    bodies: Integers = connected_groups_kernel(cell[joined], cell[twin[joined]], len(tops))
    return bodies


@inlined_kernel
def height_at(plane: Values, place: Values) -> Any:
    """The height (m) of a plane (3,) over a place (2,)."""
    return plane[0] * place[0] + plane[1] * place[1] + plane[2]


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
