"""Planes from sums: exact through exact points, the same however the points are grouped."""

import numpy as np

from eaves.geometry.planes import fit_planes, plane_rmse, sums_of
from eaves.model import Points


def sloping_points(count: int, noise: float) -> Points:
    """Points (N, 3) about z = 0.3 x - 0.2 y + 7."""
    rng = np.random.default_rng(1)
    xy = rng.uniform(0, 10, (count, 2))
    return np.c_[xy, 0.3 * xy[:, 0] - 0.2 * xy[:, 1] + 7 + rng.normal(0, noise, count)]


def test_plane_through_exact_points_is_exact() -> None:
    centre, normal, rmse = fit_planes(sums_of(sloping_points(50, 0.0), np.zeros(50, np.int64), 1))
    assert np.allclose(normal[0], np.array([-0.3, 0.2, 1.0]) / np.sqrt(1.13))
    assert np.isclose(centre[0, 2], 0.3 * centre[0, 0] - 0.2 * centre[0, 1] + 7)
    assert rmse[0] < 1e-6


def test_rmse_is_the_noise_across_the_plane() -> None:
    rmse = plane_rmse(sums_of(sloping_points(5000, 0.1), np.zeros(5000, np.int64), 1))
    assert np.isclose(rmse[0], 0.1 / np.sqrt(1.13), rtol=0.05)


def test_sums_of_parts_add_up_to_the_sums_of_the_whole() -> None:
    points = sloping_points(60, 0.1)
    parts = sums_of(points, np.arange(60) % 3, 3)
    assert np.allclose(parts.sum(axis=0), sums_of(points, np.zeros(60, np.int64), 1)[0])
