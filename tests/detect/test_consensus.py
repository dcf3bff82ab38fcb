"""The consensus: evidence, segments, the cut and the whole, on scenes with exact truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eaves.detect import detect_buildings
from eaves.detect.consensus import Consensus
from eaves.detect.consensus.evidence import (
    find_segments,
    gather_evidence,
    inner_width,
    planes_kernel,
    window_sum,
)
from eaves.detect.consensus.groups import source_side, without_pores
from eaves.detect.stage import OBJECT
from eaves.geometry.planes import sums_of
from eaves.model import PointCloud
from eaves.model.scene import ROOF, WALL
from eaves.raster.surfaces import make_scene
from tests.detect.made_scenes import MadeScene, two_houses_and_a_tree


@pytest.mark.parametrize("density", [1.0, 2.0, 4.0, 8.0, 25.0])
@pytest.mark.parametrize("returns", [True, False])
def test_two_houses_are_found_and_the_tree_is_not(density: float, returns: bool) -> None:
    scene, what = two_houses_and_a_tree(density).scene(returns)
    found = detect_buildings(scene, Consensus())
    assert found.count == 2
    assert (found.label[what < 0] > 0).mean() < 0.05
    for house in (1, 2):
        assert (found.label[what == house] > 0).mean() > 0.95
    assert ((found.score > 0.5) & (found.score <= 1.0)).all()


def test_a_crown_over_the_eaves_is_not_part_of_the_house() -> None:
    made = MadeScene(density=10.0)
    made.box(20.0, 20.0, 32.0, 30.0, 5.0, 1)
    made.tree(35.0, 25.0, 4.0, 11.0, -1)
    scene, what = made.scene()
    found = detect_buildings(scene, Consensus())
    assert found.count == 1
    assert (found.label[what == 1] > 0).mean() > 0.9
    assert (found.label[what < 0] > 0).mean() < 0.1


def test_a_van_is_no_building_and_a_shed_is() -> None:
    made = MadeScene(density=12.0)
    made.box(10.0, 10.0, 15.5, 12.1, 2.4, -1)
    made.box(30.0, 30.0, 33.6, 33.2, 2.4, 1)
    scene, what = made.scene()
    found = detect_buildings(scene, Consensus())
    assert found.count == 1
    assert (found.label[what == 1] > 0).mean() > 0.9
    assert not (found.label[what < 0] > 0).any()


def test_walls_belong_to_their_house_as_walls() -> None:
    made = MadeScene(density=10.0)
    made.box(20.0, 20.0, 32.0, 30.0, 6.0, 1)
    y = made.rng.uniform(20.0, 30.0, 600)
    made.add(np.c_[np.full(600, 31.95), y], made.rng.uniform(0.8, 4.8, 600), 2)
    scene, what = made.scene()
    found = detect_buildings(scene, Consensus())
    assert found.count == 1
    assert found.part is not None
    assert (found.part[what == 2] == WALL).mean() > 0.9
    assert (found.part[what == 1] == ROOF).mean() > 0.95


def test_a_chimney_is_part_of_its_roof() -> None:
    made = two_houses_and_a_tree(12.0)
    xy = made.scatter(40.0, 40.0, 40.8, 40.8)
    made.add(xy, np.full(len(xy), 7.3), 3)
    scene, what = made.scene()
    found = detect_buildings(scene, Consensus())
    assert (found.label[what == 3] > 0).all()


def test_a_large_even_roof_that_splits_every_pulse_is_found() -> None:
    made = two_houses_and_a_tree(12.0)
    slats = made.scatter(10.0, 25.0, 22.0, 33.0)
    one = np.ones(len(slats), np.uint8)
    made.add(slats, np.full(len(slats), 3.0), 3, one, 2 * one)
    made.add(slats, np.zeros(len(slats)), 0, 2 * one, 2 * one)
    made.taken.append((10.0, 25.0, 22.0, 33.0))
    scene, what = made.scene()
    assert (detect_buildings(scene, Consensus()).label[what == 3] > 0).mean() > 0.9
    blind = Consensus(even_area=1e9)
    assert (detect_buildings(scene, blind).label[what == 3] > 0).mean() < 0.1, (
        "so that the rule is what does it"
    )


def test_a_ship_is_a_building_with_a_doubt() -> None:
    made = MadeScene(density=16.0)
    made.box(35.0, 35.0, 55.0, 40.0, 4.0, 2)
    made.box(10.0, 35.0, 22.0, 45.0, 6.0, 3)
    scene, what = made.scene()
    assert scene.cloud.classification is not None
    x, y = scene.cloud.xyz[:, 0], scene.cloud.xyz[:, 1]
    classes = np.where((what == 0) & (x > 30.0) & (y > 30.0), 9, scene.cloud.classification).astype(np.uint8)
    scene = replace(scene, cloud=scene.cloud.with_(classification=classes))
    doubts = detect_buildings(scene, Consensus()).doubts
    places = {one.reason.split(":")[0]: (one.x, one.y) for one in doubts}
    assert places["a building or a ship"] == pytest.approx((45.0, 37.5), abs=1.0)
    assert len(doubts) == 1


def test_an_uneven_region_is_a_doubt_where_echoes_tell_nothing() -> None:
    made = two_houses_and_a_tree(12.0)
    made.noise = 0.09
    made.box(10.0, 28.0, 18.0, 36.0, 5.0, 3)
    made.noise = 0.02
    scene, _ = made.scene(returns=False)
    doubts = [one for one in detect_buildings(scene, Consensus()).doubts if "crown" in one.reason]
    assert [(one.x, one.y) for one in doubts] == [pytest.approx((14.0, 32.0), abs=1.0)]


def test_a_flat_hedge_beside_a_house_is_not_of_it__under_two_metres() -> None:
    made = two_houses_and_a_tree(12.0)
    made.box(22.2, 12.0, 30.0, 15.0, 1.75, -2)
    scene, what = made.scene()
    found = detect_buildings(scene, Consensus())
    assert not found.label[(what == -2) & (scene.cloud.xyz[:, 0] > 23.0)].any()
    assert (found.label[what == 1] > 0).mean() > 0.99


def test_a_roof_goes_on_below_a_crown() -> None:
    made = two_houses_and_a_tree(12.0)
    roof = made.scatter(47.0, 38.0, 49.5, 42.0)
    made.taken.append((47.0, 38.0, 49.5, 42.0))
    several = np.full(len(roof), 2, np.uint8)
    made.add(roof, np.full(len(roof), 6.0), 3, several, several)
    above = made.rng.uniform(8.0, 11.0, len(roof))
    made.add(roof, above, -2, np.ones(len(roof), np.uint8), several)
    scene, what = made.scene()
    found = detect_buildings(scene, Consensus())
    assert found.count == 2
    assert (found.label[what == 3] > 0).mean() > 0.8
    assert (found.label[what == -2] > 0).mean() < 0.2


def test_a_terrace_on_a_slope_is_not_a_building() -> None:
    made = MadeScene(density=8.0)
    scene, _ = made.scene()
    assert detect_buildings(scene, Consensus()).count == 0


def test_the_residual_beside_a_ridge_is_that_of_the_faces() -> None:
    scene, what = two_houses_and_a_tree(8.0).scene()
    evidence = gather_evidence(scene, scene.cloud.xyz, what == 1, 0.5, Consensus())
    assert np.median(evidence.residual[evidence.candidate]) < 0.03
    assert (evidence.residual[evidence.candidate] < 0.12).mean() > 0.9
    segments = find_segments(evidence, evidence.candidate & (evidence.residual < 0.12), 0.12, 2.0)
    assert (segments.area > 30.0).sum() == 2


def test_a_plane_is_regressed_exactly() -> None:
    xy = np.random.default_rng(0).uniform(0, 3, (50, 2))
    z = 0.4 * xy[:, 0] - 0.2 * xy[:, 1] + 1.0
    sums = sums_of(np.c_[xy, z], np.zeros(50, int), 1)
    place, count = np.zeros((1, 1), int), np.full((1, 1), 50.0)
    planes = planes_kernel(sums, place, count, 3, 6, 0.7)
    assert np.allclose(planes.ravel(), [0.4, -0.2, 1.0, 0.0], atol=1e-6)
    assert planes_kernel(sums, place, count, 3, 6, 1.0)[3, 0, 0] == np.inf


def test_windows_sum_three_by_three_cells() -> None:
    values = np.zeros((5, 6))
    values[0, 0], values[2, 3] = 1.0, 2.0
    assert window_sum(values)[1].tolist() == [1.0, 1.0, 2.0, 2.0, 2.0, 0.0]


def test_the_width_of_a_segment_is_that_of_its_largest_square() -> None:
    label = np.zeros((12, 12), np.int32)
    label[1:8, 2:7] = 1
    label[10, :] = 2
    assert inner_width(label, 2).tolist() == [5.0, 1.0]
    label[:, 11] = 3
    label[1:9, 8:10] = 4


def test_the_cut_is_the_least() -> None:
    rng = np.random.default_rng(4)
    for _ in range(20):
        gain, loss = rng.uniform(0, 3, (2, 6)).round(2)
        one, two = np.array([[0, 1, 2, 3, 4, 0], [1, 2, 3, 4, 5, 3]], np.int32)
        price = rng.uniform(0, 2, 6).round(2)
        states = (np.arange(64)[:, None] >> np.arange(6)) & 1
        energy = (~states.astype(bool) * gain + states * loss).sum(axis=1)
        energy = energy + (price * (states[:, one] != states[:, two])).sum(axis=1)
        cut = source_side(gain, loss, (one, two, price))
        found = int((cut * (1 << np.arange(6))).sum())
        assert energy[found] == pytest.approx(energy.min())


def test_a_glass_roof_is_found_by_its_rim_and_a_pond_is_not() -> None:
    made = MadeScene(density=12.0)
    for west, south, east, north in ((20, 20, 27, 21), (20, 26, 27, 27), (20, 21, 21, 26), (26, 21, 27, 26)):
        made.box(west, south, east, north, 2.6, 1)
    made.taken.append((21.0, 21.0, 26.0, 26.0))
    made.taken.append((40.0, 40.0, 46.0, 46.0))
    scene, what = made.scene()
    found = detect_buildings(scene, Consensus())
    assert found.count == 1
    assert (found.label[what == 1] > 0).mean() > 0.9


@pytest.mark.parametrize(("passing", "share"), [(0.1, 0.99), (0.3, 0.99), (0.6, 0.97)])
def test_a_roof_that_pulses_pass_through_is_whole(passing: float, share: float) -> None:
    made = MadeScene(size=90.0, seed=4)
    made.box(20.0, 20.0, 70.0, 60.0, 12.0, 1)
    scene, what = made.scene()
    xyz = scene.cloud.xyz.copy()
    inner = (np.abs(xyz[:, :2] - (45.0, 40.0)) < (20.0, 15.0)).all(axis=1)
    through = inner & (made.rng.random(len(xyz)) < passing)
    xyz[through, 2] = 0.0
    classes = np.where((what == 0) | through, 2, 1).astype(np.uint8)
    cloud = PointCloud(xyz, classification=classes)
    found = detect_buildings(make_scene(cloud), Consensus())
    assert (found.label[inner & ~through] > 0).mean() > share


def test_pores_of_one_surface_count_as_roof_and_courts_do_not() -> None:
    roof = np.zeros((40, 40), bool)
    roof[2:38, 2:38] = True
    surface = roof.astype(np.int32)
    surface[:, 20:] *= 2  # two surfaces
    roof[5:8, 5:8] = roof[10, 3:15] = False  # a pore and a narrow one
    roof[15:20, 18:22] = False  # between the two
    roof[25:31, 5:11] = False  # a court of 3 m by 3 m
    filled = without_pores(roof, surface, 0.5, 2.5)
    assert filled[5:8, 5:8].all() and filled[10, 3:15].all()
    assert not filled[15:20, 18:22].any() and not filled[25:31, 5:11].any()
    assert not filled[:2].any() and (filled >= roof).all()


@pytest.mark.parametrize("has_returns", [False, True])
def test_a_rough_object_of_the_size_of_a_house_is_a_doubt_where_no_pulse_is_split(has_returns: bool) -> None:
    rng = np.random.default_rng(4)
    xyz = np.c_[rng.uniform(0.0, 60.0, (20_000, 2)), np.zeros(20_000)]
    heap = (np.abs(xyz[:, :2] - 30.0) < 4.0).all(axis=1)
    xyz[heap, 2] = rng.uniform(4.0, 7.0, int(heap.sum()))
    first, split = np.ones(len(xyz), np.uint8), np.where(np.arange(len(xyz)) % 50 == 0, 2, 1).astype(np.uint8)
    returns = {"return_number": first, "number_of_returns": split} if has_returns else {}
    cloud = PointCloud(xyz, classification=np.where(heap, 1, 2).astype(np.uint8), **returns)
    found = detect_buildings(make_scene(cloud))
    said = [doubt for doubt in found.doubts if doubt.reason.startswith(OBJECT)]
    assert found.count == 0
    assert len(said) == (0 if has_returns else 1)
    for doubt in said:
        assert (doubt.x, doubt.y) == pytest.approx((30.0, 30.0), abs=0.5)
        assert doubt.area_m2 == pytest.approx(64.0, rel=0.2)
