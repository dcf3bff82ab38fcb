"""Street blocks: many planes under one outline."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from eaves.figures.attributes import surface_heights
from eaves.model import BuildingModel, Footprint, Points, RoofPlane
from eaves.reconstruct import reconstruct_building
from eaves.reconstruct.arrangement import Arrangement
from eaves.reconstruct.toolkit.evidence import MOST_PLANES, largest_only
from eaves.reconstruct.toolkit.plan_lines import MOST_TOGETHER
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


@pytest.mark.slow
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
    assert len(lines) <= MOST_TOGETHER
    assert len(np.unique(cells)) <= MOST_PLANES + 1


def test_only_the_largest_planes_take_part() -> None:
    sizes = np.arange(1, MOST_PLANES + 101)
    owner = np.repeat(np.arange(len(sizes)), sizes).astype(np.int32)
    kept = np.unique(largest_only(owner, np.arange(len(owner))))
    assert kept.tolist() == [-1, *range(100, len(sizes))]


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
