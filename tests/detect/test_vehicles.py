"""What stands narrow and long on the street: vans leave."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtr

from eaves.detect.consensus import Consensus
from eaves.detect.consensus.groups import find_vehicles


def top(
    length: float,
    width: float,
    rise: float = 0.0,
    turned_deg: float = 0.0,
    count: int = 200,
) -> NDArray[np.float64]:
    """Points (count, 3) of a top 2.4 m up that rises across by `rise` m."""
    rng = np.random.default_rng(3)
    u, v = rng.uniform(-0.5, 0.5, (2, count))
    z = 2.4 + rise * v + rng.normal(0.0, 0.02, count)
    turn = np.radians(turned_deg)
    x, y = length * u, width * v
    return np.c_[x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn), z]


def is_vehicle(xyz: NDArray[np.float64]) -> bool:
    return bool(find_vehicles(xyz, xyz[:, 2], np.ones(len(xyz), np.int32), 2, Consensus())[1])


@pytest.mark.parametrize("turned_deg", [0.0, 30.0, 90.0, 135.0])
def test_a_level_van_is_a_vehicle(turned_deg: float) -> None:
    assert is_vehicle(top(5.5, 2.2, turned_deg=turned_deg))
    assert is_vehicle(top(5.5, 2.2, rise=0.2, turned_deg=turned_deg))


def test_what_is_wide_or_short_is_no_vehicle() -> None:
    assert not is_vehicle(top(5.5, 2.8))
    assert not is_vehicle(top(3.5, 2.2))


@pytest.mark.parametrize(("tall", "expected"), [(4.0, True), (6.0, False)])
def test_a_lorry_whose_walls_are_soft_is_a_vehicle(tall: float, expected: bool) -> None:
    rng = np.random.default_rng(5)
    u, v = rng.uniform(-1.6, 1.6, 4000), rng.uniform(-6.0, 6.0, 4000)
    rise = ndtr((1.25 - np.abs(u)) / 0.3) * ndtr((5.0 - np.abs(v)) / 0.3)  # 2.5 m by 10 m, blurred by 0.3 m
    xyz = np.c_[u, v, tall * rise][rise > 0.25]
    assert is_vehicle(xyz) == expected


@pytest.mark.parametrize("count", [1, 2, 3])
def test_hardly_any_points_are_no_error(count: int) -> None:
    same = np.zeros((count, 3))
    assert find_vehicles(same, same[:, 2], np.ones(count, np.int32), 2, Consensus()).shape == (2,)
