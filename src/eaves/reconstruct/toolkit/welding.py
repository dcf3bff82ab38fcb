"""A plan without necks: where a border nearly touches another, they meet in one node."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely

from eaves.geometry.tolerance import COORDINATE_STEP
from eaves.reconstruct.toolkit.coverage import Coverage
from eaves.reconstruct.toolkit.half_edges import OUTSIDE, Integers, has_neck_kernel, ring_order_kernel
from eaves.reconstruct.toolkit.overlay import NARROWEST_NECK
from eaves.reconstruct.toolkit.simplification import contract, corner_rank, is_sound

MOST_WELDS = 40
"""Necks of one plan that are welded; each takes a pass over the plan."""


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
    for _ in range(MOST_WELDS):
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
