"""Labels for the nodes of a graph: the cheapest by data, by borders and by the number of labels used."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from eaves.model import Mask, Values

Integers = NDArray[np.int64]

SCALE = 1e4
"""Costs become whole numbers for the flow: 1e-4 of the cost's unit is kept."""

LARGEST = 1e5
"""Costs above this are cut off; a label that costs so much is never taken."""

SWEEPS = 4
"""Rounds over all labels; the energy hardly falls after the second."""


@dataclass(frozen=True, eq=False)
class Jumps:
    """How much of its price a border between two planes costs: all where heights jump, less where they meet.

    `places` (E, S, 2) lie on each of E borders, `planes` (L, 3: a, b, c) are those of the labels. Where they
    meet a border costs the share `least`, where they are `full` (m) or more apart all of it. This is a
    metric of labels, which expansion moves need [boykov2001].
    """

    places: NDArray[np.float64]
    planes: NDArray[np.float64]
    least: float
    full: float

    def share(self, some: Integers | Mask, one: Integers, other: Integers) -> Values:
        """The share (K,) for `some` of the borders, between labels `one` and `other` (K,)."""
        step = self.planes[one] - self.planes[other]
        places = self.places[some]
        apart = np.abs(places[..., 0] * step[:, :1] + places[..., 1] * step[:, 1:2] + step[:, 2:])
        jump = np.minimum(apart / self.full, 1.0).mean(axis=1)
        return np.asarray(np.where(one == other, 0.0, self.least + (1.0 - self.least) * jump))


@dataclass(frozen=True, eq=False)
class Costs:
    """What labels cost: `data` (N, L) at each node, `border` (E,) along each of the `edges` (E, 2) when its
    ends differ, or the share of it that `jumps` says, `price` (L,) once for each label in use.
    """

    data: NDArray[np.float64]
    edges: Integers
    border: Values
    price: Values
    jumps: Jumps | None = None

    @classmethod
    def of(
        cls,
        data: NDArray[np.float64],
        edges: Integers,
        border: Values,
        price: Values,
        jumps: Jumps | None = None,
    ) -> Costs:
        """Costs with none above `LARGEST`, and each pair of nodes once if borders of a pair cost the same."""
        if jumps is None:
            edges, border = one_edge_per_pair(edges, border)
        bounded = data if data.max(initial=0.0) <= LARGEST else np.minimum(data, LARGEST)
        return cls(bounded, edges, border, price, jumps)

    def between(self, some: Integers | Mask, one: Integers, other: Integers) -> Values:
        """The price (K,) of `some` of the borders between labels `one` and `other` (K,)."""
        if self.jumps is None:
            return np.asarray(self.border[some] * (one != other))
        return np.asarray(self.border[some] * self.jumps.share(some, one, other))

    def of_labels(self, labels: Integers) -> float:
        """The sum that `label_nodes` makes small."""
        one, other = labels[self.edges[:, 0]], labels[self.edges[:, 1]]
        differs = np.flatnonzero(one != other)
        used = np.bincount(labels, minlength=len(self.price)) > 0
        data = self.data[np.arange(len(labels)), labels].sum()
        borders = self.between(differs, one[differs], other[differs])
        return float(data + borders.sum() + self.price[used].sum())

    def saved(self, before: Integers, after: Integers) -> float:
        """How much less labels cost `after` than `before` (N,), from the nodes that changed alone."""
        changed = before != after
        nodes = np.flatnonzero(changed)
        edges = np.flatnonzero(changed[self.edges].any(axis=1))
        one, other = self.edges[edges].T
        data = self.data[nodes, before[nodes]] - self.data[nodes, after[nodes]]
        borders = self.between(edges, before[one], before[other]) - self.between(
            edges, after[one], after[other]
        )
        old, new = (np.bincount(labels, minlength=len(self.price)) > 0 for labels in (before, after))
        prices = self.price * old - self.price * new
        return float(data.sum() + borders.sum() + prices.sum())

    def may_gain(self, labels: Integers) -> Values:
        """Cost (N,) above which a label cannot pay at a node: its label's and all its borders'."""
        around = np.bincount(self.edges.ravel(), np.repeat(self.border, 2), len(labels))
        return np.asarray(np.minimum(self.data[np.arange(len(labels)), labels] + around, LARGEST))


