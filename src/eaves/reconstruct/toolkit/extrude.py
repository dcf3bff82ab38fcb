"""From a plan whose cells carry planes to closed solids, tidied until they are sound."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from eaves.geometry.tolerance import COORDINATE_STEP, PLANARITY
from eaves.kernels import inlined_kernel, kernel
from eaves.model import Face, Mask, Points, Solid
from eaves.model.building import GROUND_SURFACE, ROOF_SURFACE, WALL_SURFACE
from eaves.reconstruct.toolkit.coverage import Coverage
from eaves.reconstruct.toolkit.half_edges import MOST_ROUNDS, OUTSIDE, Integers, leaving_kernel
from eaves.reconstruct.toolkit.simplification import (
    SHORTEST_BORDER,
    SHORTEST_EDGE,
    absorb_slivers,
    drop_straight_nodes,
    is_sound,
    merge_short_edges,
    weld_necks,
)
from eaves.reconstruct.toolkit.soundness import find_defect

SAME_HEIGHT = 0.4 * PLANARITY
"""Heights over one node that are nearer than this (m) become one vertex, half of it off each plane: with the
rounding of coordinates within 0.01 feet of it, the limit for files in feet."""


@inlined_kernel
def on_grid(value: float) -> float:
    """A coordinate (m) on the grid of those that are written, as `numpy.round` has it."""
    return float(np.rint(np.rint(value / COORDINATE_STEP) * COORDINATE_STEP * 1e6) / 1e6)


@kernel
def crossings_kernel(
    nodes: NDArray[np.float64],
    start: Integers,
    end: Integers,
    cell: Integers,
    twin: Integers,
    planes: NDArray[np.float64],
) -> tuple[Integers, NDArray[np.float64]]:
    """Where the planes (C, 3) of two cells cross along their edge: its half (K,) and the place (K, 2)."""
    halves, places, count = np.empty(len(start), np.int64), np.empty((len(start), 2)), 0
    for half in range(len(start)):
        if not cell[half] > cell[twin[half]] >= 0:
            continue
        one, other = planes[cell[half]], planes[cell[twin[half]]]
        a, b, c = one[0] - other[0], one[1] - other[1], one[2] - other[2]
        ax, ay, bx, by = (
            nodes[start[half], 0],
            nodes[start[half], 1],
            nodes[end[half], 0],
            nodes[end[half], 1],
        )
        before, after = a * ax + b * ay + c, a * bx + b * by + c
        if not before * after < 0.0 or not min(abs(before), abs(after)) > SAME_HEIGHT:
            continue
        share = before / (before - after)
        x, y = on_grid(ax * (1.0 - share) + bx * share), on_grid(ay * (1.0 - share) + by * share)
        if min(np.hypot(x - ax, y - ay), np.hypot(x - bx, y - by)) > 1.5 * COORDINATE_STEP:
            halves[count], places[count, 0], places[count, 1] = half, x, y
            count += 1
    return halves[:count], places[:count]


@kernel
def columns_kernel(
    nodes: NDArray[np.float64],
    start: Integers,
    cell: Integers,
    twin: Integers,
    following: Integers,
    planes: NDArray[np.float64],
    base: float,
) -> tuple[NDArray[np.float64], Integers, Integers, Integers]:
    """Vertices (V, 3), one for each group of nearly equal heights of the cells over a node; the vertex (H,)
    of each half-edge's cell over its start; the walls; the nodes (K,) at which walls touch.

    Vertices of a node have consecutive numbers, from low to high; the `base` (m) of the outside comes first.
    A wall (W, 4) is foot and top over the start of an edge, foot and top over its end. Walls touch in a
    stretch of a column that more than two of them share.
    """
    leaving, first = leaving_kernel(start, len(nodes))
    height = np.empty(len(start))
    for half in range(len(start)):
        if cell[half] == OUTSIDE:
            height[half] = base
            continue
        a, b, c = planes[cell[half]]
        height[half] = a * nodes[start[half], 0] + b * nodes[start[half], 1] + c
    vertices, vertex, count = np.empty((len(start), 3)), np.empty(len(start), np.int64), 0
    for node in range(len(nodes)):
        some = leaving[first[node] : first[node + 1]]
        for one in range(1, len(some)):
            half, place = some[one], one
            while place > 0:
                other = some[place - 1]
                alike = (cell[half] == OUTSIDE) == (cell[other] == OUTSIDE)
                if (alike and height[half] >= height[other]) or (not alike and cell[other] == OUTSIDE):
                    break
                some[place] = other
                place -= 1
            some[place] = half
        low = 0
        for one in range(1, len(some) + 1):
            if one < len(some) and not (
                height[some[one]] - height[some[one - 1]] > SAME_HEIGHT
                or (cell[some[one]] == OUTSIDE) != (cell[some[one - 1]] == OUTSIDE)
            ):
                continue
            vertices[count, 0], vertices[count, 1] = nodes[node, 0], nodes[node, 1]
            vertices[count, 2] = on_grid(0.5 * (height[some[low]] + height[some[one - 1]]))
            for half in some[low:one]:
                vertex[half] = count
            count, low = count + 1, one
    spans, walls = np.empty((len(start), 4), np.int64), 0
    change = np.zeros(count + 1, np.int64)
    for half in range(len(start)):
        top_start, top_end = vertex[half], vertex[following[half]]
        foot_start, foot_end = vertex[following[twin[half]]], vertex[twin[half]]
        if cell[half] == OUTSIDE or top_start < foot_start or top_end < foot_end:
            continue
        if top_start == foot_start and top_end == foot_end:
            continue
        spans[walls, 0], spans[walls, 1], spans[walls, 2], spans[walls, 3] = (
            foot_start,
            top_start,
            foot_end,
            top_end,
        )
        walls += 1
        change[foot_start] += 1
        change[foot_end] += 1
        change[top_start] -= 1
        change[top_end] -= 1
    shared = np.cumsum(change) > 2
    touching = np.zeros(len(nodes), np.bool_)
    for half in range(len(start)):
        touching[start[half]] |= shared[vertex[half]]
    return vertices[:count], vertex, spans[:walls], np.flatnonzero(touching)


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
    for _ in range(MOST_ROUNDS):
        plan = split_crossings(coverage, planes)
        touching = []
        solids = []
        for part, cells in plan.parts():
            known = (part.nodes, part.start, part.cell, part.twin, part.following)
            vertices, vertex, spans, nodes = columns_kernel(*known, planes[cells], float(base))
            touching += list(part.nodes[nodes])
            if not touching:
                solids.append(close_solid(part, vertices, vertex, spans, names[cells]))
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
        known = (coverage.nodes, coverage.start, coverage.end, coverage.cell, coverage.twin)
        halves, places = crossings_kernel(*known, planes)
        if len(halves) == 0:
            return coverage
        moved = node_moved(coverage, halves, places, free)
        if moved is None:
            return coverage.split(halves, places)
        coverage = moved


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


def close_solid(
    coverage: Coverage, vertices: Points, vertex: Integers, spans: Integers, names: Integers
) -> Solid:
    """The solid of a connected plan: one ground face, a roof face for each cell, named by `names` (C,), and
    the walls, with `spans` (W, 4). `vertex` (H,) is that of each half-edge's cell over its start.
    """
    ground: list[tuple[int, ...]] = []
    roofs: list[list[tuple[int, ...]]] = [[] for _ in range(coverage.count)]
    halves, first = coverage.ring_order
    corners, begin = vertex[halves].tolist(), first.tolist()
    rings = zip(coverage.ring_cell.tolist(), coverage.ring_area.tolist(), pairwise(begin), strict=True)
    for cell, area, (start, end) in rings:
        target = ground if cell == OUTSIDE else roofs[cell]
        outer = area < 0.0 if cell == OUTSIDE else area > 0.0
        target.insert(0 if outer else len(target), tuple(corners[start:end]))
    faces = [Face(tuple(ground), GROUND_SURFACE)]
    faces += [Face(tuple(own), ROOF_SURFACE, name) for name, own in zip(names.tolist(), roofs, strict=True)]
    for foot_start, top_start, foot_end, top_end in spans.tolist():
        up, down = range(foot_end, top_end + 1), range(top_start, foot_start - 1, -1)
        faces.append(Face(((*up, *down),), WALL_SURFACE))
    return Solid(vertices, tuple(faces))


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
        reach = min(SHORTEST_EDGE, 0.4 * float(coverage.length[[one, other]].min()))
        chord = 2.0 * reach * np.sin(0.5 * opening[corner])  # of 180° and more no chord cuts the corner
        if opening[corner] < np.pi and chord >= 5.0 * COORDINATE_STEP:
            return one, other
    return None


def cut_corners(coverage: Coverage, corners: list[tuple[int, int]]) -> tuple[Coverage, Integers]:
    """Each corner between two half-edges that leave one node given to the cell beyond the first, and the
    cells kept.
    """
    halves = np.array(corners, np.int64).ravel()
    first, count = halves[0::2], len(corners)
    reach = np.minimum(SHORTEST_EDGE, 0.4 * coverage.length[halves])
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


FIRMNESS = (1.0, 2.5, 6.0)
"""Multiples of the shortest edge, tried in turn until the solids are sound."""


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
) -> Extrusion:
    """The solids over a plan whose cells carry `labels` (C,) of `planes` (P, 3), or why there are none.

    Faces smaller than the limit (m²), or narrower than the shortest edge, go to their neighbours.
    """
    defect = ""
    for firmness in FIRMNESS:
        tidied, kept = tidy(plan, labels, smallest, firmness * SHORTEST_EDGE)
        solids = extrude(tidied, planes[kept], ground)
        if solids is None:
            defect = "the plan touches itself"
            continue
        defect = next(filter(None, map(find_defect, solids)), "")
        if not defect:
            return number_faces(solids, kept)
    return Extrusion((), np.zeros(0, np.int64), defect)


def tidy(plan: Coverage, labels: Integers, smallest: float, shortest: float) -> tuple[Coverage, Integers]:
    """The plan without slivers, short edges, needless nodes and necks, and the label (C,) of each cell."""
    plan, labels = absorb_slivers(plan, labels, smallest, shortest)
    plan, labels = drop_straight_nodes(plan, labels)
    plan, labels = merge_short_edges(plan, labels, shortest)
    plan, labels = plan.merged(labels)
    plan, labels = absorb_slivers(plan, labels, smallest, shortest)
    plan, labels = drop_straight_nodes(plan, labels)
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
