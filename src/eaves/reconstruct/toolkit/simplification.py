"""A coverage without short edges, needless nodes and slivers: what is too small to be written or meant."""

from __future__ import annotations

import numpy as np
import shapely

from eaves.model import Mask, Values
from eaves.reconstruct.toolkit.coverage import OUTSIDE, Coverage, Integers

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
    start, end, cell = target[coverage.start], target[coverage.end], coverage.cell
    stays = start != end
    start, end, cell = start[stays], end[stays], cell[stays]
    size, cells = len(coverage.nodes), coverage.count + 1
    there, back = (start * size + end) * cells + cell + 1, (end * size + start) * cells + cell + 1
    stays = ~np.isin(there, back)
    start, end, cell = start[stays], end[stays], cell[stays]
    there, back = np.sort(start * size + end), np.sort(end * size + start)
    if len(there) == 0 or np.any(np.diff(there) == 0) or not np.array_equal(there, back):
        return None
    kept = np.unique(cell[cell != OUTSIDE])
    if len(kept) == 0:
        return None
    number = np.full(coverage.count + 1, OUTSIDE)
    number[kept] = np.arange(len(kept))
    return Coverage(coverage.nodes, start, end, number[cell]).compact(), kept


def is_sound(coverage: Coverage) -> bool:
    """Whether the cells are valid polygons that fill the outline without overlap."""
    polygons = coverage.polygons()
    if not shapely.is_valid(polygons).all() or shapely.is_empty(polygons).any():
        return False
    covered = float(shapely.area(polygons).sum())
    outer = -sum(coverage.ring_area[coverage.ring_cell == OUTSIDE].tolist())
    return bool(abs(covered - outer) <= 1e-6 * max(covered, 1.0))


def drop_straight_nodes(
    coverage: Coverage, labels: Integers, inner: float = STRAIGHT
) -> tuple[Coverage, Integers]:
    """The coverage, and its labels (C,), without nodes of two edges on the line of their neighbours.

    Nodes inside the coverage may be `inner` (m) away from that line, those on the outline `STRAIGHT`.
    """
    for _ in range(ROUNDS):
        degree = np.bincount(coverage.start, minlength=len(coverage.nodes))
        last = np.zeros(len(coverage.nodes), np.int64)
        last[coverage.start] = np.arange(len(coverage.start))
        first = np.zeros(len(coverage.nodes), np.int64)
        first[coverage.start[::-1]] = np.arange(len(coverage.start))[::-1]
        node = np.flatnonzero(degree == 2)
        on_outline = np.zeros(len(coverage.nodes), bool)
        on_outline[coverage.start[coverage.cell == OUTSIDE]] = True
        one, other = coverage.end[first[node]], coverage.end[last[node]]
        place, a, b = coverage.nodes[node], coverage.nodes[one], coverage.nodes[other]
        chord = b - a
        length = np.maximum(np.hypot(chord[:, 0], chord[:, 1]), 1e-9)
        away = np.abs(chord[:, 0] * (place - a)[:, 1] - chord[:, 1] * (place - a)[:, 0]) / length
        along = ((place - a) * chord).sum(axis=1) / length**2
        reach = np.where(on_outline[node], STRAIGHT, inner)
        needless = (away <= reach) & (along > 0.0) & (along < 1.0)
        chosen = np.zeros(len(coverage.nodes), bool)
        target = np.arange(len(coverage.nodes))
        for number in np.flatnonzero(needless).tolist():
            if not chosen[one[number]] and not chosen[other[number]]:
                chosen[node[number]] = True
                target[node[number]] = one[number]
        if not chosen.any():
            break
        simpler = contract(coverage, target)
        if simpler is None:
            break
        coverage, labels = simpler[0], labels[simpler[1]]
    return coverage, labels


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
    rank = np.zeros(len(coverage.nodes), np.int64)
    border = np.flatnonzero(coverage.cell == OUTSIDE)
    node = coverage.end[border]
    after = coverage.nodes[coverage.end[coverage.following[border]]] - coverage.nodes[node]
    before = coverage.nodes[node] - coverage.nodes[coverage.start[border]]
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    size = np.maximum(np.hypot(*before.T) * np.hypot(*after.T), 1e-9)
    straight = (np.abs(cross) / size < 0.02) & ((before * after).sum(axis=1) > 0.0)
    np.maximum.at(rank, node, np.where(straight, 1, 2))
    return rank


def absorb_slivers(
    coverage: Coverage, labels: Integers, smallest_area: float, narrowest: float
) -> tuple[Coverage, Integers]:
    """The coverage with cells too small (m²) or narrow (m) given to the neighbour they share most with."""
    for _ in range(ROUNDS):
        twin = coverage.cell[coverage.twin]
        inner = (coverage.cell >= 0) & (twin >= 0)
        shared = np.zeros(coverage.count)
        np.add.at(shared, coverage.cell[inner], coverage.length[inner])
        bad = ((coverage.area < smallest_area) | (widths(coverage) < narrowest)) & (shared > 0.0)
        if not bad.any():
            break
        worst = int(np.flatnonzero(bad)[np.argmin(coverage.area[bad])])
        mine = inner & (coverage.cell == worst)
        lengths = np.bincount(twin[mine], coverage.length[mine], coverage.count)
        given = labels.copy()
        given[worst] = labels[int(np.argmax(lengths))]
        coverage, labels = coverage.merged(given)
    return coverage, labels


def widths(coverage: Coverage) -> Values:
    """Width (C,; m) of the rectangle that has the cell's area and perimeter; a square's where none has."""
    mine: Mask = coverage.cell >= 0
    perimeter = np.bincount(coverage.cell[mine], coverage.length[mine], coverage.count)
    excess = np.sqrt(np.maximum(perimeter**2 - 16.0 * coverage.area, 0.0))
    return np.asarray(0.25 * (perimeter - excess))
