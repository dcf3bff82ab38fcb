"""A coverage without short edges, needless nodes and slivers: what is too small to be written or meant."""

from __future__ import annotations

import numpy as np
import shapely

from eaves.kernels import kernel
from eaves.model import Integers
from eaves.solids.coverage import (
    MOST_ROUNDS,
    OUTSIDE,
    Coverage,
    contract_kernel,
    corner_rank_kernel,
    sliver_kernel,
    straighten_kernel,
)
from eaves.solids.soundness import clear_plan_kernel

STRAIGHT = 0.005
"""A node this near (m) to the line between its neighbours is not needed."""

SHORTEST_EDGE = 0.10
"""Edges inside the coverage shorter than this (m) become a node."""

SHORTEST_BORDER = 0.02
"""Edges between two corners of the outline shorter than this (m) become a node."""


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
    if is_clear(coverage):
        return True
    polygons = coverage.polygons()
    if not shapely.is_valid(polygons).all() or shapely.is_empty(polygons).any():
        return False
    covered = float(shapely.area(polygons).sum())
    outer = -sum(coverage.ring_area[coverage.ring_cell == OUTSIDE].tolist())
    return bool(abs(covered - outer) <= 1e-6 * max(covered, 1.0))


def is_clear(coverage: Coverage) -> bool:
    """True if all cells and the outline are single rings with nodes and edges so far apart that they are
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
    half_edges = (coverage.nodes, coverage.start, coverage.end, coverage.cell, coverage.count)
    *parts, numbers = straighten_kernel(*half_edges, STRAIGHT, MOST_ROUNDS)
    if len(parts[1]) == len(coverage.start):
        return coverage, labels
    return Coverage(*parts), labels[numbers]


def merge_short_edges(
    coverage: Coverage, labels: Integers, shortest: float = SHORTEST_EDGE
) -> tuple[Coverage, Integers]:
    """The coverage with its short edges shrunk to a node, together where that is sound, else one by one."""
    refused: set[tuple[float, ...]] = set()
    for _ in range(MOST_ROUNDS):
        moved = make_moves(coverage, labels, short_edges(coverage, shortest), refused)
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
    for k in range(len(pairs)):
        node, into = pairs[k]
        clash = touched[node] or touched[into]
        for half in range(len(start)):
            clash |= start[half] == node and touched[end[half]]
        if clash:
            continue
        chosen[count, 0], chosen[count, 1] = node, into
        count += 1
        touched[node] = touched[into] = True
        for half in range(len(start)):
            if start[half] == node:
                touched[end[half]] = True
    return chosen[:count]


def short_edges(coverage: Coverage, shortest: float) -> Integers:
    """Pairs (K, 2) of nodes, the ends of edges too short to be meant, shortest first: one moves to the other.

    Corners of the outline stay, other nodes on the outline move along it, nodes inside move freely.
    """
    rank = corner_rank(coverage)
    limit = np.where((rank[coverage.start] == 2) & (rank[coverage.end] == 2), SHORTEST_BORDER, shortest)
    one_way = coverage.start < coverage.end
    halves = np.flatnonzero(one_way & (coverage.length < limit))
    halves = halves[np.argsort(coverage.length[halves], kind="stable")]
    start, end = coverage.start[halves], coverage.end[halves]
    ahead = rank[start] <= rank[end]
    return np.column_stack([np.where(ahead, start, end), np.where(ahead, end, start)])


def corner_rank(coverage: Coverage) -> Integers:
    """2 for corners of the outline, 1 for other nodes on it, 0 for nodes inside (V,)."""
    half_edges = (coverage.nodes, coverage.start, coverage.end, coverage.cell, coverage.following)
    return np.asarray(corner_rank_kernel(*half_edges))


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
        arrays = (coverage.nodes, coverage.start, coverage.end, coverage.cell, coverage.twin, coverage.area)
        worst, beside = sliver_kernel(*arrays, float(smallest_area), float(narrowest))
        if worst < 0:
            break
        targets = labels.copy()
        targets[worst] = labels[beside]
        coverage, labels = coverage.merged(targets)
    return coverage, labels
