"""What is said of roofs whose points at two times are made by hand, so that the answer is known exactly."""

import numpy as np
import pytest

from eaves.change.surface import (
    GROUND_BELOW,
    HIDDEN,
    ROOF_ABOVE,
    ROOF_BELOW,
    SAME,
    UNSEEN,
    face_points,
    fit_shift,
    nearest_distances,
    point_planes,
)
from eaves.change.verdict import (
    DEMOLISHED,
    EXTENDED,
    LOWERED,
    NEW,
    NOT_COVERED,
    PARTLY_DEMOLISHED,
    RAISED,
    ROOF_REPLACED,
    UNCHANGED,
    ChangeRules,
    Side,
    judge_building,
)
from eaves.model.cloud import BUILDING, GROUND, HIGH_VEGETATION

STEP = 0.5
"""Points lie on a grid of this side (m): four a square metre."""


def grid(west: float, south: float, east: float, north: float, z: float, a: float = 0.0, b: float = 0.0):
    """Points on a plane over a rectangle."""
    x, y = np.meshgrid(np.arange(west, east, STEP) + STEP / 2, np.arange(south, north, STEP) + STEP / 2)
    x, y = x.ravel(), y.ravel()
    return np.column_stack([x, y, z + a * x + b * y])


@pytest.mark.parametrize(("count", "others"), [(300, 400), (40, 1), (1, 10)])
def test_a_point_is_faced_with_those_that_all_distances_give(count: int, others: int) -> None:
    chance = np.random.default_rng(count)
    xyz, beside = chance.uniform(-9, 9, (count, 3)), chance.uniform(-3, 5, (others, 3))
    xyz[::2, :2] = np.round(xyz[::2, :2])  # on the borders of cells, and 1 m apart
    beside[::2, :2] = np.round(beside[::2, :2])
    slope = chance.uniform(-1, 1, (count, 2))
    way = beside[None] - xyz[:, None]
    square, over = (way[..., :2] ** 2).sum(axis=2), way[..., 2] - (way[..., :2] * slope[:, None]).sum(axis=2)
    state, _ = face_points(xyz, slope, beside, np.full(others, GROUND, np.uint8), 1.0, 0.25)
    assert ((state == UNSEEN) | (square <= 1.0).any(axis=1)).all()
    near = (square <= 1.0) & (np.abs(over) <= 2.0)
    least = np.where(near, square, np.inf)
    found = nearest_distances(xyz, slope, beside, 1.0, 2.0)
    assert (np.isfinite(found) == near.any(axis=1)).all()
    for number in np.flatnonzero(near.any(axis=1)):
        nearest = over[number, least[number] == least[number].min()]
        assert found[number] == pytest.approx(nearest[np.argmin(np.abs(nearest - found[number]))])


def epoch(*parts):
    """The points and classes of a scan: (points, class) pairs."""
    return np.concatenate([p for p, _ in parts]), np.concatenate(
        [np.full(len(p), c, np.uint8) for p, c in parts]
    )


def side(mine, theirs, inside) -> Side:
    """The roof points of one epoch inside a rectangle, faced with the other."""
    xyz, classes = mine
    roof = (classes == BUILDING) & (xyz[:, 0] > inside[0]) & (xyz[:, 0] < inside[2])
    roof &= (xyz[:, 1] > inside[1]) & (xyz[:, 1] < inside[3])
    slope, rms = point_planes(xyz[classes == BUILDING])
    own = roof[classes == BUILDING]
    faced = face_points(xyz[roof], slope[own], *theirs, radius=0.75, tolerance=0.25)
    count = int(roof.sum())
    flat = np.isfinite(rms[own])
    size, height = np.full(count, STEP**2), xyz[roof, 2]
    return Side(xyz[roof], *faced, flat, np.ones(count, bool), height, size)


HOUSE = (5.0, 5.0, 15.0, 13.0)
NEAR = (0.0, 0.0, 20.0, 20.0)


