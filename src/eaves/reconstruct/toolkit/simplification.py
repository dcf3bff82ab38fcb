"""A coverage without short edges, needless nodes and slivers: what is too small to be written or meant."""

from __future__ import annotations

import numpy as np
import shapely

from eaves.reconstruct.toolkit.coverage import Coverage
from eaves.reconstruct.toolkit.half_edges import (
    OUTSIDE,
    Integers,
    contract_kernel,
    corner_rank_kernel,
    sliver_kernel,
    straighten_kernel,
)
from eaves.reconstruct.toolkit.soundness import clear_plan_kernel

STRAIGHT = 0.005
"""A node this near (m) to the line between its neighbours is not needed."""

SHORTEST_EDGE = 0.10
"""Edges inside the coverage shorter than this (m) become a node."""

SHORTEST_BORDER = 0.02
"""Edges between two corners of the outline shorter than this (m) become a node."""

ROUNDS = 12
"""Passes after which simplifying stops, finished or not."""


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
    *parts, kept = straighten_kernel(*known, STRAIGHT, ROUNDS)
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
    for _ in range(4 * ROUNDS):
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
    for _ in range(ROUNDS):
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
