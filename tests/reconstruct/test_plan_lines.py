"""The lines of the fullest strips, and lines lengthened to the next."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
import shapely
from shapely import Polygon

from eaves.geometry.rings import COORDINATE_STEP
from eaves.reconstruct.toolkit.plan_lines import (
    MOST_TOGETHER,
    Line,
    border_places,
    divide,
    extend,
    fullest_strip_kernel,
    meeting_lines_kernel,
    rectangles_kernel,
    step_lines,
)
from eaves.solids.coverage import OVERSHOOT


def test_two_rows_of_places_give_two_lines__the_longer_first() -> None:
    along = np.linspace(0.0, 5.0, 21)
    places = np.vstack(
        [
            np.column_stack([along, np.full(21, 2.0)]),
            np.column_stack([np.full(11, 8.0), along[:11]]),
            [[20.0, 20.0], [30.0, 30.0]],
        ]
    )
    lines = list(step_lines(places, np.array([[0.0, 1.0], [1.0, 0.0]]), 0.25))
    assert lines == [Line(0.0, 1.0, 2.0, -5.0, 0.0, 21.0), Line(1.0, 0.0, 8.0, 0.0, 2.5, 11.0)]


def test_a_row_with_a_gap_is_two_lines() -> None:
    along = np.concatenate([np.linspace(0.0, 3.0, 13), np.linspace(9.0, 11.0, 9)])
    places = np.column_stack([along, np.zeros(len(along))])
    lines = step_lines(places, np.array([[0.0, 1.0]]), 0.25)
    assert [(line.low, line.high) for line in lines] == [(-3.0, 0.0), (-11.0, -9.0)]


@pytest.mark.parametrize("seed", range(5))
def test_the_fullest_strip_is_the_fullest_of_all(seed: int) -> None:
    rng = np.random.default_rng(seed)
    offsets, width = rng.random((3, 40)), 0.1
    left = rng.random(40) < 0.7
    order = np.argsort(offsets, axis=1, kind="stable")
    columns = np.take_along_axis(offsets, order, axis=1)
    strips = [fullest_strip_kernel(*row, left, width) for row in zip(columns, order, strict=True)]
    inside = (offsets[:, None, :] >= offsets[:, :, None]) & (offsets[:, None] <= offsets[:, :, None] + width)
    most = (inside & left).sum(axis=2)[:, left].max(axis=1)
    for direction, (count, first, last) in enumerate(strips):
        assert count == left[order[direction, first:last]].sum() == most[direction]


def test_many_places_are_divided_and_none_is_lost() -> None:
    places = np.random.default_rng(0).random((3 * MOST_TOGETHER, 2))
    groups = list(divide(places))
    assert max(map(len, groups)) <= MOST_TOGETHER
    assert np.array_equal(np.sort(np.concatenate(groups), axis=0), np.sort(places, axis=0))
    assert len(list(divide(np.ones((3 * MOST_TOGETHER, 2))))) == 4


def test_lines_are_lengthened_as_by_trying_every_pair() -> None:
    rng = np.random.default_rng(5)
    box = shapely.box(0.0, 0.0, 300.0, 200.0)
    lines = []
    for _ in range(400):
        angle, (x, y) = rng.choice([0.3, 0.3 + np.pi / 2, 1.1]), rng.uniform(0.0, 200.0, 2)
        nx, ny = float(np.cos(angle)), float(np.sin(angle))
        along = -ny * x + nx * y
        half = float(rng.uniform(0.5, 4.0))
        lines.append(Line(nx, ny, nx * x + ny * y, along - half, along + half, 1.0))
    assert np.allclose(extend(lines, box, 1.0), extended_by_every_pair(lines, box, 1.0))
    assert extend([], box, 1.0).shape == (0, 4)


def test_lengthening_thousands_of_lines_keeps_no_table_of_pairs() -> None:
    number = 3000
    lines = [Line(1.0, 0.0, 0.1 * k, 0.0, 1.0, 1.0) for k in range(number)]
    tracemalloc.start()
    extend(lines, shapely.box(0.0, 0.0, 300.0, 200.0), 1.0)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < number**2


def extended_by_every_pair(lines: list[Line], polygon: Polygon, extension: float) -> np.ndarray:
    """The slow twin of `extend`: a table of every line with every other and every edge."""
    x, y, offset, low, high, _ = np.array(lines).T
    normal, direction = np.column_stack([x, y]), np.column_stack([-y, x])
    low, high = low - extension, high + extension
    foot = normal * offset[:, None]
    ring = np.asarray(polygon.exterior.coords)
    starts = np.vstack([foot + direction * low[:, None], ring[:-1]])
    ends = np.vstack([foot + direction * high[:, None], ring[1:]])
    before, after = starts @ normal.T - offset, ends @ normal.T - offset
    crosses = (before * after <= 0.0) & (np.abs(before - after) > COORDINATE_STEP)
    share = before / np.where(crosses, before - after, 1.0)
    along = starts @ direction.T + share * ((ends - starts) @ direction.T)
    up = np.where(crosses & (along >= high), along, np.inf).min(axis=0)
    down = np.where(crosses & (along <= low), along, -np.inf).max(axis=0)
    last = np.where(np.isfinite(up), up + OVERSHOOT, high)
    first = np.where(np.isfinite(down), down - OVERSHOOT, low)
    return np.hstack([foot + direction * first[:, None], foot + direction * last[:, None]])


def test_border_places_of_few_or_collinear_points_are_none() -> None:
    square = shapely.box(-1.0, -1.0, 9.0, 9.0)
    for points in (np.zeros((0, 3)), np.zeros((2, 3)), np.column_stack([np.arange(6.0)] * 3)):
        pairs, places = border_places(points, (np.arange(len(points)) % 2).astype(np.int32), square)
        assert len(pairs) == len(places) == 0


@pytest.mark.parametrize("count", [6, 50, 51, 101])
def test_the_sides_of_a_rectangle_are_percentiles_of_numpy__to_the_bit(count: int) -> None:
    points = np.random.default_rng(count).normal(size=(count, 3)) * [9.0, 4.0, 1.0]
    labels = np.zeros(count, np.int32)
    rows = rectangles_kernel(points, labels, np.array([0]), np.array([0.0]), 0.25, 6, 2.0)
    low, high = np.percentile(points[:, :2], [2.0, 98.0], axis=0) + [[-0.25], [0.25]]
    assert rows[:, 2].tolist() == [low[0], high[0], low[1], high[1]]
    assert rows[:, 3:5].tolist() == [[low[1], high[1]]] * 2 + [[-high[0], -low[0]]] * 2
    assert len(rectangles_kernel(points, labels, np.array([0]), np.array([0.0]), 0.25, count + 1, 2.0)) == 0


def test_two_planes_meet_where_their_border_runs_along_the_line__and_places_beside_it_are_jumps() -> None:
    planes = np.array([[0.0, 0.5, 0.0], [0.0, -0.5, 4.0], [0.0, 0.0, 9.0]])  # the first two meet at y = 4
    places = np.array([[1.0, 4.0], [2.0, 4.1], [3.0, 3.9], [4.0, 4.0], [2.0, 7.0], [5.0, 5.0]])
    pairs = np.array([[0, 1]] * 5 + [[1, 2]])
    lines, jumps = meeting_lines_kernel(pairs, places, planes, 0.5)
    assert lines.tolist() == [[0.0, 1.0, 4.0, -4.0, -1.0, 4.0]]
    assert jumps.tolist() == [False] * 4 + [True] * 2
