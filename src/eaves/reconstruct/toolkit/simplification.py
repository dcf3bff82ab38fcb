"""A coverage without short edges, needless nodes and slivers: what is too small to be written or meant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely

from eaves.geometry.tolerance import COORDINATE_STEP
from eaves.reconstruct.toolkit.coverage import NARROWEST_NECK, Coverage
from eaves.reconstruct.toolkit.half_edges import (
    MOST_ROUNDS,
    OUTSIDE,
    Integers,
    contract_kernel,
    corner_rank_kernel,
    has_neck_kernel,
    ring_order_kernel,
    sliver_kernel,
    straighten_kernel,
)
from eaves.reconstruct.toolkit.soundness import clear_plan_kernel

STRAIGHT = 0.005
"""A node this near (m) to the line between its neighbours is not needed."""

SHORTEST_EDGE = 0.10
"""Edges inside the coverage shorter than this (m) become a node; a corner steps back so far where a building
would touch itself in a vertical edge."""

SHORTEST_BORDER = 0.02
"""Edges between two corners of the outline shorter than this (m) become a node."""


def contract(coverage: Coverage, target: Integers) -> tuple[Coverage, Integers] | None:
    """The coverage with every node moved into node `target` (V,), and the cells kept.

    Cells that lose their area vanish and their neighbours close up. None where edges would fall together
    otherwise.
    """
    known = (coverage.nodes, coverage.start, coverage.end, coverage.cell, coverage.count)
    *parts, kept = contract_kernel(*known, target)
    return (Coverage(*parts), kept) if len(kept) else None


def is_sound(coverage: Coverage) -> bool:
    """Whether the cells are valid polygons that fill the outline without overlap."""
    if is_clear(coverage):
        return True
    polygons = coverage.polygons()
    if not shapely.is_valid(polygons).all() or shapely.is_empty(polygons).any():
        return False
    covered = float(shapely.area(polygons).sum())
    outer = -sum(coverage.ring_area[coverage.ring_cell == OUTSIDE].tolist())
    return bool(abs(covered - outer) <= 1e-6 * max(covered, 1.0))


def is_clear(coverage: Coverage) -> bool:
    """Whether all cells and the outline are single rings with nodes and edges so far apart that they are
    certainly valid: these fill the outline, for each edge but the outline's is on two of them.
    """
    ring_cell, (halves, first) = coverage.ring_cell, coverage.ring_order
    if len(ring_cell) != coverage.count + 1 or coverage.outer_ring.min() < 0:
        return False
    outline = int(ring_cell.argmin())
    turn = int(first[outline])
    ring = np.append(halves[turn:], halves[:turn])
    begin = np.append(first[outline:] - turn, first[1 : outline + 1] + len(halves) - turn)
    return bool(clear_plan_kernel(coverage.nodes[coverage.start[ring]], begin, np.arange(len(begin))))


def drop_straight_nodes(coverage: Coverage, labels: Integers) -> tuple[Coverage, Integers]:
    """The coverage, and its labels (C,), without nodes of two edges on the line of their neighbours."""
    known = (coverage.nodes, coverage.start, coverage.end, coverage.cell, coverage.count)
    *parts, kept = straighten_kernel(*known, STRAIGHT, MOST_ROUNDS)
    if len(parts[1]) == len(coverage.start):
        return coverage, labels
    return Coverage(*parts), labels[kept]


def merge_short_edges(
    coverage: Coverage, labels: Integers, shortest: float = SHORTEST_EDGE
) -> tuple[Coverage, Integers]:
    """The coverage with its short edges shrunk to a node, together where that is sound, else one by one."""
    halves, mover, goal = short_edges(coverage, shortest)
    if len(halves) == 0:
        return coverage, labels
    target = np.arange(len(coverage.nodes))
    touched = np.zeros(len(coverage.nodes), bool)
    for node, into in zip(mover.tolist(), goal.tolist(), strict=True):
        if not touched[node] and not touched[into]:
            target[node] = into
            touched[[node, into]] = True
    simpler = contract(coverage, target)
    if simpler is not None and is_sound(simpler[0]):
        coverage, labels = simpler[0], labels[simpler[1]]
    refused: set[tuple[float, ...]] = set()
    for _ in range(MOST_ROUNDS):
        halves, mover, goal = short_edges(coverage, shortest)
        trial = None
        for node, into in zip(mover.tolist(), goal.tolist(), strict=True):
            key = (*coverage.nodes[node].tolist(), *coverage.nodes[into].tolist())
            if key not in refused:
                trial = node, into, key
                break
        if trial is None:
            break
        target = np.arange(len(coverage.nodes))
        target[trial[0]] = trial[1]
        simpler = contract(coverage, target)
        if simpler is not None and is_sound(simpler[0]):
            coverage, labels = simpler[0], labels[simpler[1]]
        else:
            refused.add(trial[2])
    return coverage, labels


def short_edges(coverage: Coverage, shortest: float) -> tuple[Integers, Integers, Integers]:
    """Half-edges too short to be meant, shortest first; the node of each that moves, and the one it moves to.

    Corners of the outline stay, other nodes on the outline move along it, nodes inside move freely.
    """
    rank = corner_rank(coverage)
    limit = np.where((rank[coverage.start] == 2) & (rank[coverage.end] == 2), SHORTEST_BORDER, shortest)
    one_way = coverage.start < coverage.end
    halves = np.flatnonzero(one_way & (coverage.length < limit))
    halves = halves[np.argsort(coverage.length[halves], kind="stable")]
    start, end = coverage.start[halves], coverage.end[halves]
    ahead = rank[start] <= rank[end]
    return halves, np.where(ahead, start, end), np.where(ahead, end, start)


def corner_rank(coverage: Coverage) -> Integers:
    """2 for corners of the outline, 1 for other nodes on it, 0 for nodes inside (V,)."""
    known = (coverage.nodes, coverage.start, coverage.end, coverage.cell, coverage.following)
    return np.asarray(corner_rank_kernel(*known))


def absorb_slivers(
    coverage: Coverage,
    labels: Integers,
    smallest_area: float,
    narrowest: float,
) -> tuple[Coverage, Integers]:
    """The coverage with cells too small (m²) or narrow (m) given to the neighbour they share most with."""
    for _ in range(MOST_ROUNDS):
        if coverage.count < 2:
            break
        known = (coverage.nodes, coverage.start, coverage.end, coverage.cell, coverage.twin, coverage.area)
        worst, beside = sliver_kernel(*known, float(smallest_area), float(narrowest))
        if worst < 0:
            break
        given = labels.copy()
        given[worst] = labels[beside]
        coverage, labels = coverage.merged(given)
    return coverage, labels


def weld_necks(
    coverage: Coverage, labels: Integers, reach: float = NARROWEST_NECK
) -> tuple[Coverage, Integers]:
    """The coverage with nodes and borders nearer than `reach` (m) made to meet, and the label of each cell.

    Four planes that meet in a point, or a ridge that runs into another of its height, meet a few
    millimetres apart once each pair is intersected for itself. What is left between is a neck of a cell no
    wider than that: it is closed, and the cell becomes two. The nearest go first; corners of the outline
    stay. A weld that would fold the plan is left out.
    """
    if coverage.count < 2 or not has_neck_kernel(
        coverage.nodes, coverage.start, coverage.end, reach + COORDINATE_STEP
    ):
        return coverage, labels
    refused: set[tuple[float, ...]] = set()
    for _ in range(MOST_ROUNDS):
        if shapely.minimum_clearance(coverage.polygons()).min(initial=np.inf) >= reach:
            break
        for node, half in near_pairs(coverage, reach):
            key = (*coverage.nodes[node], *coverage.nodes[[coverage.start[half], coverage.end[half]]].ravel())
            if key in refused:
                continue
            trial = welded(coverage, labels, node, half, reach)
            if trial is not None:
                coverage, labels = trial
                break
            refused.add(key)
        else:
            break
    return coverage, labels


def near_pairs(coverage: Coverage, reach: float) -> list[tuple[int, int]]:
    """Nodes and edges (a half of each) nearer than `reach` (m) that do not hang together, nearest first."""
    halves = np.flatnonzero(coverage.start < coverage.end)
    ends = np.stack([coverage.nodes[coverage.start[halves]], coverage.nodes[coverage.end[halves]]], axis=1)
    lines = shapely.linestrings(ends)
    places = shapely.points(coverage.nodes)
    node, edge = shapely.STRtree(lines).query(places, predicate="dwithin", distance=reach)
    half = halves[edge]
    apart = (coverage.start[half] != node) & (coverage.end[half] != node)
    node, half, edge = node[apart], half[apart], edge[apart]
    away = shapely.distance(places[node], lines[edge])
    order = np.lexsort((half, node, away))
    return list(zip(node[order].tolist(), half[order].tolist(), strict=True))


def welded(
    coverage: Coverage, labels: Integers, node: int, half: int, reach: float
) -> tuple[Coverage, Integers] | None:
    """The coverage with a node on the edge `half`, or on its end where that is near; None if not sound."""
    rank = corner_rank(coverage)
    start, end = int(coverage.start[half]), int(coverage.end[half])
    place, a, b = coverage.nodes[[node, start, end]]
    step = b - a
    along = float(np.clip((place - a) @ step / (step @ step), 0.0, 1.0))
    foot = a + along * step
    foot = np.round(np.round(foot / COORDINATE_STEP) * COORDINATE_STEP, 6)
    on_outline = OUTSIDE in (coverage.cell[half], coverage.cell[coverage.twin[half]])
    near = [one for one in (start, end) if np.hypot(*(coverage.nodes[one] - foot)) < reach]
    if near:
        other = min(near, key=lambda one: float(np.hypot(*(coverage.nodes[one] - place))))
    else:
        if on_outline and rank[node] > 0:
            return None
        coverage = coverage.split(np.array([half]), (foot if on_outline else place)[None])
        other = len(coverage.nodes) - 1
        rank = np.append(rank, 1 if on_outline else 0)
    if rank[node] > 0 and rank[other] > 0:
        return None
    target = np.arange(len(coverage.nodes))
    mover, into = (node, other) if rank[node] <= rank[other] else (other, node)
    target[mover] = into
    moved = contract(coverage, target)
    if moved is None:
        return None
    parted = part_cells(moved[0], labels[moved[1]])
    return parted if parted is not None and is_sound(parted[0]) else None


def part_cells(coverage: Coverage, labels: Integers) -> tuple[Coverage, Integers] | None:
    """The coverage with cells that hang together in a node alone made several; None where one has holes too.

    There the rings turn as sharply to the left as they can, so that each goes around one piece.
    """
    nodes = coverage.nodes
    start, end = nodes[coverage.start], nodes[coverage.end]
    angle = np.arctan2(end[:, 1] - start[:, 1], end[:, 0] - start[:, 0])
    around = np.lexsort((angle, coverage.start))
    first = np.searchsorted(coverage.start[around], np.arange(len(nodes) + 1))
    position = np.empty(len(around), np.int64)
    position[around] = np.arange(len(around))
    node = coverage.end
    before = position[coverage.twin] - 1
    before = np.where(before < first[node], first[node + 1] - 1, before)
    halves, begin = ring_order_kernel(around[before])
    cross = start[:, 0] * end[:, 1] - end[:, 0] * start[:, 1]
    area = np.add.reduceat(cross[halves], begin[:-1])
    ring_cell = coverage.cell[halves[begin[:-1]]]
    outer = np.flatnonzero((ring_cell != OUTSIDE) & (area > 0.0))
    further = np.delete(outer, np.unique(ring_cell[outer], return_index=True)[1])
    if len(further) == 0:
        return coverage, labels
    if np.isin(ring_cell[area <= 0.0], ring_cell[further]).any():
        return None
    cell = coverage.cell.copy()
    for number, ring in enumerate(further.tolist()):
        cell[halves[begin[ring] : begin[ring + 1]]] = coverage.count + number
    return replace(coverage, cell=cell), np.concatenate([labels, labels[ring_cell[further]]])
