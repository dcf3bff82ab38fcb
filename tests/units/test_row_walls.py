"""Rows of which every wall is known: found where it shows, not where it does not."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from shapely import affinity, box

from eaves.units import divide_block
from eaves.units.row_walls.division import MergeRules, RowUnits, merged_units
from eaves.units.row_walls.evidence import EVEN, USUAL_NOISE_M, Roofs, roof_noise, traits_of, wall_signs
from eaves.units.row_walls.method import LARGE, SURE, chances_of, odds_of_several, sums_kernel
from eaves.units.row_walls.rows import HouseRow, Plan

HOUSE, DEPTH, SLOPE = 6.0, 9.0, 0.8


def scanned_row(
    steps: list[float], density: float = 10.0, noise: float = 0.03, chimneys: bool = False, seed: int = 1
) -> NDArray[np.float64]:
    """Points (N, 3) on gables side by side along x, lifted by `steps`; chimneys stand on walls if asked."""
    rng = np.random.default_rng(seed)
    count = round(len(steps) * HOUSE * DEPTH * density)
    x, y = rng.uniform(0, len(steps) * HOUSE, count), rng.uniform(0, DEPTH, count)
    z = 6.0 + np.array(steps)[(x // HOUSE).astype(int)] + SLOPE * np.minimum(y, DEPTH - y)
    if chimneys:
        wall = np.abs(x - np.round(x / HOUSE) * HOUSE) < 0.4
        z[wall] += 0.5
    return np.column_stack([x, y, z + rng.normal(0, noise, count)])


def walls_of(parts: tuple[shapely.Polygon, ...]) -> list[float]:
    """The x of the inner walls of parts that stand side by side."""
    return sorted(part.bounds[0] for part in parts)[1:]


def test_a_row_is_divided_at_steps_of_thirty_centimetres() -> None:
    points = scanned_row([0.0, 0.3, 0.0, 0.3, 0.6])
    outline = box(0, 0, 5 * HOUSE, DEPTH)
    division = divide_block(points, points[:, 2], outline, 0.3)
    assert len(division.parts) == 5
    assert np.allclose(walls_of(division.parts), HOUSE * np.arange(1, 5), atol=0.4)
    assert min(division.certainty) > 0.5


def test_the_parts_fill_the_block_and_share_their_walls() -> None:
    points = scanned_row([0.0, 0.5, -0.5, 0.4])
    outline = box(0, 0, 4 * HOUSE, DEPTH)
    parts = divide_block(points, points[:, 2], outline, 0.3).parts
    assert shapely.union_all(parts).symmetric_difference(outline).area < 1e-6
    assert sum(part.area for part in parts) == pytest.approx(outline.area, abs=1e-6)
    assert all(part.is_valid for part in parts)


def test_a_row_without_any_sign_stays_whole() -> None:
    points = scanned_row([0.0] * 5)
    assert len(divide_block(points, points[:, 2], box(0, 0, 5 * HOUSE, DEPTH), 0.3).parts) == 1


def depth_row(
    jog: float, plan_noise: float = 0.0, density: float = 10.0, seed: int = 1
) -> tuple[NDArray[np.float64], list[shapely.Polygon]]:
    """Points and houses of one even roof; every other house is deeper by `jog` on the street and behind."""
    rng = np.random.default_rng(seed)
    push = [jog * (k % 2) for k in range(6)]
    houses = [box(k * HOUSE, -push[k], (k + 1) * HOUSE, DEPTH + push[k]) for k in range(6)]
    xy = rng.uniform((0.0, -1.0), (6 * HOUSE, DEPTH + 1.0), (round(6 * HOUSE * (DEPTH + 2.0) * density), 2))
    xy = xy[shapely.contains_xy(shapely.union_all(houses), xy)]
    z = 6.0 + SLOPE * np.minimum(xy[:, 1], DEPTH - xy[:, 1]) + rng.normal(0, 0.03, len(xy))
    return np.column_stack([xy + rng.normal(0, plan_noise, xy.shape), z]), houses


def test_a_row_without_jogs_stays_whole__noise_8cm() -> None:
    points, houses = depth_row(0.0, plan_noise=0.1)
    assert len(divide_block(points, points[:, 2], shapely.union_all(houses), 0.3).parts) == 1


def test_the_noise_of_roofs_is_measured() -> None:
    for noise in (0.05, 0.1):
        points = scanned_row([0.0] * 4, noise=noise)
        assert roof_noise(points) == pytest.approx(noise, rel=0.15)
    assert roof_noise(scanned_row([0.0], noise=0.01)) == USUAL_NOISE_M


def test_one_bay_is_no_wall() -> None:
    points, _ = depth_row(0.0)
    rng = np.random.default_rng(5)
    bay = np.column_stack([rng.uniform(8.0, 11.0, 18), rng.uniform(-0.6, 0.0, 18), np.full(18, 5.8)])
    both = np.vstack([points, bay])
    outline = shapely.union_all([box(0, 0, 6 * HOUSE, DEPTH), box(8.0, -0.6, 11.0, 0.1)])
    assert len(divide_block(both, both[:, 2], outline, 0.3).parts) == 1


def test_parapets_on_the_walls_divide_a_row_of_one_height() -> None:
    points = scanned_row([0.0] * 4, chimneys=True)
    parts = divide_block(points, points[:, 2], box(0, 0, 4 * HOUSE, DEPTH), 0.3).parts
    assert len(parts) == 4


def test_a_large_hall_of_one_gable_stays_whole() -> None:
    rng = np.random.default_rng(2)
    x, y = rng.uniform(0, 60, 15000), rng.uniform(0, 25, 15000)
    points = np.column_stack([x, y, 8.0 + 0.15 * np.minimum(y, 25 - y) + rng.normal(0, 0.03, 15000)])
    assert len(divide_block(points, points[:, 2], box(0, 0, 60, 25), 0.3).parts) == 1


@pytest.mark.parametrize("depth", [15.0, 24.0])
def test_a_hall_with_plant_over_every_bay_stays_whole(depth: float) -> None:
    rng, length = np.random.default_rng(4), 8 * HOUSE
    x, y = (rng.uniform(0, side, round(10 * length * depth)) for side in (length, depth))
    plant = (np.abs(x - np.round(x / HOUSE) * HOUSE) < 0.4) & (np.mod(y, 6.0) < 2.0)
    z = 8.0 + np.where(plant, 0.6, 0.0) + rng.normal(0, 0.03, len(x))
    assert len(divide_block(np.column_stack([x, y, z]), z, box(0, 0, length, depth), 0.3).parts) == 1


def test_an_annex_belongs_to_the_house_it_stands_behind() -> None:
    points = scanned_row([0.0, 1.0, 0.0])
    rng = np.random.default_rng(3)
    annex = np.column_stack([rng.uniform(7, 11, 120), rng.uniform(DEPTH, DEPTH + 3, 120), np.full(120, 3.0)])
    both = np.vstack([points, annex])
    outline = shapely.union_all([box(0, 0, 3 * HOUSE, DEPTH), box(7, DEPTH, 11, DEPTH + 3)])
    parts = divide_block(both, both[:, 2], outline, 0.3).parts
    assert len(parts) == 3
    middle = min(parts, key=lambda part: abs(part.centroid.x - 1.5 * HOUSE))
    assert middle.contains(shapely.Point(9, DEPTH + 2))


@pytest.mark.parametrize(("steps", "parts"), [([0.0, 2.5], 1), ([0.0, 2.5, 0.0], 3)])
def test_a_house_with_a_lower_wing_stays_whole__a_row_of_three_is_divided(
    steps: list[float], parts: int
) -> None:
    points = scanned_row(steps)
    outline = box(0, 0, len(steps) * HOUSE, DEPTH)
    assert len(divide_block(points, points[:, 2], outline, 0.3).parts) == parts


def test_walls_that_a_sparse_scan_shows_prove_less() -> None:
    outline, told = box(0, 0, 3 * HOUSE, DEPTH), []
    row = HouseRow(np.zeros(2), np.array([1.0, 0.0]), np.array([0.0, 1.0]), np.zeros(72), np.full(72, DEPTH))
    units = RowUnits(row, np.array([24, 48]), np.array([0.9, 0.9]))
    odds = np.full(73, 2.0)
    for density in (1.0, 10.0):
        told.append(odds_of_several([units], [odds], round(density * outline.area), outline.area))
    assert told[0] < SURE < told[1]


def test_a_deep_hall_of_as_many_bays_is_less_likely_several_than_a_row() -> None:
    told = []
    for depth in (9.0, 25.0):
        row = HouseRow(
            np.zeros(2), np.array([1.0, 0.0]), np.array([0.0, 1.0]), np.zeros(96), np.full(96, depth), depth
        )
        units = RowUnits(row, np.array([24, 48, 72]), np.full(3, 0.9))
        told.append(odds_of_several([units], [np.full(97, 2.0)], round(240 * depth), 24 * depth))
    assert told[1] < 0.0 < told[0]


def test_no_house_of_rows_back_to_back_reaches_into_the_other_row() -> None:
    front = scanned_row([0.0, 0.8, 0.2, 1.0, 0.3, 0.9], density=20.0)
    back = scanned_row([0.9, 0.1, 0.7, 0.0, 0.6, 1.2], density=20.0, seed=2)
    for row in (front, back):
        row[:, 1] *= 15.0 / DEPTH
    points = np.vstack([front, back + [0.5 * HOUSE, 15.0, 0.0]])
    outline = shapely.union_all([box(0, 0, 6 * HOUSE, 15), box(0.5 * HOUSE, 15, 6.5 * HOUSE, 30)])
    parts = divide_block(points, points[:, 2], outline, 0.3).parts
    assert len(parts) == 12
    houses = [box(k * HOUSE, 0, (k + 1) * HOUSE, 15) for k in range(6)]
    houses += [affinity.translate(house, 0.5 * HOUSE, 15) for house in houses]
    for house in houses:
        shared = shapely.area(shapely.intersection(parts, house))
        assert (shared / (shapely.area(parts) + house.area - shared)).max() > 0.85


def test_what_rises_or_changes_all_over_a_roof_is_no_sign_of_a_wall() -> None:
    signs = np.zeros((97, 5))
    signs[:, 3], signs[:, 4] = 0.2, 3.0
    assert np.abs(traits_of(signs)[:, 4:]).max() < 1e-12
    signs[:, 3:] = 0.0, EVEN
    signs[48, 3:] = 0.2, 3.0
    traits = traits_of(signs)
    assert (traits[48, 4:] > 1.0).all()
    assert np.abs(traits[:24, 4:]).max() < 1e-12
    assert traits[47, 4:].max() < 0.0


def test_each_wall_has_a_certainty__and_a_part_that_of_its_least_sure() -> None:
    points = scanned_row([0.0, 0.6, 0.2, 0.9])
    division = divide_block(points, points[:, 2], box(0, 0, 4 * HOUSE, DEPTH), 0.3)
    assert [wall[:2] for wall in division.walls] == [(0, 1), (1, 2), (2, 3)]
    assert all(0.5 < sure < 1.0 for _, _, sure in division.walls)
    for number, least in enumerate(division.certainty):
        assert least == min(sure for a, b, sure in division.walls if number in (a, b))


def test_the_wall_between_rows_that_meet_at_a_corner_has_a_certainty() -> None:
    rng = np.random.default_rng(6)
    wing = rng.uniform((0.0, 0.0), (DEPTH, 24.0), (2160, 2))
    heights = 6.0 + 1.5 * (wing[:, 1] // HOUSE % 2) + SLOPE * np.minimum(wing[:, 0], DEPTH - wing[:, 0])
    row = scanned_row([0.0, 1.0, 0.2, 1.1]) + [DEPTH, 0.0, 0.0]
    points = np.vstack([np.column_stack([wing, heights + rng.normal(0, 0.03, len(wing))]), row])
    outline = shapely.union_all([box(0, 0, DEPTH, 24), box(DEPTH, 0, DEPTH + 4 * HOUSE, DEPTH)])
    division = divide_block(points, points[:, 2], outline, 0.3)
    borders = [
        sure
        for a, b, sure in division.walls
        if division.parts[a].bounds[2] <= DEPTH + 0.5 <= division.parts[b].bounds[2] - 4.0
        or division.parts[b].bounds[2] <= DEPTH + 0.5 <= division.parts[a].bounds[2] - 4.0
    ]
    assert borders and all(0.0 < sure < 1.0 for sure in borders)


def test_the_division_does_not_depend_on_the_order_of_points() -> None:
    points = scanned_row([0.0, 0.4, 0.0])
    outline = box(0, 0, 3 * HOUSE, DEPTH)
    turned = points[np.random.default_rng(4).permutation(len(points))]
    one, other = (divide_block(some, some[:, 2], outline, 0.3) for some in (points, turned))
    assert [part.wkb for part in one.parts] == [part.wkb for part in other.parts]
    assert one.certainty == other.certainty


def test_a_small_unit_goes_where_its_border_is_longest__small_ones_go_on_together() -> None:
    """Unit 1 (16 m²) has its longest border with 2 (24 m²), which has its own with 3."""
    outline = box(0, 0, 10, 14)
    points = np.column_stack(
        [np.random.default_rng(7).uniform((0, 0), (10, 14), (1400, 2)), np.full(1400, 5.0)]
    )
    plan = Plan.of(outline, points)
    label = np.zeros(plan.main.shape, np.int32)
    x, y = plan.places(*(part.ravel() for part in np.indices(label.shape))).T
    for unit, house in enumerate([box(6, 10, 10, 14), box(0, 10, 6, 14), box(0, 0, 10, 10)], 1):
        label.ravel()[shapely.contains_xy(house, x, y)] = unit
    none = HouseRow(np.zeros(2), np.array([1.0, 0.0]), np.array([0.0, 1.0]), np.zeros(4), np.ones(4))
    rows = [RowUnits(none, np.zeros(0, np.int64), np.zeros(0)) for _ in range(3)]
    number, walls = merged_units(plan, label, rows, Roofs.of(points), MergeRules())
    assert walls == {}
    assert set(np.unique(number[label > 0])) == {1}


def test_no_unit_has_a_strip_between_a_wall_and_a_step_of_the_outline() -> None:
    """The wall at x = 6 runs .6 m beside the side of an annex of the first house."""
    points = scanned_row([0.0, 0.8, 0.0])
    rng = np.random.default_rng(3)
    annex = np.column_stack(
        [rng.uniform(6.6, 11, 200), rng.uniform(DEPTH, DEPTH + 4, 200), np.full(200, 3.0)]
    )
    both = np.vstack([points, annex])
    outline = shapely.union_all([box(0, 0, 3 * HOUSE, DEPTH), box(5.4, DEPTH, 11, DEPTH + 4)])
    parts = divide_block(both, both[:, 2], outline, 0.3).parts
    assert len(parts) == 3
    opened = shapely.buffer(shapely.buffer(parts, -0.5, join_style="mitre"), 0.5, join_style="mitre")
    assert shapely.area(shapely.difference(parts, opened)).max() < 0.05


@pytest.mark.parametrize("contrast", [0.0, 0.4])
def test_roofs_of_one_height_are_parted_where_their_reflectance_changes(contrast: float) -> None:
    points = scanned_row([0.0] * 4)
    rng = np.random.default_rng(8)
    house = (points[:, 0] // HOUSE).astype(int)
    intensity = np.round(
        np.exp(4.0 + contrast * np.array([0, 2, -1, 1])[house] + rng.normal(0, 0.2, len(house)))
    )
    outline = box(0, 0, 4 * HOUSE, DEPTH)
    plain = wall_signs(whole_row(), points, USUAL_NOISE_M)
    signs = wall_signs(whole_row(), points, USUAL_NOISE_M, np.log(intensity))
    assert np.array_equal(signs[:, :4], plain[:, :4]) and (plain[:, 4] == EVEN).all()
    assert (signs[[24, 48, 72], 4] > EVEN + 1.0).all() == (contrast > 0.0)
    assert (signs[[12, 36, 60], 4] < EVEN).all()
    one = divide_block(points, points[:, 2], outline, 0.3, intensity=np.full(len(points), 7.0))
    assert one.parts == divide_block(points, points[:, 2], outline, 0.3).parts


def whole_row() -> HouseRow:
    """The ground of four houses."""
    return HouseRow(np.zeros(2), np.array([1.0, 0.0]), np.array([0.0, 1.0]), np.zeros(96), np.full(96, DEPTH))


@pytest.mark.slow
@pytest.mark.parametrize(("length", "turn"), [(400.0, 45.0), (1000.0, 0.0)])
def test_a_long_row_is_divided_in_little_memory(length: float, turn: float) -> None:
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0, length, round(36 * length)), rng.uniform(0, DEPTH, round(36 * length))
    lifted = 0.8 * rng.random(round(length / 5.0))[np.minimum(x / 5.0, length / 5.0 - 1).astype(int)]
    z = 7.0 + lifted + SLOPE * np.minimum(y, DEPTH - y) + rng.normal(0, 0.02, len(x))
    cosine, sine = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    points = np.column_stack([x * cosine - y * sine, x * sine + y * cosine, z])
    outline = affinity.rotate(box(0, 0, length, DEPTH), turn, origin=(0, 0))
    tracemalloc.start()
    try:
        parts = divide_block(points, z, outline, 0.5).parts
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(parts) > 0.9 * length / 5.0
    assert peak < 40e6


def sums_of_a_row(units: int) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Odds of walls at each quarter metre of a row of 5 m units, odds of widths, prior."""
    odds = np.full(20 * units + 1, 0.02)
    odds[::20] = 400.0
    width = np.maximum(np.arange(len(odds)), 1) / 4.0
    widths = np.array([np.ones(len(odds)), 0.3 + 4.0 * np.exp(-0.5 * (np.log(width / 5.0) / 0.07) ** 2)])
    return odds, widths, np.array([np.exp(2.0), 1.0])


@pytest.mark.parametrize("units", [12, 100, 300])
def test_chances_of_walls_are_those_of_short_rows__however_long_a_row_is(units: int) -> None:
    chance = chances_of(*sums_of_a_row(units))
    assert np.isfinite(chance).all() and (chance <= 1.0 + 1e-9).all()
    assert np.allclose(chance[20:-20:20], 1.0, atol=0.01)
    middle = chances_of(*sums_of_a_row(12))[60:120]
    assert np.allclose(chance[60:120], middle, atol=1e-6)


def test_sums_of_an_ordinary_row_are_not_scaled__those_of_a_long_one_are() -> None:
    odds, widths, prior = sums_of_a_row(12)
    forward, backward, before, after = sums_kernel(odds, widths)
    assert not before.any() and not after.any()
    plain = prior @ (forward * backward) / float(prior @ forward[:, -1])
    assert np.array_equal(chances_of(odds, widths, prior)[1:-1], plain[1:-1])
    forward, _, before, _ = sums_kernel(*sums_of_a_row(300)[:2])
    assert before[:, -1].min() > 1 and forward.max() <= LARGE
