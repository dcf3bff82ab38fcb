"""What is a vehicle and what a shed, of tops whose points are made by hand."""

import numpy as np
import pytest
import shapely

from eaves.change.vehicles import StandingRules, are_vehicles, is_pitched, width_of

STEP = 0.35
"""Eight points a square metre."""


def top(long: float, wide: float, high: float, pitch: float = 0.0, at: float = 0.0, turn: float = 20.0):
    """Points and outline of a top with a ridge along its middle, turned by some degrees."""
    x, y = np.meshgrid(np.arange(STEP / 2, long, STEP), np.arange(STEP / 2, wide, STEP))
    z = high + pitch * (wide / 4 - np.abs(y - wide / 2))
    outline = shapely.box(0.0, at, long, at + wide)
    rotation = np.array([[np.cos(np.radians(turn)), -np.sin(np.radians(turn))],
                         [np.sin(np.radians(turn)), np.cos(np.radians(turn))]])  # fmt: skip
    plan = np.column_stack([x.ravel(), y.ravel() + at]) @ rotation.T
    return np.column_stack([plan, z.ravel()]), shapely.transform(outline, lambda xy: xy @ rotation.T)


def judged(xyz, outline) -> bool:
    return are_vehicles(xyz, float(np.median(xyz[:, 2])), STEP**2, StandingRules(), 0.75, outline)


@pytest.mark.parametrize(
    ("long", "wide", "high", "pitch", "vehicle"),
    [
        (5.5, 2.0, 2.4, 0.0, True),
        (6.1, 2.45, 2.6, 0.0, True),
        (12.0, 2.5, 3.8, 0.0, True),
        (5.2, 2.4, 2.3, 0.0, False),
        (5.6, 2.45, 2.6, 0.4, False),
        (3.5, 2.4, 2.6, 0.0, False),
        (6.0, 3.0, 2.6, 0.0, False),
        (12.0, 2.5, 4.6, 0.0, False),
    ],
    ids=["van", "container", "lorry", "low shed", "pitched shed", "short shed", "garage", "narrow house"],
)
def test_one_body(long: float, wide: float, high: float, pitch: float, vehicle: bool) -> None:
    assert judged(*top(long, wide, high, pitch)) == vehicle


def test_two_vans_in_one_outline_are_vehicles__and_a_shed_of_their_size_is_none() -> None:
    (one, left), (other, right) = top(5.5, 2.0, 2.4), top(5.5, 2.0, 2.5, at=2.8)
    both = shapely.convex_hull(shapely.union(left, right))
    assert width_of(both) > StandingRules().width
    assert judged(np.concatenate([one, other]), both)
    assert not judged(*top(5.5, 4.8, 2.4))


def test_lines_of_a_scan_are_no_bodies() -> None:
    xyz, outline = top(3.6, 3.5, 2.5, turn=0.0)
    lines = np.isin(np.round(xyz[:, 1] / STEP - 0.5).astype(int) % 3, (0,))
    assert not judged(xyz[lines], outline)


def test_windscreens_slope_along_a_van__and_points_at_its_sides_are_no_pitch() -> None:
    xyz, _ = top(5.5, 2.0, 2.4, turn=0.0)
    xyz[xyz[:, 0] > 4.8, 2] -= 0.45
    xyz[(xyz[:, 1] < 0.3) | (xyz[:, 1] > 1.7), 2] -= 0.3
    assert not is_pitched(xyz, StandingRules())
    assert is_pitched(top(5.5, 2.4, 2.4, pitch=0.4)[0], StandingRules())
