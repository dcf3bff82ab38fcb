"""The half-edges of a plan as compiled loops: a plan has so few that a pass of arrays over them costs more to
call than to do."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.geometry.components import unite_kernel
from eaves.kernels import inlined_kernel, kernel

Integers = NDArray[np.int64]

OUTSIDE = -1
"""The cell number of everything that is not covered."""

MOST_ROUNDS = 40
"""Passes after which improving a plan stops, finished or not; nearly all end by themselves after a few."""


@kernel
def leaving_kernel(start: Integers, size: int) -> tuple[Integers, Integers]:
    """The half-edges (H,) by the node they leave, in order, and where those of each of `size` nodes begin."""
    first = np.zeros(size + 1, np.int64)
    for node in start:
        first[node + 1] += 1
    for node in range(size):
        first[node + 1] += first[node]
    place, leaving = first[:-1].copy(), np.empty(len(start), np.int64)
    for half in range(len(start)):
        leaving[place[start[half]]] = half
        place[start[half]] += 1
    return leaving, first


@kernel
def follow_kernel(
    nodes: NDArray[np.float64], start: Integers, end: Integers, cell: Integers
) -> tuple[Integers, Integers]:
    """The half-edge (H,) that goes the other way, and the one (H,) that comes next on the ring around the
    cell to the left.

    Where a cell touches itself in a node, the ring follows what lies between, so every ring is simple.
    """
    leaving, first = leaving_kernel(start, len(nodes))
    twin, following = np.full(len(start), -1), np.full(len(start), -1)
    for half in range(len(start)):
        node, least = end[half], np.inf
        for place in range(first[node], first[node + 1]):
            candidate = leaving[place]
            if twin[half] < 0 and end[candidate] == start[half]:
                twin[half] = candidate
            if cell[candidate] != cell[half]:
                continue
            if following[half] < 0:
                following[half] = candidate
                continue
            back = np.arctan2(nodes[start[half], 1] - nodes[node, 1], nodes[start[half], 0] - nodes[node, 0])
            if least == np.inf:
                least = turn_from(back, nodes, node, end[following[half]])
            turn = turn_from(back, nodes, node, end[candidate])
            if turn < least:
                least, following[half] = turn, candidate
    return twin, following


@inlined_kernel
def turn_from(back: float, nodes: NDArray[np.float64], node: int, to: int) -> Any:
    """The angle (radians, over 0) to the left from the direction `back` to that from one node to another."""
    angle = np.arctan2(nodes[to, 1] - nodes[node, 1], nodes[to, 0] - nodes[node, 0])
    turn = np.mod(angle - back, 2.0 * np.pi)
    return turn if turn > 0.0 else 2.0 * np.pi


@kernel
def compact_kernel(
    nodes: NDArray[np.float64], start: Integers, end: Integers, cell: Integers
) -> tuple[NDArray[np.float64], Integers, Integers, Integers]:
    """Nodes, starts, ends and cells without the nodes that no half-edge uses."""
    number = np.full(len(nodes), -1)
    for half in range(len(start)):
        number[start[half]] = number[end[half]] = 0
    count = 0
    for node in range(len(nodes)):
        if number[node] == 0:
            number[node] = count
            count += 1
    corners = np.empty((count, 2))
    for node in range(len(nodes)):
        if number[node] >= 0:
            corners[number[node], 0], corners[number[node], 1] = nodes[node, 0], nodes[node, 1]
    return corners, number[start], number[end], cell


@kernel
def contract_kernel(
    nodes: NDArray[np.float64],
    start: Integers,
    end: Integers,
    cell: Integers,
    count: int,
    target: Integers,
) -> tuple[NDArray[np.float64], Integers, Integers, Integers, Integers]:
    """Nodes, starts, ends and cells with every node moved into node `target` (V,), and which of `count` cells
    are kept; no cell where edges would fall together otherwise than by closing a cell up."""
    none = np.zeros(0, np.int64)
    start, end = target[start], target[end]
    leaving, first = leaving_kernel(start, len(nodes))
    stays = start != end
    for half in range(len(start)):
        for place in range(first[end[half]], first[end[half] + 1]):
            candidate = leaving[place]
            if end[candidate] == start[half] and cell[candidate] == cell[half]:
                stays[half] = False
    start, end, cell = start[stays], end[stays], cell[stays]
    leaving, first = leaving_kernel(start, len(nodes))
    for half in range(len(start)):
        alike, back = 0, 0
        for place in range(first[start[half]], first[start[half] + 1]):
            alike += end[leaving[place]] == end[half]
        for place in range(first[end[half]], first[end[half] + 1]):
            back += end[leaving[place]] == start[half]
        if alike != 1 or back != 1:
            return nodes, start, end, cell, none
    number = np.full(count + 1, OUTSIDE)
    for owner in cell:
        if owner != OUTSIDE:
            number[owner] = 0
    survivors = np.flatnonzero(number[:count] == 0)
    for new in range(len(survivors)):
        number[survivors[new]] = new
    nodes, start, end, cell = compact_kernel(nodes, start, end, number[cell])
    return nodes, start, end, cell, survivors


@kernel
def straighten_kernel(
    nodes: NDArray[np.float64],
    start: Integers,
    end: Integers,
    cell: Integers,
    count: int,
    reach: float,
    rounds: int,
) -> tuple[NDArray[np.float64], Integers, Integers, Integers, Integers]:
    """Nodes, starts, ends and cells without nodes of two edges on the line of their neighbours, and which of
    `count` cells are kept.

    Nodes may be `reach` (m) away from that line. Nodes side by side go in different rounds.
    """
    survivors = np.arange(count)
    for _ in range(rounds):
        size = len(nodes)
        degree, before, after = np.zeros(size, np.int64), np.full(size, -1), np.full(size, -1)
        for half in range(len(start)):
            node = start[half]
            degree[node] += 1
            if before[node] < 0:
                before[node] = end[half]
            after[node] = end[half]
        chosen, target, changed = np.zeros(size, np.bool_), np.arange(size), False
        for node in range(size):
            if degree[node] != 2:
                continue
            a, b = before[node], after[node]
            chord_x, chord_y = nodes[b, 0] - nodes[a, 0], nodes[b, 1] - nodes[a, 1]
            x, y = nodes[node, 0] - nodes[a, 0], nodes[node, 1] - nodes[a, 1]
            length = max(np.hypot(chord_x, chord_y), 1e-9)
            away = abs(chord_x * y - chord_y * x) / length
            along = (x * chord_x + y * chord_y) / (length * length)
            needless = away <= reach and 0.0 < along < 1.0
            if needless and not chosen[a] and not chosen[b]:
                chosen[node], target[node], changed = True, a, True
        if not changed:
            break
        simpler = contract_kernel(nodes, start, end, cell, len(survivors), target)
        if len(simpler[4]) == 0:
            break
        nodes, start, end, cell = simpler[0], simpler[1], simpler[2], simpler[3]
        survivors = survivors[simpler[4]]
    return nodes, start, end, cell, survivors


@kernel
def regions_kernel(cell: Integers, twin: Integers, label: Integers) -> tuple[Integers, Integers]:
    """The number (C,) of the connected region of like `label` (C,) that each cell is in, and the first cell
    of each region; regions are counted in the order of their first cells. Cells labelled `OUTSIDE` keep that.
    """
    head = np.arange(len(label))
    for half in range(len(cell)):
        left, right = cell[half], cell[twin[half]]
        if left != OUTSIDE and right != OUTSIDE and label[left] == label[right] != OUTSIDE:
            unite_kernel(head, left, right)
    region, number = np.full(len(label), OUTSIDE), np.full(len(label), OUTSIDE)
    first, count = np.empty(len(label), np.int64), 0
    for k in range(len(label)):
        if label[k] == OUTSIDE:
            continue
        top = k
        while head[top] != top:
            top = head[top]
        if number[top] == OUTSIDE:
            number[top], first[count] = count, k
            count += 1
        region[k] = number[top]
    return region, first[:count]


@kernel
def merge_kernel(
    nodes: NDArray[np.float64],
    start: Integers,
    end: Integers,
    cell: Integers,
    twin: Integers,
    label: Integers,
) -> tuple[NDArray[np.float64], Integers, Integers, Integers, Integers]:
    """Nodes, starts, ends and cells with neighbouring cells of like `label` (C,) made one, and the first of
    the cells that each new one is made of. Cells labelled `OUTSIDE` are left out."""
    region, first = regions_kernel(cell, twin, label)
    new = np.full(len(cell), OUTSIDE)
    for half in range(len(cell)):
        if cell[half] != OUTSIDE:
            new[half] = region[cell[half]]
    stays = new != new[twin]
    nodes, start, end, cell = compact_kernel(nodes, start[stays], end[stays], new[stays])
    return nodes, start, end, cell, first


@kernel
def corner_rank_kernel(
    nodes: NDArray[np.float64], start: Integers, end: Integers, cell: Integers, following: Integers
) -> Integers:
    """2 for corners of the outline, 1 for other nodes on it, 0 for nodes inside (V,)."""
    rank = np.zeros(len(nodes), np.int64)
    for half in range(len(start)):
        if cell[half] != OUTSIDE:
            continue
        a, b, c = start[half], end[half], end[following[half]]
        after_x, after_y = nodes[c, 0] - nodes[b, 0], nodes[c, 1] - nodes[b, 1]
        before_x, before_y = nodes[b, 0] - nodes[a, 0], nodes[b, 1] - nodes[a, 1]
        cross = before_x * after_y - before_y * after_x
        size = max(np.hypot(before_x, before_y) * np.hypot(after_x, after_y), 1e-9)
        straight = abs(cross) / size < 0.02 and before_x * after_x + before_y * after_y > 0.0
        rank[b] = max(rank[b], 1 if straight else 2)
    return rank


@kernel
def ring_order_kernel(following: Integers) -> tuple[Integers, Integers]:
    """The half-edges (H,) ring by ring, each `following` (H,) another, and where rings start (R + 1,)."""
    visited = np.zeros(len(following), np.bool_)
    halves, first = np.empty(len(following), np.int64), np.zeros(len(following) + 1, np.int64)
    rings, count = 0, 0
    for half in range(len(following)):
        if visited[half]:
            continue
        while not visited[half]:
            visited[half] = True
            halves[count] = half
            count += 1
            half = following[half]
        rings += 1
        first[rings] = count
    return halves, first[: rings + 1]


@kernel
def rings_kernel(
    nodes: NDArray[np.float64],
    start: Integers,
    end: Integers,
    cell: Integers,
    following: Integers,
    count: int,
) -> tuple[Integers, Integers, Integers, NDArray[np.float64], NDArray[np.float64], Integers]:
    """The half-edges (H,) ring by ring, where rings start (R + 1,), the cell and the signed area (R,; m²) of
    each, the area (C,; m²) of each of `count` cells, and the first counter-clockwise ring (C,) of it, -1
    where there is none or one of its rings has fewer than three edges.
    """
    halves, first = ring_order_kernel(following)
    ring_cell, ring_area = np.empty(len(first) - 1, np.int64), np.empty(len(first) - 1)
    area, outer = np.zeros(count), np.full(count, -1)
    for ring in range(len(first) - 1):
        owner = cell[halves[first[ring]]]
        total = 0.0
        for place in range(first[ring], first[ring + 1]):
            half = halves[place]
            ax, ay = nodes[start[half], 0] - nodes[0, 0], nodes[start[half], 1] - nodes[0, 1]
            bx, by = nodes[end[half], 0] - nodes[0, 0], nodes[end[half], 1] - nodes[0, 1]
            total += ax * by - bx * ay
        ring_cell[ring], ring_area[ring] = owner, 0.5 * total
        if owner >= 0:
            area[owner] += ring_area[ring]
            if outer[owner] == -1 and ring_area[ring] > 0.0:
                outer[owner] = ring
    for ring in range(len(first) - 1):
        if ring_cell[ring] >= 0 and first[ring + 1] - first[ring] < 3:
            outer[ring_cell[ring]] = -1
    return halves, first, ring_cell, ring_area, area, outer


@kernel
def sliver_kernel(
    nodes: NDArray[np.float64],
    start: Integers,
    end: Integers,
    cell: Integers,
    twin: Integers,
    area: NDArray[np.float64],
    smallest: float,
    narrowest: float,
) -> tuple[int, int]:
    """The smallest of the cells under an `area` (C,; m²) of `smallest` or narrower (m) than `narrowest`, and
    the neighbour it shares most with; -1 where there is none.

    The width is that of the rectangle that has the cell's area and perimeter; a square's where none has.
    """
    length, perimeter, shared = np.empty(len(start)), np.zeros(len(area)), np.zeros(len(area))
    for half in range(len(start)):
        a, b = nodes[start[half]], nodes[end[half]]
        length[half] = np.hypot(b[0] - a[0], b[1] - a[1])
        if cell[half] != OUTSIDE:
            perimeter[cell[half]] += length[half]
            if cell[twin[half]] != OUTSIDE:
                shared[cell[half]] += length[half]
    excess = np.sqrt(np.maximum(perimeter * perimeter - 16.0 * area, 0.0))
    bad = ((area < smallest) | (0.25 * (perimeter - excess) < narrowest)) & (shared > 0.0)
    if not bad.any():
        return -1, -1
    worst = np.where(bad, area, np.inf).argmin()
    beside = np.zeros(len(area))
    for half in range(len(start)):
        if cell[half] == worst and cell[twin[half]] != OUTSIDE:
            beside[cell[twin[half]]] += length[half]
    return int(worst), int(beside.argmax())