def garden(*holes, kind=GROUND, z=0.0):
    """The ground of 20 m by 20 m, without what stands on it."""
    xyz = grid(*NEAR, z)
    for west, south, east, north in holes:
        xyz = xyz[~((xyz[:, 0] > west) & (xyz[:, 0] < east) & (xyz[:, 1] > south) & (xyz[:, 1] < north))]
    return xyz, kind


def house(z: float = 6.0, where=HOUSE):
    return grid(*where, z), BUILDING


def judge(old, new, covered=(True, True)):
    return judge_building(side(old, new, NEAR), side(new, old, NEAR), ChangeRules(), covered, 1.5)


def test_the_same_house_is_unchanged() -> None:
    scan = epoch(garden(HOUSE), house())
    assert judge(scan, scan).change == UNCHANGED


@pytest.mark.parametrize(
    ("wide", "high", "long", "change"),
    [(2.5, 3.8, 12.0, UNCHANGED), (3.5, 3.8, 12.0, NEW), (2.5, 4.5, 12.0, NEW), (2.5, 2.5, 4.0, NEW)],
    ids=["a lorry", "a garage", "a narrow house", "a shed"],
)
def test_what_no_run_had_there_and_is_narrow_low_and_long_is_a_lorry(
    wide: float, high: float, long: float, change: str
) -> None:
    where = (5.0, 5.0, 5.0 + long, 5.0 + wide)
    before, after = epoch(garden()), epoch(garden(where), house(high, where))
    sides = side(before, after, NEAR), side(after, before, NEAR)
    for forward in (True, False):
        pair = sides if forward else sides[::-1]
        told = judge_building(*pair, ChangeRules(), (True, True), 1.5, (not forward, forward))
        assert told.change == (change if forward or change == UNCHANGED else DEMOLISHED)


def test_a_house_where_the_ground_was_is_new__and_the_other_way_round_demolished() -> None:
    empty, built = epoch(garden()), epoch(garden(HOUSE), house())
    new, gone = judge(empty, built), judge(built, empty)
    assert (new.change, gone.change) == (NEW, DEMOLISHED)
    assert new.height_m == pytest.approx(6.0)
    assert new.volume_m3 == pytest.approx(480.0)
    assert gone.volume_m3 == pytest.approx(-480.0)


@pytest.mark.parametrize(
    ("lift", "change"), [(0.5, RAISED), (3.0, RAISED), (-0.5, LOWERED), (0.2, UNCHANGED)]
)
def test_a_roof_that_moved_as_a_whole(lift: float, change: str) -> None:
    old, new = epoch(garden(HOUSE), house()), epoch(garden(HOUSE), house(6.0 + lift))
    verdict = judge(old, new)
    assert verdict.change == change
    if change != UNCHANGED:
        assert verdict.height_m == pytest.approx(lift)
        assert verdict.volume_m3 == pytest.approx(80.0 * lift, rel=0.02)  # corners are not seen


def test_an_annex_of_four_square_metres_extends_a_house() -> None:
    annex = (15.0, 6.0, 17.0, 8.0)
    old = epoch(garden(HOUSE), house())
    new = epoch(garden(HOUSE, annex), house(), house(3.0, annex))
    assert judge(old, new).change == EXTENDED
    assert judge(new, old).change == PARTLY_DEMOLISHED


def test_an_annex_where_a_crown_hid_most_of_the_ground() -> None:
    annex = (15.0, 6.0, 19.0, 10.0)
    crown = grid(15.0, 6.0, 19.0, 10.0, 9.0)
    under = grid(*annex, 0.0)[::3]
    old = epoch(garden(HOUSE, annex), house(), (crown, HIGH_VEGETATION), (under, GROUND))
    new = epoch(garden(HOUSE, annex), house(), house(3.0, annex))
    assert judge(old, new).change == EXTENDED
    nothing_seen = epoch(garden(HOUSE, annex), house(), (crown, HIGH_VEGETATION))
    assert judge(nothing_seen, new).change == UNCHANGED


