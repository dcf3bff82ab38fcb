"""From a plan whose cells carry planes to closed solids, tidied until they are sound."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eaves.geometry.tolerance import COORDINATE_STEP, PLANARITY
from eaves.model import Face, Mask, Solid
from eaves.model.building import GROUND_SURFACE, ROOF_SURFACE, WALL_SURFACE
from eaves.reconstruct.toolkit.coverage import Coverage
from eaves.reconstruct.toolkit.half_edges import OUTSIDE, Integers
from eaves.reconstruct.toolkit.simplification import (
    SHORTEST_BORDER,
    SHORTEST_EDGE,
    absorb_slivers,
    drop_straight_nodes,
    is_sound,
    merge_short_edges,
)
from eaves.reconstruct.toolkit.soundness import find_defect
from eaves.reconstruct.toolkit.welding import weld_necks

SAME_HEIGHT = 0.4 * PLANARITY
"""Heights over one node that are nearer than this (m) become one vertex, half of it off each plane: with the
rounding of coordinates within 0.01 feet of it, the limit for files in feet."""

CORNER = 0.10
"""How far (m) a corner steps back where a building would touch itself in a vertical edge."""

ROUNDS = 40
"""Rounds in which self-contacts are resolved, all that do not touch each other at once, before the plan is
given up."""


@dataclass(frozen=True, eq=False)
class Columns:
    """The vertices over the nodes: `vertex` (H,) is the number of the roof vertex of each half-edge's cell
    over its start.

    Vertices of a node have consecutive numbers, from low to high.
    """

    vertices: NDArray[np.float64]
    vertex: Integers


def extrude(coverage: Coverage, planes: NDArray[np.float64], base: float) -> list[Solid] | None:
    """The solids between the base (m) and the planes (C, 3: a, b, c) of the cells, one for each connected
    part.

    `Face.plane` of a roof face is the number of its cell. None when the plan keeps touching itself.

    Over each node of the plan stands a column of vertices, one for each height that occurs among the
    cells around it and one for the base where the outside meets it. Every face takes its vertices from
    the columns, so faces share them, and a wall takes all those between its foot and its top, so none
    lies on another's edge. Edges along which two planes cross are split there first. A column's stretch
    that more than two walls share is a self-contact: there the corner of one cell steps back.
    """
    names = np.arange(coverage.count)
    for _ in range(ROUNDS):
        plan = split_crossings(coverage, planes)
        touching = []
        solids = []
        for part, cells in plan.parts():
            columns = make_columns(part, planes[cells], base)
            spans = wall_spans(part, columns)
            nodes = find_contacts(part, columns, spans)
            touching += list(part.nodes[nodes])
            if not touching:
                solids.append(close_solid(part, columns, spans, names[cells]))
        if not touching:
            return solids
        stepped = step_back(plan, planes, base, touching)
        if stepped is None:
            return None
        coverage, kept = stepped
        planes, names = planes[kept], names[kept]
    return None


def split_crossings(coverage: Coverage, planes: NDArray[np.float64]) -> Coverage:
    """The coverage with a node on every edge along which the planes of its two cells cross.

    A crossing beside a node inside the plan is at that node, which moves there: an edge as short as the rest
    would lie askew once it is rounded, and fold the faces beside it.
    """
    free = np.ones(len(coverage.nodes), bool)
    free[coverage.start[coverage.cell == OUTSIDE]] = False
    while True:
        halves, places = crossings(coverage, planes)
        moved = node_moved(coverage, halves, places, free)
        if moved is None:
            return coverage.split(halves, places)
        coverage = moved


def crossings(coverage: Coverage, planes: NDArray[np.float64]) -> tuple[Integers, NDArray[np.float64]]:
    """Where the planes of two cells cross along their edge: its half (K,) and the place (K, 2)."""
    halves = np.flatnonzero(
        (coverage.cell > coverage.cell[coverage.twin]) & (coverage.cell[coverage.twin] >= 0)
    )
    left, right = planes[coverage.cell[halves]], planes[coverage.cell[coverage.twin[halves]]]
    start, end = coverage.nodes[coverage.start[halves]], coverage.nodes[coverage.end[halves]]
    step = left - right
    before = step[:, 0] * start[:, 0] + step[:, 1] * start[:, 1] + step[:, 2]
    after = step[:, 0] * end[:, 0] + step[:, 1] * end[:, 1] + step[:, 2]
    crosses = (before * after < 0.0) & (np.minimum(np.abs(before), np.abs(after)) > SAME_HEIGHT)
    share = (before[crosses] / (before[crosses] - after[crosses]))[:, None]
    places = start[crosses] * (1.0 - share) + end[crosses] * share
    places = np.round(np.round(places / COORDINATE_STEP) * COORDINATE_STEP, 6)
    clear = (
        np.minimum(np.hypot(*(places - start[crosses]).T), np.hypot(*(places - end[crosses]).T))
        > 1.5 * COORDINATE_STEP
    )
    return halves[crosses][clear], places[clear]


def node_moved(
    coverage: Coverage, halves: Integers, places: NDArray[np.float64], free: Mask
) -> Coverage | None:
    """The coverage with one of the nodes that are `free` (V,) moved to one of the `places` (K, 2) beside it
    on the edges `halves` (K,); None where none can. A node tried is free no more.
    """
    for half, place in zip(halves.tolist(), places, strict=True):
        for node in (int(coverage.start[half]), int(coverage.end[half])):
            if free[node] and np.hypot(*(coverage.nodes[node] - place)) < SHORTEST_BORDER:
                free[node] = False
                nodes = coverage.nodes.copy()
                nodes[node] = place
                moved = coverage.translated(nodes)
                if is_sound(moved):
                    return moved
    return None


def make_columns(coverage: Coverage, planes: NDArray[np.float64], base: float) -> Columns:
    """The vertices over every node: one for each group of nearly equal heights of its cells."""
    place = coverage.nodes[coverage.start]
    plane = planes[coverage.cell]
    height = plane[:, 0] * place[:, 0] + plane[:, 1] * place[:, 1] + plane[:, 2]
    outside = coverage.cell == OUTSIDE
    height = np.where(outside, base, height)
    order = np.lexsort((height, ~outside, coverage.start))
    node, sorted_height, sorted_outside = coverage.start[order], height[order], outside[order]
    new = np.ones(len(order), bool)
    new[1:] = (
        (np.diff(node) != 0)
        | (np.diff(sorted_height) > SAME_HEIGHT)
        | (sorted_outside[1:] != sorted_outside[:-1])
    )
    first = np.flatnonzero(new)
    last = np.append(first[1:], len(order)) - 1
    middle = 0.5 * (sorted_height[first] + sorted_height[last])
    middle = np.round(np.round(middle / COORDINATE_STEP) * COORDINATE_STEP, 6)
    number = np.empty(len(order), np.int64)
    number[order] = np.cumsum(new) - 1
    return Columns(np.column_stack([coverage.nodes[node[first]], middle]), number)


def wall_spans(coverage: Coverage, columns: Columns) -> Integers:
    """The vertex numbers (W, 4) of the walls: foot and top over the start of an edge, foot and top over its
    end.
    """
    top_start, top_end = columns.vertex, columns.vertex[coverage.following]
    foot_start, foot_end = top_end[coverage.twin], top_start[coverage.twin]
    wall = (
        (coverage.cell != OUTSIDE)
        & (top_start >= foot_start)
        & (top_end >= foot_end)
        & ((top_start > foot_start) | (top_end > foot_end))
    )
    return np.asarray(np.column_stack([foot_start, top_start, foot_end, top_end])[wall], np.int64)


def find_contacts(coverage: Coverage, columns: Columns, spans: Integers) -> Integers:
    """The nodes (K,) whose columns have a stretch that more than two walls, with `spans` (W, 4), share."""
    size = len(columns.vertices) + 1
    change = np.bincount(spans[:, 0::2].ravel(), minlength=size)
    change -= np.bincount(spans[:, 1::2].ravel(), minlength=size)
    shared = np.flatnonzero(np.cumsum(change) > 2)
    if len(shared) == 0:
        return shared
    return np.unique(coverage.start[np.isin(columns.vertex, shared)])


def close_solid(coverage: Coverage, columns: Columns, spans: Integers, names: Integers) -> Solid:
    """The solid of a connected plan: one ground face, a roof face for each cell, named by `names` (C,), and
    the walls, with `spans` (W, 4).
    """
    ground: list[list[int]] = []
    roofs: list[list[list[int]]] = [[] for _ in range(coverage.count)]
    vertex = columns.vertex
    rings = zip(coverage.ring_cell.tolist(), coverage.rings, coverage.ring_area.tolist(), strict=True)
    for cell, ring, area in rings:
        target = ground if cell == OUTSIDE else roofs[cell]
        outer = area < 0.0 if cell == OUTSIDE else area > 0.0
        target.insert(0 if outer else len(target), vertex[ring].tolist())
    faces = [Face(tuple(tuple(ring) for ring in ground), GROUND_SURFACE)]
    faces += [
        Face(tuple(tuple(ring) for ring in own), ROOF_SURFACE, int(names[cell]))
        for cell, own in enumerate(roofs)
    ]
    for foot_start, top_start, foot_end, top_end in spans.tolist():
        up, down = range(foot_end, top_end + 1), range(top_start, foot_start - 1, -1)
        faces.append(Face(((*up, *down),), WALL_SURFACE))
    return Solid(columns.vertices, tuple(faces))


def step_back(
    coverage: Coverage, planes: NDArray[np.float64], base: float, places: Sequence[NDArray[np.float64]]
) -> tuple[Coverage, Integers] | None:
    """The coverage with one corner at each of the `places` (K of (2,)) cut off and given to the lower
    neighbour, and the cells kept.

    The corner is that of a cell higher than both its neighbours around the node; the narrowest is taken.
    A corner on an edge that another is cut from waits for the next round. None where a corner cannot step
    back.
    """
    node_at = {tuple(node): number for number, node in enumerate(coverage.nodes.tolist())}
    order = np.argsort(coverage.start, kind="stable")
    first = np.searchsorted(coverage.start[order], np.arange(len(coverage.nodes) + 1))
    taken: set[int] = set()
    corners: list[tuple[int, int]] = []
    for place in places:
        node = node_at[tuple(place.tolist())]
        leaving = order[first[node] : first[node + 1]]
        found = highest_corner(coverage, planes, base, place, leaving)
        if found is None:
            return None
        edges = {min(half, int(coverage.twin[half])) for half in found}
        if not edges & taken:
            taken |= edges
            corners.append(found)
    return cut_corners(coverage, corners)


def highest_corner(
    coverage: Coverage,
    planes: NDArray[np.float64],
    base: float,
    place: NDArray[np.float64],
    leaving: Integers,
) -> tuple[int, int] | None:
    """The two half-edges of the corner at `place` (2,) that can step back, among those `leaving` it."""
    step = coverage.nodes[coverage.end[leaving]] - place
    angle = np.arctan2(step[:, 1], step[:, 0])
    leaving, angle = leaving[np.argsort(angle)], np.sort(angle)
    cell = coverage.cell[leaving]
    at = np.append(place, 1.0)
    height = np.where(cell == OUTSIDE, base, (planes[cell] * at).sum(axis=1))
    before = np.roll(height, 1)
    after = np.roll(height, -1)
    opening = np.mod(np.roll(angle, -1) - angle, 2.0 * np.pi)
    peak = np.flatnonzero((height > before + SAME_HEIGHT) & (height > after + SAME_HEIGHT))
    for corner in peak[np.argsort(opening[peak], kind="stable")].tolist():
        one, other = int(leaving[corner]), int(leaving[(corner + 1) % len(leaving)])
        reach = min(CORNER, 0.4 * float(coverage.length[[one, other]].min()))
        if not opening_is_flat(coverage, one, other) and reach >= 5.0 * COORDINATE_STEP:
            return one, other
    return None


def cut_corners(coverage: Coverage, corners: list[tuple[int, int]]) -> tuple[Coverage, Integers]:
    """Each corner between two half-edges that leave one node given to the cell beyond the first, and the
    cells kept.
    """
    halves = np.array(corners, np.int64).ravel()
    first, count = halves[0::2], len(corners)
    reach = np.minimum(CORNER, 0.4 * coverage.length[halves])
    start, end = coverage.nodes[coverage.start[halves]], coverage.nodes[coverage.end[halves]]
    places = start + (end - start) * (reach / coverage.length[halves])[:, None]
    places = np.round(np.round(places / COORDINATE_STEP) * COORDINATE_STEP, 6)
    lower, owner = coverage.cell[coverage.twin[first]], coverage.cell[first]
    cut = coverage.split(halves, places)
    corner = coverage.count + np.arange(count)
    one = len(coverage.nodes) + 2 * np.arange(count)
    cell = cut.cell.copy()
    cell[first] = corner
    # `split` ends with the halves that lead from the new nodes back to the old ones
    cell[len(cell) - 2 * count + 2 * np.arange(count) + 1] = corner
    cut = Coverage(
        cut.nodes,
        np.concatenate([cut.start, one, one + 1]),
        np.concatenate([cut.end, one + 1, one]),
        np.concatenate([cell, corner, owner]),
    )
    return cut.merged(np.concatenate([np.arange(coverage.count), lower]))


def opening_is_flat(coverage: Coverage, first: int, second: int) -> bool:
    """Whether the corner between two half-edges from one node is 180 degrees or more, so that no chord
    cuts it.
    """
    a = coverage.nodes[coverage.end[first]] - coverage.nodes[coverage.start[first]]
    b = coverage.nodes[coverage.end[second]] - coverage.nodes[coverage.start[second]]
    return bool(a[0] * b[1] - a[1] * b[0] <= 0.0)


FIRMNESS = (1.0, 2.5, 6.0)
"""Multiples of the shortest edge and the narrowest face, tried in turn until the solids are sound."""

JOG = 0.15
"""A border inside the plan that leaves a straight line by less than this (m) is straight."""


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
    planes: NDArray[np.float64],
    ground: float,
    smallest: float,
    narrowest: float,
    held_down: Callable[[Coverage, Integers], Integers] | None = None,
) -> Extrusion:
    """The solids over a plan whose cells carry `labels` (C,) of `planes` (P, 3), or why there are none.

    Faces smaller (m²) or narrower (m) than the limits go to their neighbours. `held_down` gives cells that
    rise too high by that another label.
    """
    defect = ""
    for firmness in FIRMNESS:
        tidied, kept = tidy(plan, labels, smallest, firmness * narrowest, firmness * SHORTEST_EDGE)
        if held_down is not None:
            tidied, kept = tidied.merged(held_down(tidied, kept))
        solids = extrude(tidied, planes[kept], ground)
        if solids is None:
            defect = "the plan touches itself"
            continue
        defect = next(filter(None, map(find_defect, solids)), "")
        if not defect:
            return number_faces(solids, kept)
    return Extrusion((), np.zeros(0, np.int64), defect)


def tidy(
    plan: Coverage, labels: Integers, smallest: float, narrowest: float, shortest: float
) -> tuple[Coverage, Integers]:
    """The plan without slivers, short edges, needless nodes and necks, and the label (C,) of each cell."""
    plan, labels = absorb_slivers(plan, labels, smallest, narrowest)
    plan, labels = drop_straight_nodes(plan, labels)
    plan, labels = merge_short_edges(plan, labels, shortest)
    plan, labels = plan.merged(labels)
    plan, labels = absorb_slivers(plan, labels, smallest, narrowest)
    plan, labels = drop_straight_nodes(plan, labels)
    straight = drop_straight_nodes(plan, labels, JOG)
    if straight[0] is not plan and is_sound(straight[0]):
        plan, labels = straight
    return weld_necks(plan, labels)


def number_faces(solids: list[Solid], labels: Integers) -> Extrusion:
    """The solids with their roof faces counted through, and the label of each."""
    answer, used = [], []
    for solid in solids:
        faces = []
        for face in solid.faces:
            if face.surface == ROOF_SURFACE and face.plane is not None:
                used.append(int(labels[face.plane]))
                face = Face(face.rings, face.surface, len(used) - 1)
            faces.append(face)
        answer.append(Solid(solid.vertices, tuple(faces)))
    return Extrusion(tuple(answer), np.array(used, np.int64))


def without_numbers(solids: tuple[Solid, ...]) -> tuple[Solid, ...]:
    """The solids with roof faces that belong to no roof plane, as at the coarser levels."""
    return tuple(
        Solid(solid.vertices, tuple(Face(face.rings, face.surface) for face in solid.faces))
        for solid in solids
    )
