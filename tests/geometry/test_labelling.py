"""Labels by graph cut, against trying everything."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from eaves.geometry.labelling import Costs, Jumps, expand, label_nodes


@pytest.mark.parametrize("seed", range(20))
def test_an_expansion_is_the_best_there_is(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cost = rng.random((6, 3))
    edges = np.array([(i, j) for i in range(6) for j in range(i + 1, 6) if rng.random() < 0.5]).reshape(-1, 2)
    border, price = 0.5 * rng.random(len(edges)), np.zeros(3)
    labels = rng.integers(0, 3, 6)
    costs = Costs.of(cost, edges, border, price)
    moved = expand(costs, labels, 1, costs.may_gain(labels))
    best = min(
        costs.of_labels(np.where(np.array(choice), 1, labels)) for choice in product([False, True], repeat=6)
    )
    assert costs.of_labels(moved) == pytest.approx(best, abs=1e-2)


def test_a_label_that_costs_more_than_it_saves_is_given_up() -> None:
    cost = np.array([[0.0, 1.0], [0.0, 1.0], [1.0, 0.5]])
    edges, border = np.array([[0, 1], [1, 2]]), np.array([0.1, 0.1])
    assert label_nodes(cost, edges, border, np.array([0.0, 0.1])).tolist() == [0, 0, 1]
    assert label_nodes(cost, edges, border, np.array([0.0, 1.0])).tolist() == [0, 0, 0]


def test_no_nodes_and_no_edges_have_an_answer() -> None:
    none = np.zeros((0, 2), np.int64)
    assert len(label_nodes(np.zeros((0, 2)), none, np.zeros(0), np.zeros(2))) == 0
    assert label_nodes(np.array([[1.0, 0.0]]), none, np.zeros(0), np.zeros(2)).tolist() == [1]


@pytest.mark.parametrize("seed", range(20))
def test_an_expansion_is_the_best_there_is__borders_cost_what_heights_jump(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cost = rng.random((6, 3))
    edges = np.array([(i, j) for i in range(6) for j in range(i + 1, 6) if rng.random() < 0.5]).reshape(-1, 2)
    jumps = Jumps(rng.random((len(edges), 2, 2)), rng.random((3, 3)), 0.3, 0.5)
    costs = Costs.of(cost, edges, rng.random(len(edges)), np.zeros(3), jumps)
    labels = rng.integers(0, 3, 6)
    moved = expand(costs, labels, 1, costs.may_gain(labels))
    best = min(
        costs.of_labels(np.where(np.array(choice), 1, labels)) for choice in product([False, True], repeat=6)
    )
    assert costs.of_labels(moved) == pytest.approx(best, abs=1e-2)


def test_a_border_is_cheap_where_planes_meet_and_dear_where_heights_jump() -> None:
    places = np.array([[[0.0, 0.0], [0.0, 1.0]]])
    jumps = Jumps(places, np.array([[1.0, 0.0, 5.0], [-1.0, 0.0, 5.0], [0.0, 0.0, 9.0]]), 0.3, 0.5)
    first = np.array([0])
    assert jumps.share(first, np.array([0]), np.array([1])).tolist() == pytest.approx([0.3])
    assert jumps.share(first, np.array([0]), np.array([2])).tolist() == pytest.approx([1.0])
    assert jumps.share(first, np.array([0]), np.array([0])).tolist() == [0.0]
