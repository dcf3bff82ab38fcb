"""Labels by graph cut, against trying everything."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray

from eaves.reconstruct.toolkit.alpha_expansion import (
    Costs,
    HeightSteps,
    alpha_expansion,
    costs_of,
    expand_kernel,
    minimal_cut_kernel,
    smoothness_kernel,
)


def energy(costs: Costs, labels: NDArray[np.int64]) -> float:
    """What `alpha_expansion` makes small."""
    data = costs.data[np.arange(len(labels)), labels].sum()
    borders = sum(
        smoothness_kernel(costs, number, labels[a], labels[b]) for number, (a, b) in enumerate(costs.edges)
    )
    return float(data + borders + costs.label_cost[np.unique(labels)].sum())


def some_costs(seed: int, nodes: int, labels: int, *, steps: bool, prices: float) -> Costs:
    """Random costs over a random graph."""
    rng = np.random.default_rng(seed)
    data = rng.random((nodes, labels))
    pairs = [(i, j) for i in range(nodes) for j in range(i + 1, nodes) if rng.random() < 0.5]
    edges = np.array(pairs, np.int64).reshape(-1, 2)
    places, planes = rng.random((len(edges), 2, 2)), rng.random((labels, 3))
    smoothness_cost, label_cost = 0.5 * rng.random(len(edges)), prices * rng.random(labels)
    return costs_of(
        data, edges, smoothness_cost, label_cost, HeightSteps(places, planes, 0.3, 0.5) if steps else None
    )


def expanded(costs: Costs, labels: NDArray[np.int64], label: int) -> NDArray[np.int64]:
    """The labels after the expansion of one."""
    limit = costs.data[np.arange(len(labels)), labels] + costs.around
    moved = labels.copy()
    moved[expand_kernel(costs, labels, label, limit, np.full(len(labels), -1))] = label
    return moved


@pytest.mark.parametrize("steps", [False, True])
@pytest.mark.parametrize("seed", range(20))
def test_an_expansion_is_the_best_there_is(seed: int, steps: bool) -> None:
    costs = some_costs(seed, 6, 3, steps=steps, prices=0.0)
    labels = np.random.default_rng(seed).integers(0, 3, 6)
    moved = expanded(costs, labels, 1)
    best = min(
        energy(costs, np.where(np.array(choice), 1, labels)) for choice in product([False, True], repeat=6)
    )
    assert energy(costs, moved) == pytest.approx(best, abs=1e-2)


@pytest.mark.parametrize("steps", [False, True])
@pytest.mark.parametrize("seed", range(20))
def test_no_expansion_lowers_the_energy_of_the_result(seed: int, steps: bool) -> None:
    costs = some_costs(seed, 12, 4, steps=steps, prices=0.2)
    asked = HeightSteps(costs.places, costs.planes, costs.least, costs.full) if steps else None
    answer = alpha_expansion(costs.data, costs.edges, costs.smoothness_cost, costs.label_cost, asked)
    assert energy(costs, answer) <= energy(costs, np.argmin(costs.data, axis=1)) + 1e-9
    for label in range(4):
        assert energy(costs, expanded(costs, answer, label)) >= energy(costs, answer) - 1e-3


def test_a_label_that_costs_more_than_it_saves_is_given_up() -> None:
    cost = np.array([[0.0, 1.0], [0.0, 1.0], [1.0, 0.5]])
    edges, smoothness_cost = np.array([[0, 1], [1, 2]]), np.array([0.1, 0.1])
    assert alpha_expansion(cost, edges, smoothness_cost, np.array([0.0, 0.1])).tolist() == [0, 0, 1]
    assert alpha_expansion(cost, edges, smoothness_cost, np.array([0.0, 1.0])).tolist() == [0, 0, 0]


def test_no_nodes_and_no_edges_have_a_result() -> None:
    none = np.zeros((0, 2), np.int64)
    assert len(alpha_expansion(np.zeros((0, 2)), none, np.zeros(0), np.zeros(2))) == 0
    assert alpha_expansion(np.array([[1.0, 0.0]]), none, np.zeros(0), np.zeros(2)).tolist() == [1]


def test_a_border_is_cheap_where_planes_meet_and_dear_where_heights_jump() -> None:
    places = np.array([[[0.0, 0.0], [0.0, 1.0]]])
    planes = np.array([[1.0, 0.0, 5.0], [-1.0, 0.0, 5.0], [0.0, 0.0, 9.0]])
    costs = costs_of(
        np.zeros((2, 3)), np.array([[0, 1]]), np.ones(1), np.zeros(3), HeightSteps(places, planes, 0.3, 0.5)
    )
    assert smoothness_kernel(costs, 0, 0, 1) == pytest.approx(0.3)
    assert smoothness_kernel(costs, 0, 0, 2) == pytest.approx(1.0)
    assert smoothness_kernel(costs, 0, 0, 0) == 0.0


@pytest.mark.parametrize("seed", range(20))
def test_a_cut_is_the_smallest_there_is(seed: int) -> None:
    rng = np.random.default_rng(seed)
    edges = np.array([(i, j) for i in range(6) for j in range(i + 1, 6) if rng.random() < 0.6]).reshape(-1, 2)
    back, source, sink = rng.random(len(edges)), 2.0 * rng.random(6), 2.0 * rng.random(6)

    def size(side: NDArray[np.bool_]) -> float:
        crossing = side[edges[:, 1]] & ~side[edges[:, 0]]
        return float(back[crossing].sum() + source[~side].sum() + sink[side].sum())

    found = size(minimal_cut_kernel(edges, back, source, sink))
    best = min(size(np.array(side)) for side in product([False, True], repeat=6))
    assert found == pytest.approx(best, abs=1e-2)
