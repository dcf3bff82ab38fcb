"""Labels for the nodes of a graph by expansion moves, each a minimal cut."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import kernel
from eaves.model import Mask, Values

Integers = NDArray[np.int64]

SCALE = 1e4
"""Capacities become whole numbers for the flow: 1e-4 of their unit is kept."""

LARGEST = 1e5
"""Costs above this are cut off; a label that costs so much is never taken."""

LEAST_GAIN = 1.0 / SCALE
"""Moves that gain no more than this are not made: the cut does not see it."""

SWEEPS = 4
"""Rounds over all labels; the energy hardly falls after the second."""


@dataclass(frozen=True, eq=False)
class HeightSteps:
    """The share of its cost that a border between two planes has: all where heights step, less where they
    meet.

    `places` (E, S, 2) lie on each of E borders, `planes` (L, 3: a, b, c) are those of the labels. Where they
    meet a border costs the share `least`, where they are `full` (m) or more apart all of it. This is a
    metric of labels, which expansion moves need [boykov2001].
    """

    places: NDArray[np.float64]
    planes: NDArray[np.float64]
    least: float
    full: float


class Costs(NamedTuple):
    """The energy of labels: `data` (N, L) at each node, `smoothness_cost` (E,) along each of the `edges`
    (E, 2) when its ends differ, or the share of it that the step between its planes gives, `label_cost` (L,)
    once for each label in use.

    `places`, `planes`, `least`, `full` are those of `HeightSteps`, without planes when there are none. The
    rest is computed from these once, for the moves: `around` (N,) the sum of a node's smoothness costs; the
    edges that have node n first, `beside[0, first[0, n] : first[0, n + 1]]`, and second, the same of row 1,
    in their order; the nodes that can have label l, `nodes[start[l] : start[l + 1]]`.
    """

    data: NDArray[np.float64]
    edges: Integers
    smoothness_cost: Values
    label_cost: Values
    places: NDArray[np.float64]
    planes: NDArray[np.float64]
    least: float
    full: float
    around: Values
    first: Integers
    beside: Integers
    start: Integers
    nodes: Integers


def costs_of(
    data: NDArray[np.float64],
    edges: Integers,
    smoothness_cost: Values,
    label_cost: Values,
    steps: HeightSteps | None = None,
) -> Costs:
    """Costs with none above `LARGEST`, and each pair of nodes once if borders of a pair cost the same."""
    if steps is None:
        edges, smoothness_cost = one_edge_per_pair(edges, smoothness_cost)
        steps = HeightSteps(np.zeros((len(edges), 0, 2)), np.zeros((0, 3)), 0.0, 1.0)
    count = len(data)
    bounded = data if data.max(initial=0.0) <= LARGEST else np.minimum(data, LARGEST)
    edges = np.ascontiguousarray(edges, np.int64)
    order = [np.argsort(edges[:, side], kind="stable") for side in (0, 1)]
    first = [
        np.searchsorted(edges[order[side], side], np.arange(count + 1)).astype(np.int64) for side in (0, 1)
    ]
    label, nodes = np.nonzero(bounded.T < LARGEST)
    return Costs(
        np.ascontiguousarray(bounded, np.float64),
        edges,
        np.asarray(smoothness_cost, np.float64),
        np.asarray(label_cost, np.float64),
        np.ascontiguousarray(steps.places, np.float64),
        np.ascontiguousarray(steps.planes, np.float64),
        float(steps.least),
        float(steps.full),
        np.asarray(np.bincount(edges.ravel(), np.repeat(smoothness_cost, 2), count), np.float64),
        np.array(first),
        np.array(order),
        np.searchsorted(label, np.arange(len(label_cost) + 1)).astype(np.int64),
        nodes.astype(np.int64),
    )


def alpha_expansion(
    data: NDArray[np.float64],
    edges: Integers,
    smoothness_cost: Values,
    label_cost: Values,
    steps: HeightSteps | None = None,
) -> Integers:
    """A label (N,) for each node, of low Σ data + Σ smoothness cost over edges with two labels + Σ label cost
    of labels used.

    `data` (N, L) is the cost of each label at each node, `edges` (E, 2) join nodes, `smoothness_cost` (E,)
    counts when their labels differ, or a share of it that depends on both by `steps`, `label_cost` (L,) once
    for each label in use. Expansion moves by minimal cuts [boykov2001], each among the nodes where its label
    can pay; then labels that cost more than they save are given up.
    """
    count, labels = data.shape
    current: Integers = np.argmin(np.minimum(data, LARGEST), axis=1).astype(np.int64)
    if labels > 1 and count > 0:
        lower_kernel(costs_of(data, edges, smoothness_cost, label_cost, steps), current)
    return current


def one_edge_per_pair(edges: Integers, smoothness_cost: Values) -> tuple[Integers, Values]:
    """The pairs of nodes (E, 2) that edges join, each once, and the sum of their costs (E,)."""
    if len(edges) == 0:
        return edges, smoothness_cost
    pairs, number = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    return pairs, np.asarray(np.bincount(number.ravel(), smoothness_cost, len(pairs)), np.float64)


@kernel
def lower_kernel(costs: Costs, labels: Integers) -> None:
    """Lowers the energy of the labels (N,), which change, by expansions and by giving labels up."""
    count = len(costs.label_cost)
    limit = np.empty(len(labels))
    for node in range(len(labels)):
        limit[node] = most_kernel(costs, labels, node)
    uses = np.bincount(labels, minlength=count)
    open_labels = np.ones(count, np.bool_)
    after = labels.copy()
    number = np.full(len(labels), -1)
    for _ in range(SWEEPS):
        lowered = False
        for label in range(count):
            if open_labels[label]:
                open_labels[label] = False
                changed = expand_kernel(costs, labels, label, limit, number)
                after[changed] = label
                if move_kernel(costs, labels, after, changed, uses, limit, open_labels):
                    lowered = True
                    open_labels[label] = False
        for used in np.flatnonzero(uses):
            changed = give_up_kernel(costs, labels, used, uses, after)
            if move_kernel(costs, labels, after, changed, uses, limit, open_labels):
                lowered = True
        if not lowered:
            break


@kernel
def smoothness_kernel(costs: Costs, edge: int, one: int, other: int) -> float:
    """The price of an edge between two labels."""
    if one == other:
        return 0.0
    if len(costs.planes) == 0:
        return float(costs.smoothness_cost[edge])
    a = costs.planes[one, 0] - costs.planes[other, 0]
    b = costs.planes[one, 1] - costs.planes[other, 1]
    c = costs.planes[one, 2] - costs.planes[other, 2]
    jump = 0.0
    for place in range(costs.places.shape[1]):
        apart = abs(costs.places[edge, place, 0] * a + costs.places[edge, place, 1] * b + c)
        jump += min(apart / costs.full, 1.0)
    jump /= costs.places.shape[1]
    return float(costs.smoothness_cost[edge] * (costs.least + (1.0 - costs.least) * jump))


@kernel
def most_kernel(costs: Costs, labels: Integers, node: int) -> float:
    """The cost above which no label can pay at a node: its label's and all its borders'."""
    return float(min(costs.data[node, labels[node]] + costs.around[node], LARGEST))


@kernel
def expand_kernel(costs: Costs, labels: Integers, label: int, limit: Values, number: Integers) -> Integers:
    """The nodes that take `label` in the cheapest choice, for all nodes together, of keeping theirs or taking
    it.

    A node where the label costs more than `limit` (N,) gains nothing whatever its neighbours do, and keeps
    its own: the cut is made among the others. `number` (N,) is -1, before and after.
    """
    nodes = costs.nodes[costs.start[label] : costs.start[label + 1]]
    free = np.empty(len(nodes), np.int64)
    count, pairs = 0, 0
    for node in nodes:
        if costs.data[node, label] < limit[node] and labels[node] != label:
            free[count], number[node] = node, count
            count += 1
            pairs += costs.first[0, node + 1] - costs.first[0, node]
    free = free[:count]
    edges, back = np.empty((pairs, 2), np.int64), np.empty(pairs)
    source, sink = np.empty(count), np.empty(count)
    pairs = 0
    for node in free:
        keep, take = costs.data[node, labels[node]], costs.data[node, label]
        there = np.zeros(2)
        for side in range(2):
            kept, taken = 0.0, 0.0
            for edge in costs.beside[side, costs.first[side, node] : costs.first[side, node + 1]]:
                other = costs.edges[edge, 1 - side]
                own = smoothness_kernel(costs, edge, labels[node], labels[other])
                if number[other] < 0:
                    kept += own
                    taken += smoothness_kernel(costs, edge, label, labels[other])
                    continue
                # The cost of a pair is split into node and arc terms after [kolmogorov2004], table 2: it pays
                # when both keep theirs, when only the second takes the new one, when only the first does.
                if side == 1:
                    there[1] += smoothness_kernel(costs, edge, label, labels[node])
                    continue
                first = smoothness_kernel(costs, edge, label, labels[other])
                second = smoothness_kernel(costs, edge, labels[node], label)
                there[0] += first - own
                edges[pairs, 0], edges[pairs, 1] = number[node], number[other]
                # A node on the source's side takes the label; it then pays its arc to the sink.
                back[pairs] = max(first + second - own, 0.0)
                pairs += 1
            keep += kept
            take += taken
        take = take + there[0] - there[1]
        low = min(keep, take)
        source[number[node]], sink[number[node]] = keep - low, take - low
    number[free] = -1
    joining: Integers = free[minimal_cut_kernel(edges[:pairs], back[:pairs], source, sink)]
    return joining


@kernel
def give_up_kernel(costs: Costs, labels: Integers, label: int, uses: Integers, after: Integers) -> Integers:
    """The nodes with `label`; in `after` (N,) each takes the cheapest other label in use, given its
    neighbours.
    """
    mine = np.flatnonzero(labels == label)
    others = np.zeros(len(uses), np.bool_)
    for node in mine:
        for other in range(len(uses)):
            others[other] |= costs.data[node, other] < LARGEST
    choices = np.flatnonzero(others & (uses > 0) & (np.arange(len(uses)) != label))
    if len(choices) == 0:
        return mine[:0]
    for node in mine:
        best, least = choices[0], np.inf
        for choice in choices:
            total = costs.data[node, choice]
            for side in range(2):
                for edge in costs.beside[side, costs.first[side, node] : costs.first[side, node + 1]]:
                    beside = labels[costs.edges[edge, 1 - side]]
                    if beside != label:
                        total += smoothness_kernel(costs, edge, choice, beside)
            if total < least:
                best, least = choice, total
        after[node] = best
    return mine


@kernel
def move_kernel(
    costs: Costs,
    labels: Integers,
    after: Integers,
    changed: Integers,
    uses: Integers,
    limit: Values,
    open_labels: Mask,
) -> bool:
    """Whether the labels `after` (N,) a move cost less; if so they become the `labels`, if not the reverse.

    `changed` are the nodes that differ. With them change the `uses` of labels (L,), the `limit` (N,) of costs
    that can pay, and the labels open to expansion: those that can pay at a node that changed, or beside one.
    """
    gain = 0.0
    for node in changed:
        gain += costs.data[node, labels[node]] - costs.data[node, after[node]]
        for side in range(2):
            for edge in costs.beside[side, costs.first[side, node] : costs.first[side, node + 1]]:
                other = costs.edges[edge, 1 - side]
                if side == 0 or after[other] == labels[other]:
                    gain += smoothness_kernel(costs, edge, labels[node], labels[other])
                    gain -= smoothness_kernel(costs, edge, after[node], after[other])
    before = uses.copy()
    for node in changed:
        uses[labels[node]] -= 1
        uses[after[node]] += 1
    for node in changed:
        for label in (labels[node], after[node]):
            if before[label] >= 0:
                gain += costs.label_cost[label] * (min(before[label], 1) - min(uses[label], 1))
                before[label] = -1
    if not gain > LEAST_GAIN:
        for node in changed:
            uses[labels[node]] += 1
            uses[after[node]] -= 1
            after[node] = labels[node]
        return False
    for node in changed:
        labels[node] = after[node]
    for node in changed:
        limit[node] = most_kernel(costs, labels, node)
    for node in changed:
        open_kernel(costs, node, limit, open_labels)
        for side in range(2):
            for edge in costs.beside[side, costs.first[side, node] : costs.first[side, node + 1]]:
                open_kernel(costs, costs.edges[edge, 1 - side], limit, open_labels)
    return True


@kernel
def open_kernel(costs: Costs, node: int, limit: Values, open_labels: Mask) -> None:
    """Opens the labels (L,) that can pay at a node."""
    for label in range(len(open_labels)):
        open_labels[label] |= costs.data[node, label] < limit[node]


@kernel
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


@kernel
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
