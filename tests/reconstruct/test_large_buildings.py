"""Street blocks: many planes under one outline."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from eaves.model import BuildingModel, Footprint, RoofPlane
from eaves.reconstruct import reconstruct_building
from eaves.reconstruct.jumps import MOST_TOGETHER, divide, strongest_strip_kernel
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