def label_nodes(
    data: NDArray[np.float64],
    edges: Integers,
    border: Values,
    price: Values,
    jumps: Jumps | None = None,
) -> Integers:
    """A label (N,) for each node, of low Σ data + Σ border over edges with two labels + Σ price of labels
    used.

    `data` (N, L) is the cost of each label at each node, `edges` (E, 2) join nodes, `border` (E,) is paid
    when their labels differ, or a share of it that depends on both by `jumps`, `price` (L,) once for each
    label in use. Expansion moves by minimal cuts [boykov2001], each among the nodes where its label can
    pay; then labels that cost more than they save are given up.
    """
    count, labels = data.shape
    costs = Costs.of(data, edges, border, price, jumps)
    current: Integers = np.argmin(costs.data, axis=1).astype(np.int64)
    if labels == 1 or count == 0:
        return current
    limit = costs.may_gain(current)
    open_labels = np.ones(labels, bool)
    for _ in range(SWEEPS):
        gained = 0.0
        for label in range(labels):
            if not open_labels[label]:
                continue
            open_labels[label] = False
            accepted = expand(costs, current, label, limit)
            gain = costs.saved(current, accepted)
            if gain > 1.0 / SCALE:
                gained += gain
                reopen(costs, current, accepted, open_labels)
                current, limit = accepted, costs.may_gain(accepted)
                open_labels[label] = False
        for label in np.unique(current).tolist():
            accepted = without_label(costs, current, label)
            gain = costs.saved(current, accepted)
            if gain > 1.0 / SCALE:
                gained += gain
                reopen(costs, current, accepted, open_labels)
                current, limit = accepted, costs.may_gain(accepted)
        if gained == 0.0:
            break
    return current


def reopen(costs: Costs, before: Integers, after: Integers, open_labels: Mask) -> None:
    """Opens the labels (L,) that may pay at a node that changed, or beside one."""
    touched = before != after
    beside = touched[costs.edges].any(axis=1)
    touched[costs.edges[beside].ravel()] = True
    open_labels |= (costs.data[touched] < costs.may_gain(after)[touched, None]).any(axis=0)


def expand(costs: Costs, labels: Integers, label: int, limit: Values) -> Integers:
    """The labels after the cheapest choice, for all nodes together, of keeping theirs or taking `label`.

    A node where the label costs more than `limit` (N,) gains nothing whatever its neighbours do, and keeps
    its own: the cut is made among the others.
    """
    free = (costs.data[:, label] < limit) & (labels != label)
    nodes = np.flatnonzero(free)
    answer = labels.copy()
    if len(nodes) == 0:
        return answer
    number = np.cumsum(free) - 1
    keep, take = costs.data[nodes, labels[nodes]], costs.data[nodes, label]
    ends = free[costs.edges]
    for side in (0, 1):
        alone = np.flatnonzero(ends[:, side] & ~ends[:, 1 - side])
        here, there = costs.edges[alone, side], costs.edges[alone, 1 - side]
        taken = np.full(len(alone), label)
        kept_border = costs.between(alone, labels[here], labels[there])
        keep = keep + np.bincount(number[here], kept_border, len(nodes))
        take = take + np.bincount(number[here], costs.between(alone, taken, labels[there]), len(nodes))
    both = np.flatnonzero(ends.all(axis=1))
    edges, taken = number[costs.edges[both]], np.full(len(both), label)
    one, other = labels[costs.edges[both, 0]], labels[costs.edges[both, 1]]
    # The cost of a pair is split into node and arc terms after [kolmogorov2004], table 2: it pays when both
    # keep theirs, when only the second takes the new one, when only the first does.
    neither = costs.between(both, one, other)
    second, first = costs.between(both, one, taken), costs.between(both, taken, other)
    take = take + np.bincount(edges[:, 0], first - neither, len(nodes))
    take = take - np.bincount(edges[:, 1], first, len(nodes))
    low = np.minimum(keep, take)
    # A node on the source's side takes the label; it then pays its arc to the sink.
    back = np.maximum(first + second - neither, 0.0)
    source_side = cut(edges, np.zeros(len(both)), back, keep - low, take - low)
    answer[nodes[source_side]] = label
    return answer


