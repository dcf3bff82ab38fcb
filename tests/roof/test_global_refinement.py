"""The refinement of labels and planes: on exact roofs with dormers, chimneys and walls."""

from __future__ import annotations

import numpy as np
import pytest

from eaves.roof import segment_roof
from eaves.roof.global_refinement import GlobalRefinement
from eaves.roof.region_growing import RegionGrowing
from eaves.simulate.objects.houses import nine_roofs_on_a_slope


def dormered_gable(count: int, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) of a gable of 12 m × 8 m with a flat dormer of 2 m and a chimney, and labels (N,)."""
    rng = np.random.default_rng(7)
    xy = rng.uniform([-6, -4], [6, 4], (count, 2))
    z, label = 3.0 - 0.75 * abs(xy[:, 1]), (xy[:, 1] > 0).astype(int)
    dormer = (abs(xy[:, 0] - 2) < 1) & (xy[:, 1] > 1.2) & (xy[:, 1] < 3.2)
    chimney = (abs(xy[:, 0] + 3) < 0.4) & (abs(xy[:, 1] + 1) < 0.4)
    z[dormer], label[dormer] = 2.4, 2
    z[chimney], label[chimney] = 4.0, 3
    return np.c_[xy, z + rng.normal(0, noise, count)], label


@pytest.mark.parametrize("density", [3, 10, 40])
def test_dormer_is_found__noise_3cm(density: int) -> None:
    points, label = dormered_gable(96 * density, 0.03)
    planes = segment_roof(points, density**-0.5, GlobalRefinement())
    for number in (0, 1, 2):
        assert max(np.mean(np.isin(np.flatnonzero(label == number), p.members)) for p in planes) > 0.8


def test_a_plane_cut_in_two_by_a_gap_is_one() -> None:
    rng = np.random.default_rng(8)
    xy = rng.uniform(0, [12, 6], (900, 2))
    xy = xy[abs(xy[:, 0] - 6) > 0.6]
    points = np.c_[xy, 0.5 * xy[:, 1] + rng.normal(0, 0.02, len(xy))]
    assert len(segment_roof(points, 0.28, GlobalRefinement())) == 1


def test_walls_are_no_roof_planes() -> None:
    rng = np.random.default_rng(9)
    roof, _ = dormered_gable(960, 0.03)
    walls = [
        np.c_[
            rng.uniform(-6, 6, 300), np.full(300, side) + rng.normal(0, 0.03, 300), rng.uniform(-6, -0.3, 300)
        ]
        for side in (-4.0, 4.0)
    ]
    planes = segment_roof(np.r_[roof, *walls], 0.32, GlobalRefinement())
    assert max(plane.slope for plane in planes) < np.radians(60)
    assert sum(np.sum(plane.members >= 960) for plane in planes) < 30


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_nine_roofs_have_their_planes(noise: float) -> None:
    scene = nine_roofs_on_a_slope(10.0, noise)
    truth = scene.faces
    for building in scene.buildings:
        own = np.flatnonzero(scene.building == building.number)
        planes = segment_roof(scene.cloud.xyz[own], 0.32)
        for face in building.faces:
            if face.polygon.area < 2.0 or face.polygon.buffer(-0.3).is_empty:
                continue
            on = np.flatnonzero(scene.plane[own] == face.number)
            best = max(planes, key=lambda plane: np.isin(on, plane.members).mean())
            assert np.isin(on, best.members).mean() > 0.8, (building.kind, face.number)
            away = best.height_at(scene.cloud.xyz[own][on]) - truth[face.number].height_at(
                scene.cloud.xyz[own][on]
            )
            assert np.sqrt(np.mean(away**2)) < 0.04, (building.kind, face.number)


def test_it_finds_what_region_growing_finds_and_more() -> None:
    points, _ = dormered_gable(300, 0.03)
    spacing = 96**0.5 / 300**0.5
    assert len(segment_roof(points, spacing, GlobalRefinement())) >= len(
        segment_roof(points, spacing, RegionGrowing())
    )


def test_far_away_the_result_is_the_same() -> None:
    points, _ = dormered_gable(500, 0.03)
    points = np.round(points * 1e4) / 1e4
    here = segment_roof(points, 0.44)
    there = segment_roof(points + np.array([480000.0, 240000.0, 0.0]), 0.44)
    assert [set(plane.members) for plane in here] == [set(plane.members) for plane in there]


def test_roof_of_scan_lines_far_apart_gets_its_planes__points_2cm_apart_on_lines_1m_apart() -> None:
    rng = np.random.default_rng(2)
    x, y = np.meshgrid(np.arange(-7.5, 7.5, 1.0), np.arange(-5.0, 5.0, 0.02))
    xy = np.column_stack([x.ravel() + rng.normal(0.0, 0.01, x.size), y.ravel()])
    points = np.c_[xy, 5.0 - 0.6 * np.abs(xy[:, 1]) + rng.normal(0.0, 0.02, len(xy))]
    planes = segment_roof(points, 0.14, GlobalRefinement())
    assert len(planes) == 2
    assert np.sort(np.concatenate([plane.members for plane in planes])).size > 0.95 * len(points)
    assert {round(plane.coefficients[1], 1) for plane in planes} == {-0.6, 0.6}


def test_roof_at_the_edge_of_a_strip_gets_its_planes__most_points_2cm_apart_on_lines_in_one_corner() -> None:
    rng = np.random.default_rng(0)
    x, y = np.meshgrid(np.arange(-5.0, 5.0, 0.9), np.arange(-4.0, 4.0, 0.9))
    sparse = np.column_stack([x.ravel(), y.ravel()]) + rng.normal(0.0, 0.1, (x.size, 2))
    x, y = np.meshgrid(np.arange(3.0, 5.0, 0.018), np.arange(-4.0, 4.0, 0.75))
    lines = np.column_stack([x.ravel(), y.ravel() - 0.2 * x.ravel()])
    xy = np.concatenate([sparse, lines[np.abs(lines[:, 1]) < 4.0]])
    points = np.c_[xy, 5.0 - 0.6 * np.abs(xy[:, 1]) + rng.normal(0.0, 0.02, len(xy))]
    planes = segment_roof(points, 0.7, GlobalRefinement())
    assert len(planes) == 2
    assert {round(plane.coefficients[1], 1) for plane in planes} == {-0.6, 0.6}
    assert np.concatenate([plane.members for plane in planes]).size > 0.9 * len(points)
