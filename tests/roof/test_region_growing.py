"""Region growing on exact roofs, and on input that is hardly one."""

from __future__ import annotations

import numpy as np
import pytest

from eaves.geometry.planes import local_planes
from eaves.roof import segment_roof
from eaves.roof.region_growing import RegionGrowing


def gable(count: int, noise: float, seed: int = 0) -> np.ndarray:
    """Points (N, 3) on a gable of 10 m × 8 m, ridge along x at 3 m, slopes 3/4."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform([-5, -4], [5, 4], (count, 2))
    return np.c_[xy, 3.0 - 0.75 * abs(xy[:, 1]) + rng.normal(0, noise, count)]


def test_noise_is_measured_within_a_quarter() -> None:
    for noise in (0.02, 0.05, 0.1):
        local = local_planes(gable(600, noise), 12, 24)
        assert 0.75 * noise < local.noise < 1.3 * noise


@pytest.mark.parametrize("density", [2, 4, 10, 50])
def test_gable_gives_two_planes__noise_3cm(density: int) -> None:
    points = gable(80 * density, 0.03)
    planes = segment_roof(points, density**-0.5, RegionGrowing())
    assert len(planes) == 2
    slopes = [np.degrees(plane.slope) for plane in planes]
    assert np.allclose(slopes, np.degrees(np.arctan(0.75)), atol=1.5)
    assert sum(len(plane.members) for plane in planes) > 0.97 * len(points)


def test_two_strips_of_one_plane_are_one() -> None:
    rng = np.random.default_rng(2)
    xy = rng.uniform(0, 10, (800, 2))
    points = np.c_[xy, 0.2 * xy[:, 0] + rng.choice([0.0, 0.03], 800) + rng.normal(0, 0.02, 800)]
    assert len(segment_roof(points, 0.35, RegionGrowing())) == 1


@pytest.mark.parametrize(("step", "joined"), [(0.12, True), (0.4, False)])
def test_regions_that_one_plane_explains_are_one_where_they_are_joined(step: float, joined: bool) -> None:
    rng = np.random.default_rng(2)
    xy = rng.uniform(0.0, 10.0, (800, 2))
    upper = xy[:, 1] > 5.0
    z = 0.2 * xy[:, 0] + np.where(upper, step, 0.0) + rng.normal(0.0, 0.01, 800)
    points = np.c_[xy, z] + [310.0, 170.0, 12.0]
    apart = segment_roof(points, 0.35, RegionGrowing(join_coplanar=False))
    assert sorted(len(plane.members) for plane in apart) == sorted([upper.sum(), (~upper).sum()])
    assert all(len(set(upper[plane.members])) == 1 for plane in apart)
    found = segment_roof(points, 0.35, RegionGrowing())
    assert sorted(len(plane.members) for plane in found) == (
        [800] if joined else sorted([upper.sum(), (~upper).sum()])
    )


def test_scan_lines_give_the_same_two_planes() -> None:
    x, y = np.meshgrid(np.arange(-5, 5, 1.0), np.arange(-4, 4, 0.12))
    rng = np.random.default_rng(4)
    points = np.c_[x.ravel(), y.ravel(), 3 - 0.75 * abs(y.ravel()) + rng.normal(0, 0.02, x.size)]
    assert len(segment_roof(points, 0.35, RegionGrowing())) == 2
