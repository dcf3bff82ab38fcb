"""Labels settled by moves, against trying everything."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray

from eaves.geometry.inside import connected_groups_kernel
from eaves.reconstruct.arrangement import Arrangement
from eaves.reconstruct.toolkit.cell_labels import Borders, border_kernel, label_nodes, plane_reach


def energy(data: NDArray[np.float64], borders: Borders, price: float, labels: NDArray[np.int64]) -> float:
    """What `label_nodes` makes small."""
    ends = enumerate(borders.edges)
    between = sum(border_kernel(borders, number, labels[a], labels[b]) for number, (a, b) in ends)
    alike = labels[borders.edges[:, 0]] == labels[borders.edges[:, 1]]
    regions = connected_groups_kernel(*borders.edges[alike].T.copy(), len(labels)).max(initial=-1) + 1
    return float(data[np.arange(len(labels)), labels].sum() + between + price * regions)


def some_graph(seed: int, nodes: int, labels: int) -> tuple[NDArray[np.float64], Borders]:
    """Random costs over a random graph."""
    rng = np.random.default_rng(seed)
    pairs = [(i, j) for i in range(nodes) for j in range(i + 1, nodes) if rng.random() < 0.5]
    edges = np.array(pairs, np.int64).reshape(-1, 2)
    places, planes = rng.random((len(edges), 2, 2)), rng.random((labels, 3))
    return rng.random((nodes, labels)), Borders(edges, rng.random(len(edges)), places, planes, 0.3, 0.5)


@pytest.mark.slow
def test_labels_are_the_best_or_nearly() -> None:
    ratios = []
    for seed in range(30):
        data, borders = some_graph(seed, 6, 3)
        best = min(energy(data, borders, 0.2, np.array(some)) for some in product(range(3), repeat=6))
        ratios.append(energy(data, borders, 0.2, label_nodes(data, borders, 0.2)) / best)
    assert np.median(ratios) < 1.0001 and np.mean(ratios) < 1.02


@pytest.mark.parametrize("seed", range(10))
def test_no_other_label_of_one_node_lowers_the_sum(seed: int) -> None:
    data, borders = some_graph(seed, 12, 4)
    labels = label_nodes(data, borders, 0.0)
    for node, label in product(range(12), range(4)):
        other = labels.copy()
        other[node] = label
        assert energy(data, borders, 0.0, other) >= energy(data, borders, 0.0, labels) - 1e-3


def test_a_region_that_costs_more_than_it_saves_is_given_up() -> None:
    data = np.array([[0.0, 1.0], [0.0, 1.0], [1.0, 0.5]])
    planes = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 9.0]])
    edges = np.array([[0, 1], [1, 2]])
    borders = Borders(edges, np.array([0.1, 0.1]), np.zeros((2, 1, 2)), planes, 0.0, 0.5)
    assert label_nodes(data, borders, 0.1).tolist() == [0, 0, 1]
    assert label_nodes(data, borders, 1.0).tolist() == [0, 0, 0]


def test_each_region_of_a_label_has_its_price() -> None:
    # one level of five cells in a row, but for the second, which fits another a little better, and the fourth
    data = np.array([[0.0, 1.0], [0.3, 0.0], [0.0, 1.0], [0.3, 0.0], [0.0, 1.0]])
    planes = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 9.0]])
    edges = np.array([[k, k + 1] for k in range(4)])
    borders = Borders(edges, np.full(4, 0.01), np.zeros((4, 1, 2)), planes, 0.0, 0.5)
    assert label_nodes(data, borders, 0.1).tolist() == [0, 1, 0, 1, 0]
    assert label_nodes(data, borders, 0.4).tolist() == [0, 0, 0, 0, 0]


def test_no_nodes_and_no_edges_have_a_result() -> None:
    none = Borders(np.zeros((0, 2), np.int64), np.zeros(0), np.zeros((0, 1, 2)), np.zeros((2, 3)), 0.0, 0.5)
    assert len(label_nodes(np.zeros((0, 2)), none, 0.0)) == 0
    assert label_nodes(np.array([[1.0, 0.0]]), none, 0.0).tolist() == [1]


def test_a_border_is_cheap_where_planes_meet_and_dear_where_heights_jump() -> None:
    places = np.array([[[0.0, 0.0], [0.0, 1.0]]])
    planes = np.array([[1.0, 0.0, 5.0], [-1.0, 0.0, 5.0], [0.0, 0.0, 9.0]])
    borders = Borders(np.array([[0, 1]]), np.ones(1), places, planes, 0.3, 0.5)
    assert border_kernel(borders, 0, 0, 1) == pytest.approx(0.3)
    assert border_kernel(borders, 0, 0, 2) == pytest.approx(1.0)
    assert border_kernel(borders, 0, 0, 0) == 0.0


@pytest.mark.parametrize(("noise", "limit"), [(0.0, 0.05), (0.02, 0.2), (0.3, 0.45)])
def test_residuals_stop_growing_at_ten_times_the_scatter__within_bounds(noise: float, limit: float) -> None:
    rng = np.random.default_rng(3)
    roof = np.column_stack([rng.random((4000, 2)) * 10.0, 3.0 + noise * rng.standard_normal(4000)])
    planes, labels = np.array([[0.0, 0.0, 3.0]] * 2), np.zeros(len(roof), np.int32)
    reach = plane_reach(roof, labels, planes, 0.25, 0.0, Arrangement())
    assert reach.limit == pytest.approx(limit, rel=0.1)
