"""Labels of least cost, against plain loops."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from eaves.roof.global_refinement import near_regions, relabel_kernel
from eaves.roof.toolkit.regions import touching_regions

OUTLIER, SMOOTHNESS = 2.0, 1.5


def some_points(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Points about three planes, their neighbours, the planes and labels that are partly wrong."""
    rng = np.random.default_rng(seed)
    xyz = np.column_stack([rng.uniform(0.0, 10.0, (300, 2)), np.zeros(300)])
    true = np.digitize(xyz[:, 0], [3.0, 7.0]) + 1
    xyz[:, 2] = true + rng.normal(0.0, 0.3, 300)
    neighbours = cKDTree(xyz).query(xyz, k=8)[1].astype(np.int64)
    planes = np.array([[0.0, 0.0, 1.0, 1.0], [0.0, 0.0, 1.0, 2.0], [0.0, 0.0, 1.0, 3.0]])
    labels = np.where(rng.random(300) < 0.3, rng.integers(0, 4, 300), true).astype(np.int32)
    return xyz, neighbours, planes, labels


def cheapest(
    xyz: np.ndarray, near: np.ndarray, planes: np.ndarray, weights: np.ndarray, labels: np.ndarray
) -> int:
    """The cheapest label of a point among those around it and none, the first of equals."""
    best, winner = np.inf, 0
    for label in [*dict.fromkeys(labels[near].tolist()), 0]:
        away = planes[label - 1, :3] @ xyz - planes[label - 1, 3]
        cost = OUTLIER if label == 0 else 0.5 * away**2 * weights[label - 1]
        cost += SMOOTHNESS * np.mean(labels[near[1:]] != label)
        if cost < best - 1e-12:
            best, winner = cost, label
    return int(winner)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("sweeps", [1, 2, 6])
def test_every_point_in_turn_takes_the_cheapest_label_around_it(seed: int, sweeps: int) -> None:
    xyz, neighbours, planes, labels = some_points(seed)
    weights = np.array([9.0, 11.0, 10.0])
    expected = labels.copy()
    for _ in range(sweeps):
        for point, near in enumerate(neighbours):
            expected[point] = cheapest(xyz[point], near, planes, weights, expected)
    relabel_kernel(xyz, neighbours, planes, weights, OUTLIER, SMOOTHNESS, sweeps, labels)
    assert labels.tolist() == expected.tolist()


def test_regions_touch_where_a_point_is_the_neighbour_of_another() -> None:
    _, neighbours, _, labels = some_points(0)
    touching = touching_regions(labels, neighbours, 3)
    for one in range(1, 4):
        for other in range(1, 4):
            beside = labels[neighbours[labels == one, 1:]] == other
            back = labels[neighbours[labels == other, 1:]] == one
            assert touching[one - 1, other - 1] == (one != other and bool(beside.any() or back.any()))


def test_regions_are_near_in_cells_side_by_side() -> None:
    xyz = np.array([[0.5, 0.5, 0.0], [1.5, 1.5, 0.0], [4.5, 0.5, 0.0], [0.5, 2.5, 9.0], [9.0, 9.0, 0.0]])
    near = near_regions(np.array([1, 2, 3, 4, 0], np.int32), xyz, 5, 1.0)
    assert np.argwhere(near).tolist() == [[0, 1], [1, 0], [1, 3], [3, 1]]
    assert not near_regions(np.zeros(5, np.int32), xyz, 2, 1.0).any()
