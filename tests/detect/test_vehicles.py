"""What stands narrow and long on the street: vans leave, sheds with a pitched roof stay."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from eaves.detect.consensus import Consensus
from eaves.detect.consensus.classifier import score_regions
from eaves.detect.consensus.vehicles import measure_tops


def top(
    length: float,
    width: float,
    rise: float = 0.0,
    ridge: float = 0.0,
    turned_deg: float = 0.0,
    count: int = 200,
) -> NDArray[np.float64]:
    """Points (count, 3) of a top 2.4 m up that rises across by `rise` m, or to a ridge by `ridge` m."""
    rng = np.random.default_rng(3)
    u, v = rng.uniform(-0.5, 0.5, (2, count))
    z = 2.4 + rise * v + ridge * (0.5 - 2 * np.abs(v)) + rng.normal(0.0, 0.02, count)
    turn = np.radians(turned_deg)
    x, y = length * u, width * v
    return np.c_[x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn), z]


def is_vehicle(xyz: NDArray[np.float64]) -> bool:
    return bool(measure_tops(xyz, xyz[:, 2], np.ones(len(xyz), np.int32), 2, Consensus()).vehicle[1])


@pytest.mark.parametrize("turned_deg", [0.0, 30.0, 90.0, 135.0])
def test_a_level_van_is_a_vehicle_and_a_pitched_shed_of_its_measures_is_none(turned_deg: float) -> None:
    assert is_vehicle(top(5.5, 2.2, turned_deg=turned_deg))
    assert is_vehicle(top(5.5, 2.2, rise=0.2, turned_deg=turned_deg))
    assert not is_vehicle(top(5.5, 2.2, rise=0.6, turned_deg=turned_deg))
    assert not is_vehicle(top(5.5, 2.2, ridge=0.5, turned_deg=turned_deg))


def test_what_is_wide_or_short_is_no_vehicle() -> None:
    assert not is_vehicle(top(5.5, 2.8))
    assert not is_vehicle(top(3.5, 2.2))


def test_few_points_tell_no_pitch() -> None:
    assert is_vehicle(top(5.5, 2.2, rise=0.6, count=12))


@pytest.mark.parametrize("count", [1, 2, 3])
def test_hardly_any_points_are_no_error(count: int) -> None:
    same = np.zeros((count, 3))
    assert measure_tops(same, same[:, 2], np.ones(count, np.int32), 2, Consensus()).vehicle.shape == (2,)


def test_the_score_falls_the_more_a_region_is_like_a_van() -> None:
    region = np.arange(1, 6, dtype=np.int32)[None]
    width, height = np.array([2.2, 2.2, 2.8, 2.8, np.inf]), np.array([2.3, 2.8, 2.3, 2.8, np.inf])
    score = score_regions(region, np.full(region.shape, 4.0), width, height)
    assert score[0] < min(score[1], score[2]) and max(score[1], score[2]) < score[3] < score[4] < 1.0
