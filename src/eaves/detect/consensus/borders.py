"""The global step: which cells are building, by the least cut between evidence and neighbourhood."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.detect.consensus.evidence import Evidence, carried_on, missed_by
from eaves.kernels import kernel
from eaves.model import Integers, Mask, Values

UNIT = 100.0
"""Capacities are whole numbers: hundredths of a unit of log odds (a definition, not a threshold)."""


def cut_cells(evidence: Evidence, odds: Values, sure: float, smoothness: float, max_jump: float) -> Mask:
    """The building cells (H, W): the labelling of least energy.

    The energy is the sum of `odds` (log odds for a building, (H, W)) over the cells called otherwise, and of
    a price for each pair of neighbours called differently: `smoothness` where their surfaces continue each
    other, little where the height jumps by more than `max_jump` (m). Cells whose odds exceed `sure` either
    way are settled beforehand.
    """
    building = evidence.candidate & (odds >= sure)
    unsettled = evidence.candidate & (np.abs(odds) < sure)
    nodes = np.flatnonzero(unsettled)
    if not len(nodes):
        return building
    number = np.full(unsettled.size, -1, np.int32)
    number[nodes] = np.arange(len(nodes))
    one, two, gap = gaps_kernel(
        evidence.candidate,
        unsettled,
        evidence.top,
        evidence.residual,
        evidence.level,
        evidence.east,
        evidence.north,
        evidence.cells.side,
    )
    price = smoothness * np.exp(-((gap / max_jump) ** 2))
    columns = evidence.shape[1]
    beside = (one // columns == two // columns) | (one % columns == two % columns)
    price = np.where(beside, price, np.sqrt(0.5) * price)

    gain = np.maximum(odds.ravel()[nodes], 0.0)
    loss = np.maximum(-odds.ravel()[nodes], 0.0)
    for inner, outer in ((one, two), (two, one)):
        rim = unsettled.ravel()[inner] & ~unsettled.ravel()[outer]
        yes, no = rim & building.ravel()[outer], rim & ~building.ravel()[outer]
        gain += np.bincount(number[inner[yes]], weights=price[yes], minlength=len(nodes))
        loss += np.bincount(number[inner[no]], weights=price[no], minlength=len(nodes))
    both = unsettled.ravel()[one] & unsettled.ravel()[two]
    pairs = (number[one[both]], number[two[both]], price[both])
    del one, two, price, beside, both  # of a wide scene they would be alive at the peak of memory
    building.ravel()[nodes[source_side(gain, loss, pairs)]] = True
    return building


def source_side(
    gain: Values, loss: Values, pairs: tuple[NDArray[np.int32], NDArray[np.int32], Values]
) -> Mask:
    """Mask (N,) of the nodes that the least cut leaves with the source.

    `gain` and `loss` (N,) are the prices of cutting a node off the source and off the sink; `pairs` holds two
    nodes and the price of parting them, (P,) each.
    """
    whole = [np.rint(UNIT * values).astype(np.int32) for values in (gain, loss, pairs[2])]
    return np.asarray(cut_kernel(whole[0] - whole[1], pairs[0], pairs[1], whole[2]))


@kernel
def cut_kernel(
    spare: NDArray[np.int32], one: NDArray[np.int32], two: NDArray[np.int32], price: NDArray[np.int32]
) -> Mask:
    """Mask (N,) of the nodes that the least cut leaves with the source, by maximum flow [dinic1970].

    `spare` (N,) is what the source can send to a node, or where it is negative what the node can send to the
    sink, and is used up; `price` (P,) is what `one` and `two` (P,) can send each other.
    """
    count, pairs = len(spare), len(one)
    start, path, queue = np.zeros(count + 1, np.int64), np.empty(count, np.int64), np.empty(count, np.int64)
    for pair in range(pairs):
        start[one[pair] + 1] += 1
        start[two[pair] + 1] += 1
    for node in range(count):
        start[node + 1] += start[node]
    arc, level = start[:-1].copy(), np.empty(count, np.int64)
    to, back, left = (
        np.empty(2 * pairs, np.int64),
        np.empty(2 * pairs, np.int64),
        np.empty(2 * pairs, np.int32),
    )
    for pair in range(pairs):
        there, here = arc[one[pair]], arc[two[pair]]
        to[there], to[here], back[there], back[here] = two[pair], one[pair], here, there
        left[there] = left[here] = price[pair]
        arc[one[pair]] += 1
        arc[two[pair]] += 1
    while True:
        head = tail = 0
        open_ = False
        for node in range(count):
            level[node] = 0 if spare[node] > 0 else -1
            if spare[node] > 0:
                queue[tail] = node
                tail += 1
        sources = tail
        while head < tail:
            node = queue[head]
            head += 1
            open_ = open_ or spare[node] < 0
            for a in range(start[node], start[node + 1]):
                if left[a] > 0 and level[to[a]] < 0:
                    level[to[a]], queue[tail] = level[node] + 1, to[a]
                    tail += 1
        if not open_:
            return level >= 0
        arc[:] = start[:-1]  # the first arc of each node that may still lead to the sink
        for source in queue[:sources]:
            node, depth = source, 0
            while spare[source] > 0:
                if spare[node] < 0:
                    flow = min(spare[source], -spare[node])
                    for a in path[:depth]:
                        flow = min(flow, left[a])
                    spare[source] -= flow
                    spare[node] += flow
                    for step in range(depth - 1, -1, -1):
                        a = path[step]
                        left[a] -= flow
                        left[back[a]] += flow
                        if left[a] == 0:  # the search goes on from before the first arc that is full
                            node, depth = to[back[a]], step
                    continue
                a = arc[node]
                if a == start[node + 1]:
                    if depth == 0:
                        break
                    depth -= 1
                    node = to[back[path[depth]]]
                    arc[node] += 1
                elif left[a] > 0 and level[to[a]] == level[node] + 1:
                    path[depth], node, depth = a, to[a], depth + 1
                else:
                    arc[node] += 1


@kernel
def gaps_kernel(
    mask: Mask,
    subset: Mask,
    top: Values,
    residual: Values,
    level: Values,
    east: Values,
    north: Values,
    side: float,
) -> tuple[Integers, Integers, Values]:
    """Flat numbers (P,) of both of each pair of eight-neighbours of a mask (H, W) of which one is in a subset
    (H, W), and the distance (P,), in m, by which the highest points of both miss each other's surface: the
    least of both ways."""
    rows, columns = mask.shape
    most = 8 * np.count_nonzero(subset)
    one, two, gap, count = np.empty(most, np.int64), np.empty(most, np.int64), np.empty(most), 0
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        for row in range(rows - down):
            for column in range(max(0, -right), columns - max(0, right)):
                y, x = row + down, column + right
                if not (mask[row, column] and mask[y, x] and (subset[row, column] or subset[y, x])):
                    continue
                plane = carried_on(level, east, north, side, row, column, down, right)
                there = missed_by(top, residual, top[y, x], plane, row, column)
                plane = carried_on(level, east, north, side, y, x, -down, -right)
                back = missed_by(top, residual, top[row, column], plane, y, x)
                one[count], two[count], gap[count] = row * columns + column, y * columns + x, min(there, back)
                count += 1
    return one[:count], two[:count], gap[:count]
