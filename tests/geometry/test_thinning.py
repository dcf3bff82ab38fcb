"""Thinned points: a division of all points, each group within its cell."""

from __future__ import annotations

import numpy as np
import pytest

from eaves.geometry.neighbours import thin


@pytest.mark.parametrize("seed", range(5))
def test_each_point_is_chosen_or_stood_for__within_a_cell(seed: int) -> None:
    rng = np.random.default_rng(seed)
    xyz = rng.uniform([-3.0, -2.0, 0.0], [4.0, 5.0, 6.0], (4000, 3))
    chosen, others, counts = thin(xyz, 0.5)
    assert sorted([*chosen, *others]) == list(range(4000))
    assert (np.diff(chosen) > 0).all() and counts.sum() == len(others) and counts.max() > 1
    nearest = xyz[np.repeat(chosen, counts)]
    assert (np.floor(xyz[others, :2] / 0.5) == np.floor(nearest[:, :2] / 0.5)).all()
    assert (np.abs(xyz[others, 2] - nearest[:, 2]) < 0.5).all()


def test_a_level_roof_keeps_one_point_a_cell__of_middle_height() -> None:
    rng = np.random.default_rng(2)
    xyz = np.column_stack([rng.uniform(0.0, 8.0, (40_000, 2)), rng.normal(9.99, 0.02, 40_000)])
    chosen, _, counts = thin(xyz, 0.5)
    assert len(chosen) == 256
    assert np.abs(xyz[chosen, 2] - 9.99).max() < 0.01 and counts.min() > 100


def test_sparse_points_all_stay() -> None:
    xyz = np.stack([*np.meshgrid(np.arange(9.0), np.arange(7.0)), np.zeros((7, 9))], axis=-1).reshape(-1, 3)
    chosen, others, counts = thin(xyz, 0.5)
    assert chosen.tolist() == list(range(63)) and not len(others) and not counts.any()
    assert [len(part) for part in thin(np.zeros((0, 3)), 0.5)] == [0, 0, 0]
