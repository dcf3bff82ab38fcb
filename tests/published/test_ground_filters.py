"""Smooth region and contours on scenes they are made for."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eaves.evaluate.matching import evaluate_ground
from eaves.geometry.planes import grow_regions, local_planes
from eaves.ground import GroundMethod, classify_ground
from eaves.model import Bounds, Mask, PointCloud, Raster
from eaves.published.ren_fcs.ground import ContourGround
from eaves.published.xiao2014.smooth_region import SmoothRegion
from eaves.raster.contours import Contour
from eaves.raster.grid import cell_centres, empty_raster


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


def test_the_first_round_of_the_iteration_makes_the_filter__and_none_leaves_the_contours() -> None:
    cloud, truth = hilly_scene()
    errors = [
        evaluate_ground(classify_ground(cloud, ContourGround(rounds=rounds)).ground, truth).total_error
        for rounds in (0, 1, 10)
    ]
    assert errors[0] > 0.1
    assert errors[2] <= errors[1] < 0.04


@pytest.mark.parametrize(
    ("xy", "closed", "expected"),
    [
        ([[0, 0], [80, 0], [80, 90]], False, True),
        ([[0, 0], [50, 0], [50, 90]], True, False),
        ([[0, 0], [100, 0], [100, 50], [10, 0]], False, False),
        ([[0, 0], [60, 0]], False, False),
    ],
    ids=["long and open", "closed", "ends near", "short"],
)
def test_a_contour_lies_on_terrain_by_closing_ends_and_length(
    xy: list[list[float]], closed: bool, expected: bool
) -> None:
    line = np.array(xy, np.float64) + [84900.0, 447500.0]
    assert ContourGround().on_terrain(Contour(3.0, line, closed)) == expected


def slope_cut(side: float, rise: float) -> tuple[Raster, list[Contour]]:
    """A surface of side x side m that rises by `rise` per metre between 20 and 24 m east, and contours
    from rim to rim in it."""
    surface = empty_raster(Bounds(85_000.0, 447_000.0, 85_000.0 + side, 447_000.0 + side), 0.5)
    east = cell_centres(surface)[:, 0].reshape(surface.shape) - 85_000.0
    surface = surface.with_(values=(0.2 + rise * np.clip(east - 20.0, 0.0, 4.0)).astype(np.float32))
    return surface, ContourGround().draw_contours(surface)[1:-1]


@pytest.mark.parametrize(
    ("side", "rise", "expected"),
    [(50.0, 0.5, True), (50.0, 3.0, False), (130.0, 0.5, True), (130.0, 3.0, True)],
    ids=["a slope", "a row of houses", "a slope, long", "a wall, long"],
)
def test_a_contour_across_narrow_data_is_long_where_no_wall_is(
    side: float, rise: float, expected: bool
) -> None:
    surface, contours = slope_cut(side, rise)
    assert contours and all(one.end_distance > side - 1.5 for one in contours)
    assert {ContourGround().on_terrain(one, surface) for one in contours} == {expected}
    assert {ContourGround(wall_slope=1e9).on_terrain(one, surface) for one in contours} == {True}
    assert {ContourGround().on_terrain(one) for one in contours} == {side > 120.0}


def test_a_contour_from_one_side_to_the_next_is_not_across_the_data() -> None:
    surface = slope_cut(50.0, 0.0)[0]
    short = np.array([[85_000.0, 447_030.0], [85_020.0, 447_050.0]])
    across = np.array([[85_000.0, 447_010.0], [85_049.0, 447_030.0]])
    assert not ContourGround().on_terrain(Contour(3.0, short, False), surface)
    assert ContourGround().on_terrain(Contour(3.0, across, False), surface)


def test_a_row_of_houses_from_rim_to_rim_of_a_narrow_tile_is_no_ground() -> None:
    x, y = (side.ravel() for side in np.meshgrid(*2 * [np.arange(0.0, 50.0, 0.5) + 310.0]))
    row, crowns = np.abs(x - y) < 10.0, x - y >= 10.0
    z = 12.2 + np.where(row, 9.0, np.where(crowns, np.random.default_rng(1).uniform(0.0, 8.7, len(x)), 0.0))
    cloud = PointCloud(np.c_[x, y, z])
    assert not ContourGround().ground_mask(cloud)[row].any()
    assert ContourGround(wall_slope=1e9).ground_mask(cloud)[row].any()


def test_contours_apart_and_both_terrains_are_steps() -> None:
    cloud, _ = hilly_scene()
    steps: dict[str, Any] = {}
    classify_ground(cloud, ContourGround(), debug=steps.__setitem__)
    assert list(steps) == [
        "surface",
        "contours on terrain",
        "contours off terrain",
        "first terrain",
        "terrain",
    ]
    for title, expected in (("contours on terrain", True), ("contours off terrain", False)):
        assert all(ContourGround().on_terrain(one, steps["surface"]) is expected for one in steps[title])
    assert np.abs(steps["first terrain"].values - steps["terrain"].values).max() > 0.5


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


def podium(height: float) -> tuple[np.ndarray, Mask]:
    """Points (N, 3) half a metre apart, off the origin, and which of them lie on a podium in the middle."""
    x, y = (side.ravel() for side in np.meshgrid(np.arange(0.0, 40.0, 0.5), np.arange(0.0, 30.0, 0.5)))
    on = (np.abs(x - 20.0) < 6.0) & (np.abs(y - 15.0) < 5.0)
    return np.c_[x + 310.0, y + 170.0, 12.0 + np.where(on, height, 0.0)], on


@pytest.mark.parametrize("height", [0.3, 0.6, 2.0])
def test_a_step_of_like_normals_parts_a_surface_where_links_lie_in_its_plane(height: float) -> None:
    xyz, on = podium(height)
    planes = local_planes(xyz, 24, 24)
    level = replace(planes, normals=np.tile([0.0, 0.0, 1.0], (len(xyz), 1)))  # the truth of each point
    parted, whole = (grow_regions(xyz, level, 9.0, flat) for flat in (True, False))
    assert len(np.unique(parted)) == 2
    assert np.array_equal(parted == parted[on.argmax()], on)
    assert len(np.unique(whole)) == 1


def test_a_low_podium_is_no_ground_where_links_lie_in_its_plane() -> None:
    xyz, on = podium(0.6)
    parted, whole = (
        SmoothRegion(level=0.0, flat_links=flat).ground_mask(PointCloud(xyz)) for flat in (True, False)
    )
    assert parted[~on].all() and whole[~on].all()
    assert not parted[on].any()
    assert whole[on].mean() > 0.3  # where the estimated normals bend over the step
