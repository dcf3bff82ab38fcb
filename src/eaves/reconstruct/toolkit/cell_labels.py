"""Assignment of planes to the cells of a plan: fit of their points, length of borders, a price per face."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from pydantic import BaseModel

from eaves.kernels import inlined_kernel, kernel
from eaves.methods import parameter
from eaves.model import Integers, Labels, Mask, Points, Values
from eaves.reconstruct.toolkit.ceiling import rise_over, spread_kernel
from eaves.solids.coverage import MOST_ROUNDS, OUTSIDE, Coverage
from eaves.solids.extrude import LOWEST_ROOF
from eaves.solids.soundness import LOWEST_WALL

MOST, LARGEST = 99999.0, 1e5
"""Highest cost of a label that a node may take, and the cost of one that is never taken."""

LEAST_GAIN = 1e-4
"""Moves that gain no more than this are not made."""

NODE, REGION = range(2)
"""A move to another label: of a node, or of all of its label that hangs together with it."""


class Borders(NamedTuple):
    """The `edges` (E, 2) between nodes, with what each costs (E,) when its ends have two labels: the share
    `least` of it where the planes (L, 3: a, b, c) of the labels meet at its `places` (E, S, 2), all of it
    where they are `full` (m) or more apart.
    """

    edges: Integers
    cost: Values
    places: Values
    planes: Values
    least: float
    full: float


def label_nodes(
    data: Values, borders: Borders, region_cost: float, labels: Integers | None = None
) -> Integers:
    """A label (N,) for each node, of low Σ data + Σ costs of borders between labels + Σ costs of regions,
    each all of one label that hangs together; reached from `labels` (N,) where they are known.

    `data` (N, L) is the cost of each label at each node. The nodes choose one after the other, those first
    for which it makes most difference. Then nodes and regions move to the label that is cheapest for them, as
    long as that lowers the sum. Moves of regions leave the minima in which single nodes are caught. That a
    move may cut a region in two is not priced.
    """
    second = np.partition(data, min(1, data.shape[1] - 1), axis=1)[:, :2]
    order = np.argsort(second[:, 0] - second[:, -1], kind="stable")[: len(data) if labels is None else 0]
    labels = np.full(len(data), OUTSIDE) if labels is None else labels.copy()
    ends = borders.edges.ravel()
    around = np.argsort(ends, kind="stable") // 2
    first = np.searchsorted(np.sort(ends), np.arange(len(data) + 1))
    most = data.min(axis=1) + region_cost + np.bincount(ends, np.repeat(borders.cost, 2), len(data))
    settle_kernel(data, borders, region_cost, around, first, order, np.minimum(most, MOST), labels)
    return labels


@inlined_kernel
def border_kernel(borders: Borders, edge: int, first: int, second: int) -> Any:
    """The cost of an edge between two labels."""
    if first == second or second == OUTSIDE:
        return 0.0
    a = borders.planes[first, 0] - borders.planes[second, 0]
    b = borders.planes[first, 1] - borders.planes[second, 1]
    c = borders.planes[first, 2] - borders.planes[second, 2]
    jump, count, places = 0.0, borders.places.shape[1], borders.places
    for place in range(count):
        away = abs(places[edge, place, 0] * a + places[edge, place, 1] * b + c)
        jump += min(away / borders.full, 1.0) / count
    return float(borders.cost[edge] * (borders.least + (1.0 - borders.least) * jump))


@kernel
def settle_kernel(
    data: Values,
    borders: Borders,
    region_cost: float,
    around: Integers,
    first: Integers,
    order: Integers,
    most: Values,
    labels: Integers,
) -> None:
    """Chooses the `labels` (N,), in their `order` (N,), and moves them until no move lowers the sum; the
    edges of node n are `around[first[n]]` to `around[first[n + 1]]`. A label that costs node n more than
    `most[n]` is none for it: it would leave it at once, whatever is around.
    """
    group, stamp, turn = np.full(len(labels), -1), np.full(len(labels), -1), 0
    rim, beside = np.empty((len(around), 2), np.int64), np.zeros(data.shape[1], np.bool_)
    start, may = np.zeros(len(labels) + 1, np.int64), np.empty(data.size, np.int64)
    for node in range(len(labels)):
        free = np.flatnonzero(data[node] <= most[node])
        start[node + 1] = start[node] + len(free)
        may[start[node] : start[node + 1]] = free
    for node in order:
        group[0], stamp[node] = node, turn
        length = rim_kernel(borders.edges, around, first, group, 1, stamp, rim)
        args = (data, borders, labels, group, 1, rim, length)
        labels[node] = cheapest_kernel(*args, may[start[node] : start[node + 1]], 0, np.inf, 0.0, beside)
        turn += 1
    # when a node last moved, and when a seed last stayed
    moved, stayed = np.full(len(labels), -1), np.full((REGION + 1, len(labels)), -2)
    for _ in range(MOST_ROUNDS):
        settled = True
        for kind in (NODE, REGION):
            begin = turn
            for seed in range(len(labels)):
                if stamp[seed] >= begin:
                    continue
                current, size = labels[seed], 1
                group[0], stamp[seed] = seed, turn
                cursor = 0
                while kind == REGION and cursor < size:
                    for place in range(first[group[cursor]], first[group[cursor] + 1]):
                        edge = around[place]
                        node = borders.edges[edge, 0] + borders.edges[edge, 1] - group[cursor]
                        if labels[node] == current and stamp[node] < begin:
                            group[size], stamp[node] = node, turn
                            size += 1
                    cursor += 1
                length = rim_kernel(borders.edges, around, first, group, size, stamp, rim)
                latest = -1
                for place in range(length):
                    latest = max(latest, moved[rim[place, 1]])
                if latest <= stayed[kind, seed]:  # nothing that the costs follow from is another than then
                    turn += 1
                    continue
                args = (data, borders, labels, group, size, rim, length)
                least = cost_kernel(*args, current, np.inf, region_cost) - LEAST_GAIN
                choice = may[start[seed] : start[seed + 1]]
                best = cheapest_kernel(*args, choice, current, least, region_cost, beside)
                if best == current:
                    stayed[kind, seed] = turn
                else:
                    settled = False
                    for member in range(size):
                        labels[group[member]], moved[group[member]] = best, turn
                turn += 1
        if settled:
            break


@kernel
def cheapest_kernel(
    data: Values,
    borders: Borders,
    labels: Integers,
    group: Integers,
    size: int,
    rim: Integers,
    length: int,
    may: Integers,
    best: int,
    least: float,
    region_cost: float,
    beside: Mask,
) -> int:
    """The label among those a group `may` have (K,) that costs it least (`cost_kernel`), the first of equals,
    or the `best` known, which costs the `least`; `beside` (L,) is false, before and after.

    A label that no neighbour has pays at least the region and the least share of all borders: of most planes
    that is more than a neighbour's label costs, and nothing further is asked of them.
    """
    floor, most = region_cost - LEAST_GAIN, least
    for place in range(length):
        edge, label = rim[place, 0], labels[rim[place, 1]]
        if label != OUTSIDE:
            floor += borders.least * borders.cost[edge]
            if not beside[label]:
                beside[label] = True
                most = min(
                    most,
                    cost_kernel(data, borders, labels, group, size, rim, length, label, most, region_cost),
                )
    for label in may:
        if data[group[0], label] < least and (beside[label] or data[group[0], label] + floor < most):
            cost = cost_kernel(data, borders, labels, group, size, rim, length, label, least, region_cost)
            if cost < least:
                best, least = label, cost
    for place in range(length):
        if labels[rim[place, 1]] != OUTSIDE:
            beside[labels[rim[place, 1]]] = False
    return best


@kernel
def rim_kernel(
    edges: Integers,
    around: Integers,
    first: Integers,
    group: Integers,
    size: int,
    stamp: Integers,
    rim: Integers,
) -> int:
    """Number of edges that lead out of the first `size` nodes of a group, which bear the last `stamp`; those
    and the nodes that they lead to go into `rim` (E, 2)."""
    length, turn = 0, stamp[group[0]]
    for member in range(size):
        node = group[member]
        for place in range(first[node], first[node + 1]):
            neighbour = edges[around[place], 0] + edges[around[place], 1] - node
            if stamp[neighbour] != turn:
                rim[length, 0], rim[length, 1] = around[place], neighbour
                length += 1
    return length


@kernel
def cost_kernel(
    data: Values,
    borders: Borders,
    labels: Integers,
    group: Integers,
    size: int,
    rim: Integers,
    length: int,
    label: int,
    most: float,
    region_cost: float,
) -> float:
    """The cost of a label to the first `size` nodes of a group and to the first `length` edges of their
    `rim`, and of a region where no neighbour has the label; no less than `most` where it is more."""
    total = region_cost
    for place in range(length):
        if labels[rim[place, 1]] == label:
            total = 0.0
    for member in range(size):
        total += data[group[member], label]
        if total >= most:
            return float(total)
    for place in range(length):
        total += border_kernel(borders, rim[place, 0], label, labels[rim[place, 1]])
        if total >= most:
            return float(total)
    return float(total)


NORMAL_MEDIAN = 0.6745
"""Median distance from the mean of a normal distribution, in standard deviations."""

RUNAWAY = 1e3
"""Cost (m²) of a metre under the lowest roof, or over what was seen: more than any residual."""

GAUSS_PLACES = 0.5 + 0.5 * np.polynomial.legendre.leggauss(2)[0]
"""Places along a border at which its jump is measured: the two of Gauss-Legendre quadrature."""


class LabelCosts(BaseModel):
    """The costs of labels: parameters of a method that labels cells."""

    residual_limit: float = parameter(
        0.45,
        "Largest distance from a plane at which a point's residual stops growing; a border with such a jump "
        "has its full price.",
        unit="m",
        gt=0.0,
    )
    residual_share: float = parameter(
        10.0,
        "Distance at which it stops growing, in multiples of the scatter of the roof's points about their "
        "planes: what sags a little stays on its plane.",
        symbol="T",
        gt=0.0,
    )
    gross_limit: float = parameter(
        2.0, "Distance at which a point's gross residual, added, stops growing.", unit="m", symbol="g", gt=0.0
    )
    border_cost: float = parameter(
        0.3,
        "Price of a metre of border with a jump, as square metres of residual.",
        unit="m",
        symbol="β",
        ge=0.0,
    )
    meeting_share: float = parameter(
        0.2,
        "Share of the price of a border that is due where the two planes meet: ridges and valleys are cheap.",
        ge=0.0,
        le=1.0,
    )
    plane_points: float = parameter(
        4.0,
        "Price of a plane, of where a face lies, and of a corner, in points: three numbers are worth stating "
        "when they explain so many.",
        symbol="γ",
        ge=0.0,
    )


@dataclass(frozen=True, eq=False)
class PlaneReach:
    """The roof points (N, 3), the planes (P, 3: a, b, c) that their `labels` (N,) say they support, and where
    these may be: not under `lowest` (m), nor over `highest` (P,) but where two that were seen meet. From the
    distance `limit` (m) on a point's residual is full.

    The last plane is the level that stands for no plane at all.
    """

    roof: Points
    labels: Labels
    planes: Values
    spacing: float
    lowest: float
    highest: Values
    limit: float


def plane_reach(
    roof: Points, labels: Labels, planes: Values, spacing: float, ground: float, costs: LabelCosts
) -> PlaneReach:
    """Reach of planes (P, 3), over the base and not over what was seen of the roof.

    `labels` (N,) say which of them each roof point (N, 3) supports. The limit of residuals is
    `residual_share` times the scatter of those points, from their median distance, as of a normal
    distribution.
    """
    highest, away = spread_kernel(roof, labels, planes, float(costs.residual_limit))
    limit = min(max(costs.residual_share * (away / NORMAL_MEDIAN), LOWEST_WALL), costs.residual_limit)
    return PlaneReach(roof, labels, planes, spacing, ground + LOWEST_ROOF, highest, limit)


def label_cells(coverage: Coverage, reach: PlaneReach, costs: LabelCosts, data: Values) -> Integers:
    """The plane (C,) of every cell, of which `data` (C, P) has the costs."""
    planes = reach.planes
    halves = np.flatnonzero((coverage.cell >= 0) & (coverage.cell[coverage.twin] > coverage.cell))
    edges = np.column_stack([coverage.cell[halves], coverage.cell[coverage.twin[halves]]])
    start, end = coverage.nodes[coverage.start[halves]], coverage.nodes[coverage.end[halves]]
    places = np.stack([start + share * (end - start) for share in GAUSS_PLACES], axis=1)
    borders = Borders(
        edges,
        costs.border_cost * coverage.length[halves],
        places,
        planes,
        costs.meeting_share,
        costs.residual_limit,
    )
    return label_nodes(data, borders, 2.0 * costs.plane_points * reach.spacing**2)


def cell_costs(
    coverage: Coverage, reach: PlaneReach, costs: LabelCosts, located: tuple[Integers, Integers]
) -> Values:
    """The cost (C, P; m²) of every plane for every cell; `located` are roof points and their cells."""
    point, cell = located
    order = np.argsort(cell, kind="stable")
    inner = np.flatnonzero(coverage.cell != OUTSIDE)
    inner = inner[np.argsort(coverage.cell[inner], kind="stable")]
    data: Values = cell_costs_kernel(
        reach.roof[point[order]],
        np.searchsorted(cell[order], np.arange(coverage.count + 1)),
        coverage.nodes[coverage.start[inner]],
        np.searchsorted(coverage.cell[inner], np.arange(coverage.count + 1)),
        reach.planes,
        np.array([np.sqrt(1.0 + a**2 + b**2) for a, b, _ in reach.planes.tolist()]),
        reach.lowest,
        reach.limit,
        costs.gross_limit,
        reach.spacing**2,
    )
    rise = rise_over(coverage.nodes, reach.roof, reach.labels, reach.planes, reach.highest, reach.spacing)
    add_rise_kernel(data, coverage.cell[inner], coverage.start[inner], rise)
    data[:, -1] += 1e-6  # of equals a plane goes before the level that stands for none
    return np.minimum(data, LARGEST, out=data)


@kernel
def add_rise_kernel(data: Values, cell: Integers, node: Integers, rise: Values) -> None:
    """Adds to the `data` (C, P) what the highest `rise` (V, P; m) of a plane over a cell's corners costs:
    corner k of `cell` (K,), ascending, is at `node` (K,)."""
    most = np.zeros(data.shape[1])
    for corner in range(len(cell)):
        for plane in range(len(most)):
            most[plane] = max(most[plane], rise[node[corner], plane])
        if corner + 1 == len(cell) or cell[corner + 1] != cell[corner]:
            for plane in range(len(most)):
                data[cell[corner], plane] += RUNAWAY * most[plane]
                most[plane] = 0.0


@kernel
def cell_costs_kernel(
    places: Points,
    first: Integers,
    corners: Values,
    start: Integers,
    planes: Values,
    steepness: Values,
    lowest: float,
    residual_limit: float,
    gross_limit: float,
    point_area: float,
) -> Values:
    """The residual (C, P; m²) of every plane's points in every cell, and of heights under the lowest.

    Points `first[c]` to `first[c + 1]` of `places` (K, 3) are in cell c, the `corners` (M, 2) likewise from
    `start`. `steepness` (P,) is √(1 + a² + b²); no plane may lie under the `lowest` (m).
    """
    data = np.empty((len(first) - 1, len(planes)))
    for cell in range(len(first) - 1):
        for plane in range(len(planes)):
            a, b, c = planes[plane]
            beyond = 0.0
            for corner in range(start[cell], start[cell + 1]):
                over = corners[corner, 0] * a + corners[corner, 1] * b + c
                beyond = max(beyond, lowest - over)
            cost = 0.0
            for point in range(first[cell], first[cell + 1]):
                residual = abs(places[point, 2] - places[point, 0] * a - places[point, 1] * b - c)
                residual = residual / steepness[plane]
                share = residual / residual_limit
                cost += (min(share * share, 1.0) + min(residual / gross_limit, 1.0)) * point_area
            data[cell, plane] = cost + RUNAWAY * beyond
    return data
