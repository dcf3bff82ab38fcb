"""Adaptive TIN: terrain with exact truth, then the figures on real data."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eaves.evaluate.matching import evaluate_ground
from eaves.ground import classify_ground
from eaves.ground.adaptive_tin import AdaptiveTin
from eaves.model import Bounds, Mask, PointCloud
from eaves.model.cloud import snap
from eaves.simulate.scanner import scan_town
from eaves.simulate.town import simulate_town


def scene(
    density: float, slope: float = 0.0, seed: int = 1, noise: float = 0.02, side: float = 100.0
) -> tuple[PointCloud, Mask]:
    """Houses, a hall of 35 m and bushes on a slope with a ditch; the truth of each point."""
    rng = np.random.default_rng(seed)
    count = int(density * side * side)
    xy = rng.uniform(0, side, (count, 2))
    terrain = slope * xy[:, 0] - 1.5 * np.exp(-(((xy[:, 1] - 90.0) / 2.0) ** 2))
    height = np.zeros(count)
    for west, south, width, depth, high in [
        (10, 10, 10, 8, 6.0),
        (30, 12, 12, 9, 7.0),
        (50, 40, 35, 30, 12.0),
        (12, 50, 9, 20, 5.0),
        (40, 12, 6, 4, 3.0),
    ]:
        inside = (np.abs(xy - [west + width / 2, south + depth / 2]) < [width / 2, depth / 2]).all(axis=1)
        height[inside] = high + slope * (west + width / 2 - xy[inside, 0])
    for east, north in rng.uniform(5, 95, (15, 2)):
        near = np.hypot(*(xy - [east, north]).T) < 1.5
        leaf = near & (rng.random(count) < 0.7) & (height == 0)
        height[leaf] = rng.uniform(0.8, 3.0, leaf.sum())
    z = terrain + height + noise * rng.standard_normal(count)
    return PointCloud.from_world(np.c_[xy, z]), height == 0


@pytest.mark.parametrize("density", [0.3, 1.0, 4.0, 20.0])
@pytest.mark.parametrize("slope", [0.0, 0.3])
def test_houses_hall_and_bushes_leave__terrain_stays(density: float, slope: float) -> None:
    cloud, truth = scene(density, slope)
    score = evaluate_ground(classify_ground(cloud).ground, truth)
    assert score.total_error < (0.05 if density < 1 else 0.02)


def test_a_terrace_is_ground_on_both_levels() -> None:
    rng = np.random.default_rng(2)
    xy = rng.uniform(0, 100, (40000, 2))
    z = np.where(xy[:, 0] > 50 + 5 * np.sin(xy[:, 1] / 9), 4.0, 0.0) + 0.02 * rng.standard_normal(40000)
    assert classify_ground(PointCloud.from_world(np.c_[xy, z])).ground.mean() > 0.99


def test_a_steep_even_hillside_is_ground() -> None:
    rng = np.random.default_rng(3)
    xy = rng.uniform(0, 100, (20000, 2))
    cloud = PointCloud.from_world(np.c_[xy, 1.0 * xy[:, 0] + 0.03 * rng.standard_normal(20000)])
    assert classify_ground(cloud).ground.mean() > 0.99


def test_low_outliers_do_not_draw_the_ground_down() -> None:
    cloud, truth = scene(4.0)
    xyz = cloud.xyz.copy()
    fallen = np.random.default_rng(4).choice(len(xyz), 12, replace=False)
    xyz[fallen, 2] = -8.0
    ground = classify_ground(cloud.with_(xyz=xyz)).ground
    assert not ground[fallen].any()
    kept = np.delete(np.arange(len(xyz)), fallen)
    assert evaluate_ground(ground[kept], truth[kept]).total_error < 0.02


@pytest.mark.parametrize("density", [0.3, 4.0])
def test_only_the_core_is_answered_and_as_ever(density: float) -> None:
    cloud, _ = scene(density, slope=0.1)
    core = Bounds(31.0, 22.0, 69.0, 75.0)
    inside = core.contains(cloud.xyz)
    everything, part = classify_ground(cloud), classify_ground(cloud, core=core)
    assert everything.classification is not None and everything.part is not None
    assert part.classification is not None and part.part is not None
    assert (part.classification == everything.classification)[inside].all()
    assert (part.part == everything.part)[inside].all()
    assert not part.ground[~core.buffered(AdaptiveTin().rim_apart).contains(cloud.xyz)].any()


@pytest.mark.parametrize("left", [0, 1, 2])
def test_a_core_may_be_empty_or_nearly(left: int) -> None:
    cloud, _ = scene(4.0)
    core = Bounds(40.0, 40.0, 60.0, 60.0)
    close = np.flatnonzero(core.buffered(AdaptiveTin().rim_apart).contains(cloud.xyz))
    kept = np.setdiff1d(np.arange(len(cloud)), close[left:])
    found = classify_ground(cloud.take(kept), core=core)
    assert found.ground.sum() <= left


def test_seed_cells_are_axelssons_start() -> None:
    cloud, truth = scene(4.0)
    plain = AdaptiveTin(seed_cell=40.0, distance_share=2.8, angle=14.0, rounds=1000)
    score = evaluate_ground(classify_ground(cloud, plain).ground, truth)
    assert score.total_error < 0.05


@pytest.mark.parametrize("count", [0, 1, 2, 3, 50])
@pytest.mark.parametrize("kind", ["same", "line", "flat"])
def test_few_and_degenerate_points_have_a_result(count: int, kind: str) -> None:
    line = np.arange(count, dtype=float)
    xyz = {
        "same": np.ones((count, 3)),
        "line": np.c_[line, line, np.zeros(count)],
        "flat": np.c_[line % 7, line // 7, np.zeros(count)],
    }[kind]
    ground = classify_ground(PointCloud(xyz.reshape(-1, 3))).ground
    assert ground.shape == (count,)
    assert ground.all()


@pytest.mark.parametrize(("sample", "most"), [("12", 0.032), ("21", 0.028), ("31", 0.025), ("53", 0.075)])
def test_isprs_samples_stay_as_good_as_they_are(data: Path, sample: str, most: float) -> None:
    rows = np.loadtxt(data / "isprs_filter" / f"samp{sample}.txt")
    ground = classify_ground(PointCloud.from_world(rows[:, :3])).ground
    assert evaluate_ground(ground, rows[:, 3] == 0).total_error <= most


def test_where_cells_fall_matters_less_when_several_sets_of_them_decide() -> None:
    scene = scan_town(simulate_town(0.0225, terrain="terraced", seed=2), density=1.0, seed=2)
    moved = scene.cloud.with_(xyz=snap(scene.cloud.xyz + [0.37, 0.61, 0.0]))

    def changed(looks: int) -> float:
        method = AdaptiveTin(looks=looks)
        return float(
            np.mean(classify_ground(scene.cloud, method).ground != classify_ground(moved, method).ground)
        )

    one, five = changed(1), changed(5)
    assert one > 0.002
    assert five < 0.75 * one
