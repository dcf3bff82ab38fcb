"""Rim points: the terrain beyond the data, and what the rim cuts."""

from __future__ import annotations

import numpy as np
import pytest

from eaves.ground import classify_ground
from eaves.ground.adaptive_tin import AdaptiveTin
from eaves.ground.adaptive_tin.method import rim_points
from eaves.model import Bounds, PointCloud

BOUNDS = Bounds(0.0, 0.0, 40.0, 30.0)
RULES = AdaptiveTin()


def test_rim_points_go_on_with_the_slope() -> None:
    xy = np.random.default_rng(1).uniform((0, 0), (40, 30), (300, 2))
    points = rim_points(np.c_[xy, 0.4 * xy[:, 0] - 0.1 * xy[:, 1] + 7.0], BOUNDS, RULES)
    assert np.abs(points[:, 2] - (0.4 * points[:, 0] - 0.1 * points[:, 1] + 7.0)).max() < 1.0


def test_rim_points_surround_the_bounds() -> None:
    points = rim_points(np.zeros((1, 3)), BOUNDS, RULES)
    outside = BOUNDS.buffered(RULES.rim_apart / 2)
    on_rim = np.isin(points[:, 0], (outside.west, outside.east)) | np.isin(
        points[:, 1], (outside.south, outside.north)
    )
    assert on_rim.all()
    assert len(np.unique(points[:, :2], axis=0)) == len(points)
    angle = np.sort(np.arctan2(points[:, 1] - 15.0, points[:, 0] - 20.0))
    assert np.diff(angle).max() < 2.0 * np.arctan2(RULES.rim_apart, 20.0)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_few_points_foretell_their_own_height(count: int) -> None:
    points = rim_points(np.full((count, 3), 3.0), BOUNDS, RULES)
    assert (points[:, 2] == 3.0).all()
    assert bool(len(points)) == bool(count)


def test_roof_and_crown_cut_by_the_rim_are_not_climbed() -> None:
    rng = np.random.default_rng(3)
    xy = rng.uniform(0, 60, (36000, 2))
    roof = (xy[:, 0] < 6) & (np.abs(xy[:, 1] - 30) < 12)
    crown = (xy[:, 1] > 54) & (np.abs(xy[:, 0] - 35) < 6)
    z = 0.02 * rng.standard_normal(len(xy))
    z[roof] += np.where(rng.random(roof.sum()) < 0.03, rng.uniform(0, 7, roof.sum()), 7.0)
    z[crown] += rng.uniform(1.0, 8.0, crown.sum())
    ground = classify_ground(PointCloud.from_world(np.c_[xy, z])).ground
    assert not ground[z > 1.0].any()
    assert ground[~roof & ~crown].mean() > 0.99