def test_what_came_and_is_lower_than_any_roof_is_no_change() -> None:
    cars = (15.0, 6.0, 19.0, 10.0)
    old = epoch(garden(HOUSE), house())
    new = epoch(garden(HOUSE, cars), house(), house(1.5, cars))
    assert judge(old, new).change == UNCHANGED


def test_a_gable_in_place_of_a_flat_roof_is_a_replaced_roof() -> None:
    west, east = grid(5.0, 5.0, 10.0, 13.0, 1.0, a=0.7), grid(10.0, 5.0, 15.0, 13.0, 15.0, a=-0.7)
    old = epoch(garden(HOUSE), house(6.2))
    new = epoch(garden(HOUSE), (west, BUILDING), (east, BUILDING))
    assert judge(old, new).change == ROOF_REPLACED


def test_a_crown_over_a_house_hides_it_and_is_no_change() -> None:
    old = epoch(garden(HOUSE), house())
    crown = grid(5.0, 5.0, 10.0, 13.0, 9.0)
    new = epoch(garden(HOUSE), house(where=(10.0, 5.0, 15.0, 13.0)), (crown, HIGH_VEGETATION))
    assert judge(old, new).change == UNCHANGED


def test_a_house_that_the_new_epoch_has_no_points_of_is_not_covered__and_not_demolished() -> None:
    old, gap = epoch(garden(HOUSE), house()), epoch(garden(HOUSE))
    assert judge(old, gap).change == NOT_COVERED
    assert judge(old, gap, covered=(True, False)).change == NOT_COVERED


def test_what_a_point_is_faced_with() -> None:
    roof = np.array([[10.0, 10.0, 6.0]])
    flat = np.zeros((1, 2))

    def state(*points, kind=BUILDING):
        xyz = np.array(points, float).reshape(-1, 3)
        return int(face_points(roof, flat, xyz, np.full(len(xyz), kind, np.uint8), 0.75, 0.25)[0][0])

    around = [(9.8, 10.0), (10.2, 10.0), (10.0, 10.3), (10.0, 9.7)]
    assert state() == UNSEEN
    assert state((10.3, 10.0, 6.2)) == SAME
    assert state(*((x, y, 0.0) for x, y in around), kind=GROUND) == GROUND_BELOW
    assert state(*((x, y, 3.0) for x, y in around)) == ROOF_BELOW
    assert state(*((x, y, 8.0) for x, y in around)) == ROOF_ABOVE
    assert state(*((x, y, 8.0) for x, y in around), kind=HIGH_VEGETATION) == HIDDEN
    # a taller roof beside the point is seen past it, and the ground beside a wall says nothing
    assert state((10.6, 10.0, 20.0), (10.6, 10.1, 20.0)) == HIDDEN
    assert state((10.6, 10.0, 0.0), (10.6, 10.1, 0.0), kind=GROUND) == UNSEEN


def test_a_shift_is_found_from_slopes_to_all_sides__though_a_fifth_has_changed() -> None:
    rng = np.random.default_rng(1)
    slope = rng.uniform(-0.8, 0.8, (2000, 2))
    distance = 0.10 - slope @ np.array([0.06, -0.05]) + rng.normal(0.0, 0.02, 2000)
    distance[:400] += rng.uniform(0.5, 3.0, 400)
    shift = fit_shift(slope, distance)
    assert shift.vector == pytest.approx([0.06, -0.05, 0.10], abs=0.004)
    assert shift.noise == pytest.approx(0.02, rel=0.25)


def test_a_town_of_flat_roofs_gives_no_shift_in_plan() -> None:
    rng = np.random.default_rng(2)
    shift = fit_shift(rng.normal(0.0, 0.01, (500, 2)), np.full(500, 0.1))
    assert (shift.east, shift.north) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert shift.up == pytest.approx(0.1)
