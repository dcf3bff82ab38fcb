"""Gross outliers are found, and ground in holes, wires and roofs are not taken for them."""

from __future__ import annotations

import numpy as np

from eaves.ground.toolkit.outliers import find_outliers
from eaves.model import PointCloud, Points


def terrain(count: int = 20000, slope: float = 0.0) -> Points:
    rng = np.random.default_rng(1)
    xy = rng.uniform(0, 100, (count, 2))
    return np.c_[xy, slope * xy[:, 0] + 0.05 * rng.standard_normal(count)]


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
    assert low == list(range(20000, 20040))


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
