"""A plan whose corners are worth stating: each must explain points, or it goes."""

from __future__ import annotations

import numpy as np

from eaves.geometry.inside import points_in_polygons
from eaves.kernels import kernel
from eaves.model import Points, Values
from eaves.reconstruct.toolkit.cell_labels import LabelCosts
from eaves.solids.coverage import Coverage
from eaves.solids.half_edges import OUTSIDE, Integers, leaving_kernel
from eaves.solids.simplification import corner_rank, is_sound, make_moves
from eaves.solids.soundness import LOWEST_WALL

PASSES = 8
"""Passes over the plan, in each of which moves that do not touch one another are made together; more of them
wear sound corners away."""

MOST_HEIGHTS = 64
"""Half-edges of two neighbouring nodes, at most, for one of them to move into the other."""


def settle_corners(
    coverage: Coverage,
    labels: Integers,
    roof: Points,
    planes: Values,
    costs: LabelCosts,
    price: float,
    reach: float,
) -> tuple[Coverage, Integers]:
    """The coverage without the corners that explain less than `price` points each, and its labels (C,).

    A node moves into a neighbour nearer than `reach` (m), or goes where its two edges are within it of one
    line, when that costs the points (N, 3) that get another of the `planes` (P, 3) less than the corners it
    saves:

        Σ_points [c(d of the new plane) − c(d of the old)] < price · corners,  c(d) = min((d/τ)², 1) + d/τ,

    d the distance, τ the limit of residuals, as for the labels. A step of
    metres is never given up for a few corners, as the distance counts in full. Corners are those of the
    solids: one for each height over a node. Corners of the outline stay, other nodes on it move along it.
    """
    for careful in (False, True):
        refused: set[tuple[float, ...]] = set()
        plan, plan_labels = coverage, labels
        for _ in range(PASSES):
            pairs = worthwhile_moves(plan, plan_labels, roof, planes, costs, price, reach)
            moved = make_moves(plan, plan_labels, pairs, refused, careful) if len(pairs) else None
            if moved is None:
                break
            plan, plan_labels = moved
        if plan is coverage or careful or is_sound(plan):
            return plan, plan_labels
    return coverage, labels


def worthwhile_moves(
    coverage: Coverage,
    labels: Integers,
    roof: Points,
    planes: Values,
    costs: LabelCosts,
    price: float,
    reach: float,
) -> Integers:
    """Pairs (K, 2) of a node and the neighbour it should move into, the best first."""
    half_edges = (coverage.nodes, coverage.start, coverage.end, coverage.cell, *coverage.neighbours)
    node, into, saved, triangles, move, gets, has = moves_kernel(
        *half_edges, labels, planes, corner_rank(coverage), reach
    )
    gain = price * saved
    if len(triangles):
        ends = np.roll(triangles, -1, axis=1).reshape(-1, 2)
        owner = np.repeat(np.arange(len(triangles)), 3)
        point, swept = points_in_polygons(roof, triangles.reshape(-1, 2), ends, owner, len(triangles))
        gain -= changes_kernel(roof, point, swept, planes, gets, has, move, len(node), costs.residual_limit)
    order = np.argsort(-gain, kind="stable")
    return np.asarray(np.column_stack([node, into])[order[gain[order] > 0.0]])


@kernel
def changes_kernel(
    points: Points,
    point: Integers,
    swept: Integers,
    planes: Values,
    gets: Integers,
    has: Integers,
    move: Integers,
    count: int,
    residual_limit: float,
) -> Values:
    """The cost of each of `count` moves to the points (N, 3) that it sweeps: pairs of `point` (K,) and
    triangle `swept` (K,), with the plane that its points get, the one they have, and the move it belongs to
    (T,)."""
    total = np.zeros(count)
    for pair in range(len(point)):
        x, y, z = points[point[pair]]
        change = 0.0
        for side in range(2):
            a, b, c = planes[gets[swept[pair]] if side == 0 else has[swept[pair]]]
            away = abs(z - a * x - b * y - c) / np.sqrt(1.0 + a * a + b * b)
            share = away / residual_limit
            cost = min(share * share, 1.0) + share
            change = cost if side == 0 else change - cost
        total[move[swept[pair]]] += change
    return total


