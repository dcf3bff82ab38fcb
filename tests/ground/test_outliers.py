"""Gross outliers are found, and ground in holes, wires and roofs are not taken for them."""

from __future__ import annotations

import numpy as np
import pytest

from eaves.ground import classify_ground
from eaves.ground.toolkit.seeds import find_outliers
from eaves.model import PointCloud, Points
from eaves.simulate import nine_roofs_on_a_slope


def terrain(count: int = 20000, slope: float = 0.0) -> Points:
    rng = np.random.default_rng(1)
    xy = rng.uniform(0, 100, (count, 2))
    return np.column_stack([xy, slope * xy[:, 0] + 0.05 * rng.standard_normal(count)])


def found(xyz: Points) -> tuple[list[int], list[int]]:
    low, high = find_outliers(PointCloud(xyz))
    return np.flatnonzero(low).tolist(), np.flatnonzero(high).tolist()


def test_single_low_and_high_points_are_found() -> None:
    xyz = np.r_[terrain(), [[50.0, 50.0, -3.0], [20.0, 70.0, 60.0]]]
    assert found(xyz) == ([20000], [20001])


def test_a_cluster_of_low_points_over_several_cells_is_found() -> None:
    rng = np.random.default_rng(2)
    sunk = np.c_[rng.uniform(45, 58, (40, 2)), rng.uniform(-26, -24, 40)]
    low, _ = found(np.r_[terrain(), sunk])
    assert len(low) >= 36
    assert min(low) >= 20000


def echoes(rng: np.random.Generator, clusters: int = 30) -> Points:
    """Clusters of ten within a metre, 0.8 to 4 m under level ground."""
    centres, depth = rng.uniform(5, 95, (clusters, 2)), rng.uniform(0.8, 4.0, clusters)
    xy = np.repeat(centres, 10, axis=0) + rng.uniform(-1, 1, (10 * clusters, 2))
    return np.column_stack([xy, -np.repeat(depth, 10) - rng.uniform(0, 0.4, 10 * clusters)])


@pytest.mark.parametrize("density", [8, 20])
def test_clusters_of_late_echoes_are_found(density: int) -> None:
    ground = terrain(10000 * density)
    low, high = found(np.r_[ground, echoes(np.random.default_rng(3))])
    assert high == []
    assert np.mean(np.isin(np.arange(len(ground), len(ground) + 300), low)) > 0.9
    assert sum(number < len(ground) for number in low) == 0


def test_late_echoes_under_a_slope_are_found() -> None:
    ground, late = terrain(200000, slope=0.4), echoes(np.random.default_rng(3))
    late[:, 2] += 0.4 * late[:, 0]
    low = find_outliers(PointCloud(np.r_[ground, late]))[0]
    assert low[len(ground) :].mean() > 0.99
    assert low[: len(ground)].mean() < 1e-4


def test_late_echoes_change_no_class_but_few() -> None:
    scene = nine_roofs_on_a_slope(density=8.0)
    cloud = scene.cloud.with_(classification=None)
    before = classify_ground(cloud).classification
    assert before is not None
    rng = np.random.default_rng(4)
    soil = cloud.xyz[scene.truth_class == 2]
    late = np.repeat(soil[rng.integers(len(soil), size=10)], 8, axis=0)
    late += np.c_[rng.uniform(-1, 1, (80, 2)), -np.repeat(rng.uniform(1.5, 4.0, 10), 8)]
    after = classify_ground(PointCloud(np.r_[cloud.xyz, late])).classification
    assert after is not None
    assert np.mean(after[: len(cloud)] != classify_ground(PointCloud(cloud.xyz)).classification) < 0.003


@pytest.mark.parametrize("sort", ["well", "ditch", "ramp", "road", "court"])
def test_real_low_ground_is_kept(sort: str) -> None:
    xyz = terrain(150000)
    x, y = xyz[:, 0] - 50.0, xyz[:, 1] - 50.0
    if sort == "well":
        xyz[np.hypot(x, y) < 1.2, 2] -= 4.0
    elif sort == "ditch":
        xyz[(np.abs(x) < 0.6) & (y < 0.6) | (np.abs(y) < 0.6) & (x > 0), 2] -= 1.0
    elif sort == "ramp":
        xyz[(np.abs(x) < 8.0) & (y > 1.5) & (y < 9.0), 2] += 6.0
        ramp = (np.abs(y) < 1.5) & (np.abs(x) < 6.0)
        xyz[ramp, 2] -= 0.22 * (x[ramp] + 6.0)
    elif sort == "road":
        xyz[np.abs(x + 0.3 * y) < 4.0, 2] -= 4.0
    else:
        xyz[(np.abs(x) < 9.0) & (np.abs(y) < 9.0) & ~((np.abs(x) < 1.5) & (np.abs(y) < 1.5)), 2] += 8.0
    assert found(xyz) == ([], [])


def test_ground_of_courts_in_a_dense_quarter_is_not_low() -> None:
    """Roofs of many heights all around a narrow court: what lies under them is ground, as the street is."""
    xyz = terrain(150000)
    x, y = xyz[:, 0] % 16.0, xyz[:, 1] % 16.0
    street = (xyz[:, 0] % 48.0 < 6.0) | (xyz[:, 1] % 48.0 < 6.0)
    court = (np.abs(x - 8.0) < 2.0) & (np.abs(y - 8.0) < 2.0)
    roof = ~street & ~court
    xyz[roof, 2] += 8.0 + 3.0 * ((xyz[roof, 0] // 16.0 + 2 * (xyz[roof, 1] // 16.0)) % 3)
    low, _ = found(xyz)
    assert not low


def test_ground_under_crowns_is_not_low() -> None:
    xyz = terrain(80000)
    rng = np.random.default_rng(5)
    crown = (np.hypot(xyz[:, 0] - 50, xyz[:, 1] - 50) < 30) & (rng.random(len(xyz)) < 0.8)
    xyz[crown, 2] += rng.uniform(4.0, 12.0, int(crown.sum()))
    assert found(xyz) == ([], [])


def test_order_of_points_is_of_no_matter() -> None:
    xyz = np.r_[terrain(), echoes(np.random.default_rng(6))]
    turn = np.random.default_rng(7).permutation(len(xyz))
    low = find_outliers(PointCloud(xyz))[0]
    assert (find_outliers(PointCloud(xyz[turn]))[0] == low[turn]).all()


def test_even_ground_has_no_outliers() -> None:
    for slope in (0.0, 0.5, 1.0):
        assert found(terrain(slope=slope)) == ([], [])


def test_a_court_inside_a_large_roof_is_not_low() -> None:
    xyz = terrain()
    roof = (np.abs(xyz[:, :2] - 50.0) < 22.0).all(axis=1) & (np.abs(xyz[:, :2] - 50.0) > 2.0).any(axis=1)
    xyz[roof, 2] += 12.0
    assert found(xyz) == ([], [])


def test_a_wire_is_not_high() -> None:
    along = np.linspace(0, 100, 300)
    wire = np.c_[along, np.full(300, 50.0), np.full(300, 25.0)]
    assert found(np.r_[terrain(), wire]) == ([], [])
