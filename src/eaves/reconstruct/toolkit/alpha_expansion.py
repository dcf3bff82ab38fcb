"""Labels for the nodes of a graph: the cheapest by data, by borders and by the number of labels used."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from eaves.model import Mask, Values
from eaves.reconstruct.toolkit.minimal_cut import SCALE, minimal_cut_kernel

Integers = NDArray[np.int64]

LARGEST = 1e5
"""Costs above this are cut off; a label that costs so much is never taken."""

LEAST_GAIN = 1.0 / SCALE
"""Moves that gain no more than this are not made: the cut does not see it."""

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


class Costs(NamedTuple):
    """What labels cost: `data` (N, L) at each node, `border` (E,) along each of the `edges` (E, 2) when its
    ends differ, or the share of it that the jump between its planes says, `price` (L,) once for each label in
    use.

    `places`, `planes`, `least`, `full` are those of `Jumps`, without planes when there are none. The rest is
    drawn from these once, for the moves: `around` (N,) the sum of a node's borders; the edges that have node
    n first, `beside[0, first[0, n] : first[0, n + 1]]`, and second, the same of row 1, in their order; the
    nodes that can have label l, `nodes[start[l] : start[l + 1]]`.
    """

    data: NDArray[np.float64]
    edges: Integers
    border: Values
    price: Values
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
    data: NDArray[np.float64], edges: Integers, border: Values, price: Values, jumps: Jumps | None = None
) -> Costs:
    """Costs with none above `LARGEST`, and each pair of nodes once if borders of a pair cost the same."""
    if jumps is None:
        edges, border = one_edge_per_pair(edges, border)
        jumps = Jumps(np.zeros((len(edges), 0, 2)), np.zeros((0, 3)), 0.0, 1.0)
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
        np.asarray(border, np.float64),
        np.asarray(price, np.float64),
        np.ascontiguousarray(jumps.places, np.float64),
        np.ascontiguousarray(jumps.planes, np.float64),
        float(jumps.least),
        float(jumps.full),
        np.asarray(np.bincount(edges.ravel(), np.repeat(border, 2), count), np.float64),
        np.array(first),
        np.array(order),
        np.searchsorted(label, np.arange(len(price) + 1)).astype(np.int64),
        nodes.astype(np.int64),
    )


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
    current: Integers = np.argmin(np.minimum(data, LARGEST), axis=1).astype(np.int64)
    if labels > 1 and count > 0:
        lower_kernel(costs_of(data, edges, border, price, jumps), current)
    return current


def one_edge_per_pair(edges: Integers, border: Values) -> tuple[Integers, Values]:
    """The pairs of nodes (E, 2) that edges join, each once, and the sum of their prices (E,)."""
    if len(edges) == 0:
        return edges, border
    pairs, number = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    return pairs, np.asarray(np.bincount(number.ravel(), border, len(pairs)), np.float64)


@njit(cache=True)
def lower_kernel(costs: Costs, labels: Integers) -> None:
    """Lowers the energy of the labels (N,), which change, by expansions and by giving labels up."""
    count = len(costs.price)
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


@njit(cache=True)
def border_kernel(costs: Costs, edge: int, one: int, other: int) -> float:
    """The price of an edge between two labels."""
    if one == other:
        return 0.0
    if len(costs.planes) == 0:
        return float(costs.border[edge])
    a = costs.planes[one, 0] - costs.planes[other, 0]
    b = costs.planes[one, 1] - costs.planes[other, 1]
    c = costs.planes[one, 2] - costs.planes[other, 2]
    jump = 0.0
    for place in range(costs.places.shape[1]):
        apart = abs(costs.places[edge, place, 0] * a + costs.places[edge, place, 1] * b + c)
        jump += min(apart / costs.full, 1.0)
    jump /= costs.places.shape[1]
    return float(costs.border[edge] * (costs.least + (1.0 - costs.least) * jump))


@njit(cache=True)
def most_kernel(costs: Costs, labels: Integers, node: int) -> float:
    """The cost above which no label can pay at a node: its label's and all its borders'."""
    return float(min(costs.data[node, labels[node]] + costs.around[node], LARGEST))


@njit(cache=True)
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
                own = border_kernel(costs, edge, labels[node], labels[other])
                if number[other] < 0:
                    kept += own
                    taken += border_kernel(costs, edge, label, labels[other])
                    continue
                # The cost of a pair is split into node and arc terms after [kolmogorov2004], table 2: it pays
                # when both keep theirs, when only the second takes the new one, when only the first does.
                if side == 1:
                    there[1] += border_kernel(costs, edge, label, labels[node])
                    continue
                first = border_kernel(costs, edge, label, labels[other])
                second = border_kernel(costs, edge, labels[node], label)
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


@njit(cache=True)
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
                        total += border_kernel(costs, edge, choice, beside)
            if total < least:
                best, least = choice, total
        after[node] = best
    return mine


@njit(cache=True)
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
                    gain += border_kernel(costs, edge, labels[node], labels[other])
                    gain -= border_kernel(costs, edge, after[node], after[other])
    before = uses.copy()
    for node in changed:
        uses[labels[node]] -= 1
        uses[after[node]] += 1
    for node in changed:
        for label in (labels[node], after[node]):
            if before[label] >= 0:
                gain += costs.price[label] * (min(before[label], 1) - min(uses[label], 1))
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


@njit(cache=True)
def open_kernel(costs: Costs, node: int, limit: Values, open_labels: Mask) -> None:
    """Opens the labels (L,) that can pay at a node."""
    for label in range(len(open_labels)):
        open_labels[label] |= costs.data[node, label] < limit[node]
