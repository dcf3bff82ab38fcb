"""Street blocks: many planes under one outline."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
import shapely
from shapely import Polygon

from eaves.model import BuildingModel, Footprint, Points, RoofPlane
from eaves.reconstruct import reconstruct_building
from eaves.reconstruct.arrangement import Arrangement
from eaves.reconstruct.toolkit.attributes import surface_heights
from eaves.reconstruct.toolkit.evidence import MOST_PLANES, largest_only
from eaves.reconstruct.toolkit.height_steps import MOST_TOGETHER, divide, strongest_strip_kernel
from eaves.reconstruct.toolkit.line import Line
from eaves.reconstruct.toolkit.plan_lines import (
    FEWEST_LINES,
    LINES_PER_PLANE,
    OVERSHOOT,
    PARALLEL,
    border_samples,
    extend,
)
from eaves.roof import segment_roof
from eaves.validate.models import validate_model

SIDE, WIDTH = 10, 6.0


def test_every_roof_of_a_block_of_a_hundred_is_found() -> None:
    rng = np.random.default_rng(3)
    heights = 6.0 + rng.permutation(SIDE * SIDE) * 0.1
    xy = rng.uniform(0.0, SIDE * WIDTH, (4 * int(SIDE * WIDTH) ** 2, 2))
    owner = (xy // WIDTH).astype(int) @ np.array([1, SIDE])
    points = np.column_stack([xy, heights[owner] + 0.01 * rng.normal(size=len(xy))])
    planes = [
        RoofPlane((0.0, 0.0, float(height)), np.flatnonzero(owner == number), 0.01)
        for number, height in enumerate(heights)
    ]
    block = Footprint(shapely.box(0.0, 0.0, SIDE * WIDTH, SIDE * WIDTH))
    answer = reconstruct_building(points, block, planes, 0.0)
    assert isinstance(answer, BuildingModel)
    assert answer.lod == "2.2"
    assert not validate_model(answer)
    assert answer.attributes["rmse95_m"] < 0.02
    assert answer.attributes["roof_face_count"] >= 0.9 * SIDE * SIDE


@pytest.mark.parametrize("seed", range(5))
def test_the_strongest_strip_is_the_best_of_all(seed: int) -> None:
    rng = np.random.default_rng(seed)
    offsets, weights, width = rng.random((3, 40)), rng.random(40), 0.1
    left, trust = rng.random(40) < 0.7, np.array([1.0, 1.3, 0.8])
    order = np.argsort(offsets, axis=1, kind="stable")
    columns = np.take_along_axis(offsets, order, axis=1)
    best, first = strongest_strip_kernel(columns, order, weights, left, trust, width)

    def weight(direction: int, start: float) -> float:
        inside = (offsets[direction] >= start) & (offsets[direction] <= start + width) & left
        return float(trust[direction] * weights[inside].sum())

    most = max(
        weight(direction, float(start)) for direction in range(3) for start in offsets[direction][left]
    )
    assert weight(best, float(columns[best, first])) == pytest.approx(most)


def test_many_places_are_divided_and_none_is_lost() -> None:
    places = np.random.default_rng(0).random((3 * MOST_TOGETHER, 2))
    groups = divide(places)
    assert max(map(len, groups)) <= MOST_TOGETHER
    assert np.array_equal(np.sort(np.concatenate(groups)), np.arange(len(places)))
    assert len(divide(np.ones((3 * MOST_TOGETHER, 2)))) == 4


def checkerboard(side: int, width: float, density: float) -> tuple[Points, list[RoofPlane], Footprint]:
    """Points, planes and footprint of `side` × `side` flat roofs of `width` (m), no two alike."""
    rng = np.random.default_rng(3)
    heights = 6.0 + rng.permutation(side * side) * 0.1
    xy = rng.uniform(0.0, side * width, (int(density * (side * width) ** 2), 2))
    owner = (xy // width).astype(int) @ np.array([1, side])
    points = np.column_stack([xy, heights[owner] + 0.01 * rng.normal(size=len(xy))])
    planes = [
        RoofPlane((0.0, 0.0, float(height)), np.flatnonzero(owner == number), 0.01)
        for number, height in enumerate(heights)
    ]
    return points, planes, Footprint(shapely.box(0.0, 0.0, side * width, side * width))


def test_hundreds_of_self_contacts_are_resolved() -> None:
    points, planes, footprint = checkerboard(16, 4.0, 4.0)
    answer = reconstruct_building(points, footprint, planes, 0.0)
    assert isinstance(answer, BuildingModel)
    assert answer.lod == "2.2" and not validate_model(answer)
    assert answer.attributes["roof_face_count"] >= 0.9 * 16 * 16


@pytest.mark.slow
def test_thousands_of_planes_cost_bounded_work() -> None:
    points, planes, footprint = checkerboard(42, 3.0, 3.0)
    seen: dict[str, object] = {}
    answer = Arrangement().model(points, footprint, planes, 0.0, seen.__setitem__)
    assert isinstance(answer, BuildingModel) and not validate_model(answer)
    lines, cells = seen["lines"], seen["plane of each cell"]
    assert isinstance(lines, np.ndarray) and isinstance(cells, np.ndarray)
    assert len(lines) <= FEWEST_LINES + LINES_PER_PLANE * (MOST_PLANES + 1)
    assert len(np.unique(cells)) <= MOST_PLANES + 1


def test_only_the_largest_planes_take_part() -> None:
    sizes = np.arange(1, MOST_PLANES + 101)
    owner = np.repeat(np.arange(len(sizes)), sizes).astype(np.int32)
    kept = np.unique(largest_only(owner, np.arange(len(owner))))
    assert kept.tolist() == [-1, *range(100, len(sizes))]


def test_lines_are_lengthened_as_by_trying_every_pair() -> None:
    rng = np.random.default_rng(5)
    box = shapely.box(0.0, 0.0, 300.0, 200.0)
    lines = []
    for _ in range(400):
        angle, (x, y) = rng.choice([0.3, 0.3 + np.pi / 2, 1.1]), rng.uniform(0.0, 200.0, 2)
        nx, ny = float(np.cos(angle)), float(np.sin(angle))
        along = -ny * x + nx * y
        half = float(rng.uniform(0.5, 4.0))
        lines.append(Line((nx, ny), nx * x + ny * y, along - half, along + half, 1.0, False))
    assert np.allclose(extend(lines, box, 1.0), extended_by_every_pair(lines, box, 1.0))


def test_lengthening_thousands_of_lines_keeps_no_table_of_pairs() -> None:
    number = 3000
    lines = [Line((1.0, 0.0), 0.1 * k, 0.0, 1.0, 1.0, False) for k in range(number)]
    tracemalloc.start()
    extend(lines, shapely.box(0.0, 0.0, 300.0, 200.0), 1.0)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < number**2


def extended_by_every_pair(lines: list[Line], polygon: Polygon, extension: float) -> np.ndarray:
    """The slow twin of `extend`: a table of every line with every other and every edge."""
    normal = np.array([line.normal for line in lines])
    offset = np.array([line.offset for line in lines])
    low = np.array([line.low for line in lines]) - extension
    high = np.array([line.high for line in lines]) + extension
    direction = np.column_stack([-normal[:, 1], normal[:, 0]])
    foot = normal * offset[:, None]
    ring = np.asarray(polygon.exterior.coords)
    starts = np.vstack([foot + direction * low[:, None], ring[:-1]])
    ends = np.vstack([foot + direction * high[:, None], ring[1:]])
    before, after = starts @ normal.T - offset, ends @ normal.T - offset
    crosses = (before * after <= 0.0) & (np.abs(before - after) > PARALLEL)
    share = before / np.where(crosses, before - after, 1.0)
    along = starts @ direction.T + share * ((ends - starts) @ direction.T)
    up = np.where(crosses & (along >= high), along, np.inf).min(axis=0)
    down = np.where(crosses & (along <= low), along, -np.inf).max(axis=0)
    last = np.where(np.isfinite(up), up + OVERSHOOT, high)
    first = np.where(np.isfinite(down), down - OVERSHOOT, low)
    return np.hstack([foot + direction * first[:, None], foot + direction * last[:, None]])


def test_border_samples_of_few_or_collinear_points_are_none() -> None:
    square = shapely.box(-1.0, -1.0, 9.0, 9.0)
    for points in (np.zeros((0, 3)), np.zeros((2, 3)), np.column_stack([np.arange(6.0)] * 3)):
        labels = (np.arange(len(points)) % 2).astype(np.int32)
        pairs, places, weights = border_samples(points, labels, square, 0.5, Arrangement().line_limits())
        assert len(pairs) == len(places) == len(weights) == 0


def test_dome_becomes_facets_within_a_hand_of_it() -> None:
    rng = np.random.default_rng(4)
    disc = shapely.Point(0.0, 0.0).buffer(8.0, quad_segs=24)
    xy = rng.uniform(-8.0, 8.0, (1024, 2))
    xy = xy[shapely.contains_xy(disc, xy[:, 0], xy[:, 1])]
    height = 6.0 + 0.8 * np.sqrt(100.0 - (xy**2).sum(axis=1))
    points = np.column_stack([xy, height + rng.normal(0.0, 0.02, len(xy))])
    footprint = Footprint(shapely.orient_polygons(shapely.set_precision(disc, 0.001)))
    answer = reconstruct_building(points, footprint, segment_roof(points, 0.5), 0.0)
    assert isinstance(answer, BuildingModel) and answer.lod == "2.2" and not validate_model(answer)
    surface, cosine, _ = surface_heights(answer.solids["2.2"], xy)
    assert np.percentile(np.abs(surface - height) * cosine, 95.0) < 0.15


@pytest.mark.slow
def test_thirty_thousand_square_metres_and_900_planes_reach_lod_22() -> None:
    points, _, footprint = checkerboard(30, 5.8, 4.0)
    answer = reconstruct_building(points, footprint, segment_roof(points, 0.5), 0.0)
    assert isinstance(answer, BuildingModel) and answer.lod == "2.2" and not validate_model(answer)
    assert 850 <= answer.attributes["roof_face_count"] <= 950
    assert answer.attributes["rmse95_m"] < 0.05
