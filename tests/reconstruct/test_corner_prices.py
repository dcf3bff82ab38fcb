"""Corners of a plan stay where points pay for them, and go elsewhere."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from eaves.model import Integers, Points
from eaves.reconstruct.arrangement import Arrangement, settle_corners
from eaves.solids.coverage import Coverage, coverage_of
from eaves.solids.extrude import is_sound

SPACING = 0.25
LOW, HIGH = np.array([0.0, 0.0, 3.0]), np.array([0.0, 0.0, 6.0])


def settled(cells: list[list[tuple[float, float]]], roof: Points, planes: list[np.ndarray]) -> Coverage:
    plan = coverage_of(np.array([shapely.Polygon(cell) for cell in cells], object), 0.001)
    assert plan is not None
    labels: Integers = np.arange(len(cells))
    method = Arrangement()
    known = np.array([*planes, planes[0]])
    answer, kept = settle_corners(
        plan,
        labels,
        roof,
        known,
        method,
        method.plane_points,
        method.residual_limit,
        np.zeros(len(known), np.int64),
    )
    assert is_sound(answer)
    assert len(kept) == answer.count
    assert answer.area.sum() == pytest.approx(plan.area.sum())
    return answer


def points_over(width: float, depth: float, low_is_west_of: np.ndarray) -> Points:
    """Points on two levels; the step is at `low_is_west_of` (x, y) along y."""
    x, y = np.meshgrid(np.arange(0.1, width, SPACING), np.arange(0.1, depth, SPACING))
    edge = np.interp(y, low_is_west_of[:, 1], low_is_west_of[:, 0])
    return np.column_stack([x.ravel(), y.ravel(), np.where(x < edge, 3.0, 6.0).ravel()])


def jogged(jog: float) -> list[list[tuple[float, float]]]:
    """Two cells side by side whose border jogs halfway."""
    west = [(0, 0), (4, 0), (4, 3), (4 + jog, 3), (4 + jog, 6), (0, 6)]
    east = [(4, 0), (8, 0), (8, 6), (4 + jog, 6), (4 + jog, 3), (4, 3)]
    return [west, east]


def test_jog_that_no_point_shows_goes() -> None:
    roof = points_over(8, 6, np.array([[4.0, 0.0], [4.0, 6.0]]))
    plan = settled(jogged(0.1), roof, [LOW, HIGH])
    assert len(plan.nodes) == 6


def test_jog_that_points_show_stays() -> None:
    roof = points_over(8, 6, np.array([[4.0, 0.0], [4.0, 3.0], [4.55, 3.001], [4.55, 6.0]]))
    plan = settled(jogged(0.55), roof, [LOW, HIGH])
    assert len(plan.nodes) == 8


def test_step_beside_a_corner_of_the_outline_goes_through_it() -> None:
    roof = points_over(8, 6, np.array([[4.0, 0.0], [4.0, 6.0]]))
    west = [(0, 0), (4.1, 0), (4.1, 6), (4, 6), (0, 6)]
    east = [(4.1, 0), (8, 0), (8, 5), (4.1, 5)]
    west.insert(2, (4.1, 5))
    plan = settled([west, east], roof, [LOW, HIGH])
    assert plan.count == 2
    notch = [(0, 0), (4.1, 0), (8, 0), (8, 6), (4, 6), (4, 6.5), (0, 6.5)]
    west, east = (
        [(0, 0), (4.1, 0), (4.1, 6), (4, 6), (4, 6.5), (0, 6.5)],
        [(4.1, 0), (8, 0), (8, 6), (4.1, 6)],
    )
    plan = settled([west, east], roof, [LOW, HIGH])
    inner = plan.nodes[plan.start[(plan.cell == 0) & (plan.cell[plan.twin] == 1)]]
    inner = np.vstack([inner, plan.nodes[plan.end[(plan.cell == 0) & (plan.cell[plan.twin] == 1)]]])
    assert (np.abs(inner - (4.0, 6.0)).max(axis=1) < 1e-9).any()
    assert len(plan.nodes) == len(notch)


def test_steps_of_metres_are_not_given_up_for_corners() -> None:
    roof = points_over(8, 6, np.array([[4.0, 0.0], [4.0, 3.0], [4.3, 3.001], [4.3, 6.0]]))
    high = np.array([0.0, 0.0, 23.0])
    roof[roof[:, 2] > 5.0, 2] = 23.0
    plan = settled(jogged(0.3), roof, [LOW, high])
    assert len(plan.nodes) == 8
