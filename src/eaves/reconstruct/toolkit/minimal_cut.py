"""The minimal cut of a graph with a source and a sink."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from eaves.model import Mask, Values

Integers = NDArray[np.int64]

SCALE = 1e4
"""Capacities become whole numbers for the flow: 1e-4 of their unit is kept."""


@njit(cache=True)
def minimal_cut_kernel(edges: Integers, back: Values, source: Values, sink: Values) -> Mask:
    """The nodes (N,) on the source's side of the minimal cut that has fewest of them there.

    Capacities: `back` (E,) from the second to the first node of `edges` (E, 2), none the other way; from the
    source to every node, and from every node to the sink (N,).
    """
    count = len(source)
    first = np.zeros(count + 3, np.int64)
    first[1 : count + 1] = 2
    first[count + 1] = first[count + 2] = count
    for edge in range(len(edges)):
        first[edges[edge, 0] + 1] += 1
        first[edges[edge, 1] + 1] += 1
    for node in range(count + 2):
        first[node + 1] += first[node]
    free = first[:-1].copy()
    head, twin = np.empty(first[-1], np.int64), np.empty(first[-1], np.int64)
    capacity = np.zeros(first[-1], np.int64)
    for arc in range(len(edges) + 2 * count):
        if arc < len(edges):
            tail, tip, worth = edges[arc, 1], edges[arc, 0], back[arc]
        elif arc < len(edges) + count:
            tail, tip, worth = count, arc - len(edges), source[arc - len(edges)]
        else:
            tail, tip = arc - len(edges) - count, count + 1
            worth = sink[tail]
        there, here = free[tail], free[tip]
        free[tail] += 1
        free[tip] += 1
        head[there], head[here] = tip, tail
        twin[there], twin[here] = here, there
        capacity[there] = np.int64(np.rint(worth * SCALE))
    side: Mask = source_side_kernel(first, head, twin, capacity)
    return side[:count]


@njit(cache=True)
def source_side_kernel(first: Integers, head: Integers, twin: Integers, capacity: Integers) -> Mask:
    """Nodes (V,) that the source still reaches when the flow to the sink is largest, after [dinic1970].

    Arcs `first[v]` to `first[v + 1]` leave node v for `head` with `capacity` left, which changes; `twin` is
    the way back. Source and sink are the last two nodes.
    """
    size = len(first) - 1
    source, sink = size - 2, size - 1
    level, queue = np.empty(size, np.int64), np.empty(size, np.int64)
    path, ahead = np.empty(size, np.int64), np.empty(size, np.int64)
    while True:
        level[:] = -1
        level[source], queue[0] = 0, source
        done, waiting = 0, 1
        while done < waiting:
            node = queue[done]
            done += 1
            for arc in range(first[node], first[node + 1]):
                if capacity[arc] > 0 and level[head[arc]] < 0:
                    level[head[arc]] = level[node] + 1
                    queue[waiting] = head[arc]
                    waiting += 1
        if level[sink] < 0:
            return level >= 0
        ahead[:] = first[:-1]
        node, depth = source, 0
        while True:
            if node == sink:
                push = capacity[path[0]]
                for step in range(1, depth):
                    push = min(push, capacity[path[step]])
                for step in range(depth - 1, -1, -1):
                    capacity[path[step]] -= push
                    capacity[twin[path[step]]] += push
                    if capacity[path[step]] == 0:
                        depth, node = step, head[twin[path[step]]]
                continue
            while ahead[node] < first[node + 1]:
                arc = ahead[node]
                if capacity[arc] > 0 and level[head[arc]] == level[node] + 1:
                    break
                ahead[node] += 1
            if ahead[node] < first[node + 1]:
                path[depth] = ahead[node]
                node = head[path[depth]]
                depth += 1
            elif node == source:
                break
            else:
                depth -= 1
                node = head[twin[path[depth]]]
                ahead[node] += 1