def cut(edges: Integers, there: Values, back: Values, source: Values, sink: Values) -> Mask:
    """The nodes (N,) on the source's side of the minimal cut.

    Capacities: `there` and `back` (E,) along the edges (E, 2), from the source to every node and from every
    node to the sink (N,).
    """
    count = len(source)
    nodes, one, other = np.arange(count), np.full(count, count), np.full(count, count + 1)
    tail = np.concatenate([edges[:, 0], one, nodes, edges[:, 1], nodes, other])
    head = np.concatenate([edges[:, 1], nodes, other, edges[:, 0], one, nodes])
    none = np.zeros(count)
    capacity = np.concatenate([there, source, sink, back, none, none])
    half = len(tail) // 2
    order = np.argsort(tail, kind="stable")
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    twin = place[np.where(order < half, order + half, order - half)]
    first = np.searchsorted(tail[order], np.arange(count + 3))
    whole = np.round(capacity[order] * SCALE).astype(np.int64)
    return np.asarray(source_side_kernel(first, head[order], twin, whole))[:count]


@njit(cache=True)
def source_side_kernel(first: Integers, head: Integers, twin: Integers, capacity: Integers) -> Mask:
    """Nodes (V,) that the source still reaches when the flow to the sink is largest, after [dinic1970].

    Arcs `first[v]` to `first[v + 1]` leave node v for `head` with `capacity` left, which changes; `twin` is
    the way back. Source and sink are the last two nodes.
    """
    size = len(first) - 1
    source, sink = size - 2, size - 1
    level, queue = np.empty(size, np.int64), np.empty(size, np.int64)
    path = np.empty(size, np.int64)
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
        ahead = first[:-1].copy()
        node, depth = source, 0
        while True:
            if node == sink:
                push = capacity[path[:depth]].min()
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


def one_edge_per_pair(edges: Integers, border: Values) -> tuple[Integers, Values]:
    """The pairs of nodes (E, 2) that edges join, each once, and the sum of their prices (E,)."""
    if len(edges) == 0:
        return edges, border
    pairs, number = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    return pairs, np.asarray(np.bincount(number.ravel(), border, len(pairs)), np.float64)


def without_label(costs: Costs, labels: Integers, label: int) -> Integers:
    """The labels after every node with `label` took the cheapest other one in use, given its neighbours."""
    mine = np.flatnonzero(labels == label)
    used = np.bincount(labels, minlength=len(costs.price)) > 0
    used[label] = False
    others = np.flatnonzero(used & (costs.data[mine].min(axis=0, initial=LARGEST) < LARGEST))
    answer = labels.copy()
    if len(others) == 0:
        return answer
    row = np.full(len(labels), -1)
    row[mine] = np.arange(len(mine))
    total = costs.data[np.ix_(mine, others)]
    for a, b in ((0, 1), (1, 0)):
        here, there = costs.edges[:, a], costs.edges[:, b]
        some = np.flatnonzero((row[here] >= 0) & (row[there] < 0))
        borders = np.repeat(some, len(others))
        choice, beside = np.tile(others, len(some)), np.repeat(labels[there[some]], len(others))
        paid = costs.between(borders, choice, beside).reshape(len(some), len(others))
        np.add.at(total, row[here[some]], paid)
    answer[mine] = others[np.argmin(total, axis=1)]
    return answer