@kernel
def moves_kernel(
    nodes: Values,
    start: Integers,
    end: Integers,
    cell: Integers,
    twin: Integers,
    following: Integers,
    labels: Integers,
    planes: Values,
    rank: Integers,
    reach: float,
) -> tuple[Integers, Integers, Values, Values, Integers, Integers, Integers]:
    """Nodes (K,), the neighbours (K,) they could move into, the corners (K,) that saves, and what their edges
    sweep: triangles (T, 3, 2), the move of each, the label its points get, and the one they have, (T,).

    A point swept by several edges goes from cell to cell, so that the changes add up. `labels` (C,) of the
    `planes` (P, 3), `rank` (V,) as by `corner_rank`.
    """
    leaving, first = leaving_kernel(start, len(nodes))
    moves, swept = 0, 0
    node, into, saved = np.empty(len(start), np.int64), np.empty(len(start), np.int64), np.empty(len(start))
    room = 8 * len(start)
    triangles, move = np.empty((room, 3, 2)), np.empty(room, np.int64)
    gets, has = np.empty(room, np.int64), np.empty(room, np.int64)
    heights = np.empty(MOST_HEIGHTS)
    for half in range(len(start)):
        v, w = start[half], end[half]
        if rank[v] == 2 or rank[v] > rank[w]:
            continue
        if rank[v] == 1 and cell[half] != OUTSIDE and cell[twin[half]] != OUTSIDE:
            continue
        at_v, at_w = leaving[first[v] : first[v + 1]], leaving[first[w] : first[w + 1]]
        if len(at_v) + len(at_w) > MOST_HEIGHTS or swept + len(at_v) > room:
            continue
        dx, dy = nodes[w, 0] - nodes[v, 0], nodes[w, 1] - nodes[v, 1]
        close = np.hypot(dx, dy) < reach
        if not close and len(at_v) == 2 and rank[v] == 0:
            neighbour = end[at_v[0]] if at_v[1] == half else end[at_v[1]]
            ex, ey = nodes[neighbour, 0] - nodes[v, 0], nodes[neighbour, 1] - nodes[v, 1]
            chord = np.hypot(ex - dx, ey - dy)
            close = abs(dx * ey - dy * ex) < reach * chord
        if not close:
            continue
        closed_left, closed_right = OUTSIDE, OUTSIDE
        if end[following[following[half]]] == v:
            closed_left = cell[half]
        if end[following[following[twin[half]]]] == w:
            closed_right = cell[twin[half]]
        before, count = 0, 0
        for place in range(2):
            fan, at = (at_v, v) if place == 0 else (at_w, w)
            count = 0
            for spoke in fan:
                if cell[spoke] != OUTSIDE:
                    a, b, c = planes[labels[cell[spoke]]]
                    heights[count] = a * nodes[at, 0] + b * nodes[at, 1] + c
                    count += 1
            before += corners_kernel(heights, count)
        count = 0
        for fan in (at_v, at_w):
            for spoke in fan:
                owner = cell[spoke]
                if owner != OUTSIDE and owner != closed_left and owner != closed_right:
                    a, b, c = planes[labels[owner]]
                    heights[count] = a * nodes[w, 0] + b * nodes[w, 1] + c
                    count += 1
        fewer = before - corners_kernel(heights, count)
        if fewer <= 0:
            continue
        node[moves], into[moves], saved[moves] = v, w, fewer
        for edge in at_v:
            left, right, far = cell[edge], cell[twin[edge]], end[edge]
            turn = dx * (nodes[far, 1] - nodes[v, 1]) - dy * (nodes[far, 0] - nodes[v, 0])
            if far == w or left == OUTSIDE or right == OUTSIDE or abs(turn) < 1e-9:
                continue
            triangles[swept, 0], triangles[swept, 1], triangles[swept, 2] = nodes[v], nodes[w], nodes[far]
            move[swept] = moves
            gets[swept] = labels[left] if turn > 0.0 else labels[right]
            has[swept] = labels[right] if turn > 0.0 else labels[left]
            swept += 1
        moves += 1
    return (
        node[:moves],
        into[:moves],
        saved[:moves],
        triangles[:swept],
        move[:swept],
        gets[:swept],
        has[:swept],
    )


@kernel
def corners_kernel(heights: Values, count: int) -> int:
    """Number of corners that the first `count` of the heights (m) over one node make: one for all between
    which no wall is high enough.
    """
    ordered = np.sort(heights[:count])
    corners = 1 if count > 0 else 0
    for k in range(1, count):
        corners += ordered[k] - ordered[k - 1] > LOWEST_WALL
    return corners
