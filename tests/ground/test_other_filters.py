"""Smooth region and contours on scenes they are made for."""

from __future__ import annotations

import numpy as np
import pytest

from eaves.evaluate.ground import evaluate_ground
from eaves.ground import GroundMethod, classify_ground
from eaves.ground.contours import ContourGround
from eaves.ground.smooth_region import SmoothRegion
from eaves.model import Mask, PointCloud


def hilly_scene() -> tuple[PointCloud, Mask]:
    """Six houses and some trees with late echoes on a hillside that falls to every side of its top."""
    rng = np.random.default_rng(1)
    count = 40000
    xy = rng.uniform(0, 120, (count, 2))
    z = 0.1 * xy[:, 0] + 2.0 * np.sin(xy[:, 1] / 40.0)
    truth = np.ones(count, bool)
    for east in (20.0, 60.0, 100.0):
        for north in (30.0, 80.0):
            inside = (np.abs(xy - [east, north]) < [6.0, 5.0]).all(axis=1)
            z[inside] = 0.1 * east + 2.0 * np.sin(north / 40.0) + 7.0
            truth[inside] = False
    number = np.ones(count, np.uint8)
    for east, north in rng.uniform(5, 115, (8, 2)):
        crown = (np.hypot(*(xy - [east, north]).T) < 3.0) & truth
        z[crown] += rng.uniform(2, 8, crown.sum())
        number[crown] = rng.integers(1, 4, crown.sum())
        truth[crown] = False
    z += 0.02 * rng.standard_normal(count)
    cloud = PointCloud.from_world(np.c_[xy, z], return_number=number, number_of_returns=np.maximum(number, 2))
    return cloud, truth


@pytest.mark.parametrize("method", [SmoothRegion(), ContourGround()])
def test_houses_and_trees_leave_a_hillside(method: GroundMethod) -> None:
    cloud, truth = hilly_scene()
    assert evaluate_ground(classify_ground(cloud, method).ground, truth).total_error < 0.04


def test_the_papers_one_region_is_kept_when_level_is_zero() -> None:
    rng = np.random.default_rng(2)
    xy = rng.uniform(0, 60, (20000, 2))
    z = np.where(xy[:, 0] > 40, -2.0, 0.0) + 0.01 * rng.standard_normal(20000)
    cloud = PointCloud.from_world(np.c_[xy, z])
    one = classify_ground(cloud, SmoothRegion.as_published()).ground
    both = classify_ground(cloud, SmoothRegion(level=3.0)).ground
    assert one[xy[:, 0] < 38].mean() > 0.9
    assert not one[xy[:, 0] > 42].any()
    assert both[xy[:, 0] > 42].mean() > 0.9
