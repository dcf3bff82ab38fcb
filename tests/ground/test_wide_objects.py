"""What stands over the terrain however wide it is, and what does not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from benchmarks.accuracy.ground_kinds import Drawn, fort, scan
from tests.conftest import but_first

from eaves.ground import classify_ground
from eaves.ground.adaptive_tin import AdaptiveTin
from eaves.ground.toolkit.floor import FINEST_M, Floor
from eaves.ground.toolkit.wide_objects import WideObjects, find_wide_objects
from eaves.model import Bounds, Mask, PointCloud, Points, Values

METHOD = AdaptiveTin()


def scatter(side: float = 200.0, density: float = 1.0, seed: int = 1) -> Points:
    """Points (N, 3) of a level square that begins at the origin, at height 0."""
    rng = np.random.default_rng(seed)
    count = int(density * side * side)
    return np.asarray(np.c_[rng.uniform(0.0, side, (count, 2)), rng.normal(0.0, 0.02, count)])


def box(points: Points, west: float, south: float, east: float, north: float) -> Mask:
    return Bounds(west, south, east, north).contains(points)


def share_of_ground(points: Points, part: Mask) -> float:
    """Share of some points that the default calls ground."""
    return float(classify_ground(PointCloud.from_world(points)).ground[part].mean())


@pytest.mark.parametrize("slope", but_first([0.1, 0.0]))
@pytest.mark.parametrize("roof", ["flat", "saw-tooth", "two levels", "vaulted"])
def test_a_hall_stands_on_the_terrain(slope: float, roof: str) -> None:
    points = scatter()
    hall = box(points, 50, 50, 150, 150)
    points[:, 2] += slope * points[:, 0]
    teeth, across = points[:, 1] % 10.0 / 3.0, points[:, 1] % 25.0 / 25.0
    over = {"flat": 0.0, "saw-tooth": teeth, "two levels": 4.0 * (points[:, 0] > 90)}
    over["vaulted"] = 20.0 * across * (1.0 - across)
    points[hall, 2] = 150.0 * slope + 6.0 + np.broadcast_to(over[roof], len(points))[hall]
    assert share_of_ground(points, hall) == 0.0
    assert share_of_ground(points, ~hall) > 0.99


def test_a_terrace_with_a_ramp_is_terrain() -> None:
    points = scatter()
    terrace = box(points, 50, 50, 120, 150)
    points[terrace, 2] += 5.0
    ramp = box(points, 120, 96, 165, 104)
    points[ramp, 2] += 5.0 - (points[ramp, 0] - 120.0) / 9.0
    assert share_of_ground(points, terrace) > 0.98


def test_a_courtyard_stays_terrain() -> None:
    points = scatter()
    court = box(points, 85, 85, 115, 115)
    hall = box(points, 50, 50, 150, 150) & ~court
    points[hall, 2] += 8.0
    assert share_of_ground(points, hall) == 0.0
    assert share_of_ground(points, court) > 0.99


@pytest.mark.parametrize("gate", [False, True])
def test_a_raised_court_between_wings_is_terrain(gate: bool) -> None:
    """Its rim drops to the street on one side, and rises to wings on the others."""
    points = scatter()
    palace, court = box(points, 56, 56, 144, 144), box(points, 70, 70, 130, 130)
    open_side = box(points, 70, 56, 130, 70)
    points[court, 2] += 4.0
    points[palace & ~court & ~open_side, 2] += 18.0
    if gate:
        points[open_side, 2] += 18.0
    assert share_of_ground(points, court) > 0.95
    assert share_of_ground(points, palace & ~court & ~open_side) == 0.0


def test_a_terrace_that_houses_stand_on_is_terrain_where_the_rim_of_the_data_cuts_it() -> None:
    points = scatter()
    houses = np.zeros(len(points), bool)
    for south in (15, 55, 95, 135, 175):
        houses |= box(points, 12, south, 32, south + 18)
    points[points[:, 0] < 60, 2] += 5.0
    points[houses, 2] += 9.0
    assert share_of_ground(points, ~houses) > 0.99
    assert share_of_ground(points, houses) == 0.0


@pytest.mark.parametrize("turn", [0.0, 30.0])
def test_a_roof_in_the_corner_of_the_data_stands_however_it_is_turned(turn: float) -> None:
    points = scatter()
    roof = box(points, 0, 0, 40, 36)
    points[roof, 2] += 7.0
    angle = np.radians(turn)
    across = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    points[:, :2] = points[:, :2] @ across
    assert share_of_ground(points, roof) == 0.0
    assert share_of_ground(points, ~roof) > 0.99


def test_penthouses_do_not_make_a_hall_terrain() -> None:
    points = scatter()
    hall = box(points, 50, 50, 150, 140)
    points[hall, 2] += 8.0
    for west in (60, 100):
        for south in (60, 100):
            points[box(points, west, south, west + 20, south + 20), 2] += 5.0
    assert share_of_ground(points, hall) == 0.0


def test_a_high_field_that_the_rim_of_the_data_cuts_is_terrain() -> None:
    points = scatter()
    high = points[:, 0] > 120.0
    points[high, 2] += 5.0
    assert share_of_ground(points, high) > 0.99


def test_what_the_rim_of_the_data_cuts_is_a_doubt() -> None:
    points = scatter()
    high = box(points, 150, 0, 200, 200)
    points[high, 2] += 5.0
    patch = find_wide_objects(Floor.of(PointCloud.from_world(points)), METHOD)
    assert [doubt.reason.endswith("cut by the rim of the data") for doubt in patch.doubts] == [True]
    assert 150.0 < patch.doubts[0].x < 200.0


def test_the_terrain_beneath_goes_on_from_outside() -> None:
    points = scatter()
    hall = box(points, 50, 50, 150, 150)
    points[:, 2] += 0.05 * points[:, 0]
    points[hall, 2] = 15.0
    wide = WideObjects((find_wide_objects(Floor.of(PointCloud.from_world(points)), METHOD),))
    beneath = wide.terrain_beneath(Bounds(0.0, 0.0, 200.0, 200.0), (0.0, 0.0))
    assert len(beneath) > 3500
    assert np.abs(beneath[:, 2] - 0.05 * beneath[:, 0]).max() < 0.2


def test_the_floor_does_not_depend_on_the_origin() -> None:
    points = scatter(60.0) + [1000.0, 2000.0, 0.0]
    one = Floor.of(PointCloud.from_world(points, origin=(960.0, 1920.0)))
    other = Floor.of(PointCloud.from_world(points, origin=(0.0, 0.0)))
    assert (one.west, one.north) == (other.west, other.north)
    np.testing.assert_array_equal(one.lowest, other.lowest)


def test_floors_merge_to_the_floor_of_all() -> None:
    points = scatter(60.0)
    whole = Floor.of(PointCloud.from_world(points))
    bounds = Bounds(0.0, 0.0, 60.0, 60.0)
    merged = Floor.empty(bounds)
    for part in (points[points[:, 0] < 20.25], points[points[:, 0] >= 20.25]):
        merged.merge(Floor.of(PointCloud.from_world(part, origin=(0.0, 0.0))))
    rows, columns = whole.shape
    top, left = merged.north - whole.north, whole.west - merged.west
    mine = np.s_[top : top + rows, left : left + columns]
    for name in ("lowest", "count"):
        np.testing.assert_array_equal(getattr(merged, name)[mine], getattr(whole, name))


def test_cells_grow_with_the_spacing() -> None:
    cells = [
        Floor.of(PointCloud.from_world(scatter(300.0, density))).in_wide_cells().cell
        for density in (4.0, 0.6, 0.1)
    ]
    assert cells == [FINEST_M, 2 * FINEST_M, 4 * FINEST_M]


def test_in_thin_data_what_stands_moves_with_the_data() -> None:
    points = scatter(180.0, 0.3)
    points[box(points, 50, 50, 130, 130), 2] += 6.0
    here, there = (
        find_wide_objects(Floor.of(PointCloud.from_world(points + [k * FINEST_M, k * FINEST_M, 0.0])), METHOD)
        for k in (4, 5)
    )
    assert (there.west, there.north) == (here.west + 1, here.north + 1)
    assert np.isfinite(here.ceiling).any() and not np.isfinite(here.ceiling).all()
    for name in ("ceiling", "terrain"):
        np.testing.assert_allclose(getattr(there, name), getattr(here, name), atol=1e-4)


def test_an_island_of_data_as_large_as_a_roof_is_a_doubt() -> None:
    points = scatter(60.0, 4.0)
    roof, rest = box(points, 40, 40, 55, 55), box(points, 0, 0, 60, 30)
    points[roof, 2] += 6.0 + 0.5 * np.abs(points[roof, 0] - 47.5)
    patch = find_wide_objects(Floor.of(PointCloud.from_world(points[roof | rest])), METHOD)
    (doubt,) = (one for one in patch.doubts if one.y > 30.0)
    assert doubt.reason.endswith("with nothing measured around, which may be a roof")
    assert 40.0 < doubt.x < 55.0 and 200.0 < doubt.area_m2 < 300.0


def test_a_doubt_in_thin_data_is_said_once() -> None:
    points = scatter(200.0, 0.6)
    points[points[:, 0] > 150.0, 2] += 5.0
    patch = find_wide_objects(Floor.of(PointCloud.from_world(points)), METHOD)
    assert len(patch.doubts) == 1 and 150.0 < patch.doubts[0].x < 200.0


def test_a_cropped_patch_says_the_same_of_what_it_holds() -> None:
    points = scatter()
    points[box(points, 50, 50, 150, 150), 2] += 6.0
    cloud = PointCloud.from_world(points)
    patch = find_wide_objects(Floor.of(cloud), METHOD)
    half = patch.cropped(Bounds(0.0, 0.0, 96.0, 240.0))
    whole, part = (WideObjects((one,)).over(cloud) for one in (patch, half))
    west = points[:, 0] < 96.0
    np.testing.assert_array_equal(part[west], whole[west])
    assert not part[~west].any()
    assert whole.mean() > 0.19


def test_seeds_of_wide_cells_take_nothing_away() -> None:
    method = AdaptiveTin(seed_cell=40.0)
    assert method.wide_buffer == 0.0
    assert method.find_wide_objects(Floor.of(PointCloud.from_world(scatter(50.0)))) is None


def test_a_works_with_machines_and_upper_floors_on_its_roof_stands() -> None:
    """Rims to what has no surface of its own say little, and those to scraps of roof nothing."""
    points, rng = scatter(), np.random.default_rng(2)
    works = box(points, 60, 60, 140, 140)
    points[works, 2] += 15.0
    upper = box(points, 66, 70, 86, 130) | box(points, 100, 74, 120, 128)
    points[upper, 2] += 4.0
    machines = works & ~upper & (rng.random(len(points)) < 0.2)
    points[machines, 2] += rng.uniform(1.0, 6.0, int(machines.sum()))
    assert share_of_ground(points, works) == 0.0


def drawn_kind(density: float, kind: Callable[[Values, Values], Drawn]) -> tuple[float, float]:
    """Shares of all points: ground lost, objects taken."""
    cloud, truth = scan(kind, density, seed=21)
    ground = classify_ground(cloud).ground
    return float(np.mean(truth & ~ground)), float(np.mean(~truth & ground))


@pytest.mark.parametrize("density", [0.5, 4.0])
def test_a_fort_that_a_ramp_leads_up_to_is_terrain(density: float) -> None:
    lost, taken = drawn_kind(density, fort)
    assert lost < 0.015
    assert taken < 0.005
