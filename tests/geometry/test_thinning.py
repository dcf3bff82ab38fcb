"""Thinned points: each has one that stands for it, within its cell."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from eaves.geometry.neighbours import thin_kernel

SIDE = 500


def thinned(quanta: NDArray[np.int32]) -> NDArray[np.int64]:
    return np.asarray(thin_kernel(quanta, np.ones(len(quanta), np.uint8), SIDE))


@pytest.mark.parametrize("seed", range(5))
def test_each_point_is_stood_for_within_a_cell__whatever_the_order(seed: int) -> None:
    rng = np.random.default_rng(seed)
    quanta = rng.integers([0, 7_000, -90_000], [6_000, 14_000, 90_000], (40_000, 3)).astype(np.int32)
    stands = thinned(quanta)
    assert (stands[stands] == stands).all() and 1_000 < len(np.unique(stands)) < 39_000
    assert (quanta[:, :2] // SIDE == quanta[stands, :2] // SIDE).all()
    assert (np.abs(quanta[:, 2] - quanta[stands, 2]) < SIDE).all()
    order = rng.permutation(len(quanta))
    assert (order[thinned(quanta[order])] == stands[order]).all()


def test_a_level_roof_keeps_one_point_a_cell__of_middle_height() -> None:
    rng = np.random.default_rng(2)
    places, heights = rng.uniform(0.0, 8_000.0, (40_000, 2)), rng.normal(99_900.0, 20.0, 40_000)
    stands = thinned(np.column_stack([places, heights]).astype(np.int32))
    chosen, counts = np.unique(stands, return_counts=True)
    assert len(chosen) == 256 and counts.min() > 100
    assert np.abs(heights[chosen] - 99_900.0).max() < 10.0


def test_a_wall_keeps_a_point_a_level() -> None:
    heights = np.random.default_rng(3).permutation(10_000)
    quanta = np.column_stack([np.full(10_000, 40), np.full(10_000, 90), heights]).astype(np.int32)
    stands = thinned(quanta)
    assert sorted(heights[np.unique(stands)]) == [SIDE * level + SIDE // 2 for level in range(20)]


def test_sparse_points_all_stay() -> None:
    x, y = np.meshgrid(np.arange(9) * 1_000, np.arange(7) * 1_000)
    quanta = np.column_stack([x.ravel(), y.ravel(), np.full(63, -(10**9))]).astype(np.int32)
    assert thinned(quanta).tolist() == list(range(63))
