"""Labels for the nodes of a graph: the cheapest by data, by borders and by the number of labels used."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

from eaves.model import Values

Integers = NDArray[np.int64]

SCALE = 1e4
"""Costs become whole numbers for the flow: 1e-4 of the cost's unit is kept."""

LARGEST = 1e5
"""Costs above this are cut off, so that sums stay within 32 bits."""

SWEEPS = 4
"""Rounds over all labels; the energy hardly falls after the second."""


def label_nodes(
    data: NDArray[np.float64], edges: Integers, border: Values, price: Values, start: Integers | None = None
) -> Integers:
    """A label (N,) for each node, of low Σ data + Σ border over edges with two labels + Σ price of labels
    used.

    `data` (N, L) is the cost of each label at each node, `edges` (E, 2) join nodes, `border` (E,) is paid
    when their labels differ, `price` (L,) once for each label in use. Expansion moves by minimal cuts
    [boykov2001], then labels that cost more than they save are given up.
    """
    count, labels = data.shape
    cost = np.minimum(data, LARGEST)
    current = np.argmin(cost, axis=1).astype(np.int64) if start is None else start.copy()
    if labels == 1 or count == 0:
        return current
    edges, border = one_edge_per_pair(edges, border)
    network = Network.of(count, edges)
    best = energy_of(cost, edges, border, price, current)
    gain = np.bincount(edges.ravel(), np.repeat(border, 2), count)
    settled = np.zeros(labels, bool)
    for _ in range(SWEEPS):
        before = best
        for label in range(labels):
            here = cost[np.arange(count), current]
            if settled[label] or not np.any((cost[:, label] < here + gain) & (current != label)):
                continue
            settled[label] = True
            moved = expand(network, cost, edges, border, current, label)
            energy = energy_of(cost, edges, border, price, moved)
            if energy < best - 1.0 / SCALE:
                current, best = moved, energy
                settled[:] = False
                settled[label] = True
        for label in np.unique(current).tolist():
            moved = without_label(cost, edges, border, current, label)
            energy = energy_of(cost, edges, border, price, moved)
            if energy < best - 1.0 / SCALE:
                current, best = moved, energy
                settled[:] = False
        if best > before - 1.0 / SCALE:
            break
    return current


def energy_of(
    cost: NDArray[np.float64], edges: Integers, border: Values, price: Values, labels: Integers
) -> float:
    """The sum that `label_nodes` makes small."""
    differs = labels[edges[:, 0]] != labels[edges[:, 1]]
    data = cost[np.arange(len(labels)), labels].sum()
    return float(data + border[differs].sum() + price[np.unique(labels)].sum())


@dataclass(frozen=True, eq=False)
class Network:
    """The arcs of the flow problem, made once: only their capacities change from cut to cut.

    Arcs run between the nodes of each edge, both ways, from the source to every node and from every node
    to the sink, and back. `order` puts capacities in that sequence into the rows of the matrix.
    """

    order: Integers
    columns: NDArray[np.int32]
    first: NDArray[np.int32]

    @classmethod
    def of(cls, count: int, edges: Integers) -> Network:
        """The network over `count` nodes joined by `edges` (E, 2), each pair once."""
        nodes, source, sink = np.arange(count), np.full(count, count), np.full(count, count + 1)
        rows = np.concatenate([edges[:, 0], edges[:, 1], source, nodes, nodes, sink])
        columns = np.concatenate([edges[:, 1], edges[:, 0], nodes, source, sink, nodes])
        order = np.lexsort((columns, rows))
        first = np.searchsorted(rows[order], np.arange(count + 3))
        return cls(order, columns[order].astype(np.int32), first.astype(np.int32))

    def cut(self, capacity: Values) -> Integers:
        """The nodes on the source's side of the minimal cut under capacities (A,), in the sequence of the
        arcs.
        """
        size = len(self.first) - 1
        whole = np.minimum(np.round(capacity[self.order] * SCALE), 1e9).astype(np.int32)
        graph = csr_array((whole, self.columns, self.first), shape=(size, size))
        flow = csr_array(maximum_flow(graph, size - 2, size - 1).flow)
        residual = csr_array((whole - flow.data, self.columns.copy(), self.first.copy()), shape=(size, size))
        residual.eliminate_zeros()
        reached = breadth_first_order(residual, size - 2, return_predecessors=False)
        return np.asarray(reached[reached < size - 2], np.int64)


def expand(
    network: Network,
    cost: NDArray[np.float64],
    edges: Integers,
    border: Values,
    labels: Integers,
    label: int,
) -> Integers:
    """The labels after the cheapest choice, for all nodes together, of keeping theirs or taking `label`."""
    count = len(labels)
    keep, take = cost[np.arange(count), labels].copy(), cost[:, label].copy()
    fixed = labels == label
    keep[fixed] = LARGEST
    take[fixed] = 0.0
    same = labels[edges[:, 0]] == labels[edges[:, 1]]
    # A pair with two labels pays unless both take the new one: its cost is split into node and arc terms
    # after [kolmogorov2004], table 2.
    take -= np.bincount(edges[~same, 1], border[~same], count)
    low = np.minimum(keep, take)
    none = np.zeros(count)
    # A node on the source's side takes the label; it then pays its arc to the sink.
    capacity = [np.where(same, border, 0.0), border, keep - low, none, take - low, none]
    answer = labels.copy()
    answer[network.cut(np.concatenate(capacity))] = label
    return answer


def one_edge_per_pair(edges: Integers, border: Values) -> tuple[Integers, Values]:
    """The pairs of nodes (E, 2) that edges join, each once, and the sum of their prices (E,)."""
    if len(edges) == 0:
        return edges, border
    pairs, number = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    return pairs, np.asarray(np.bincount(number.ravel(), border, len(pairs)), np.float64)


def without_label(
    cost: NDArray[np.float64], edges: Integers, border: Values, labels: Integers, label: int
) -> Integers:
    """The labels after every node with `label` took the cheapest other one in use, given its neighbours."""
    others = np.setdiff1d(np.unique(labels), [label])
    answer = labels.copy()
    if len(others) == 0:
        return answer
    mine = labels == label
    position = {int(other): number for number, other in enumerate(others)}
    total = cost[:, others].copy()
    for a, b in ((0, 1), (1, 0)):
        here, there = edges[:, a], edges[:, b]
        counts = mine[here] & ~mine[there]
        column = np.array([position[int(other)] for other in labels[there[counts]]], np.int64)
        np.subtract.at(total, (here[counts], column), border[counts])
    answer[mine] = others[np.argmin(total[mine], axis=1)]
    return answer
