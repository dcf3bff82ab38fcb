"""Walls that neighbours share."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from eaves.model import BuildingModel, Footprint, RoofPlane
from eaves.reconstruct import reconstruct_building
from eaves.reconstruct.prism import Prism
from eaves.run.party_wall_areas import party_wall_area


def block(west: float, south: float, east: float, north: float, height: float) -> BuildingModel:
    """A block on the ground at 0, its footprint counted from an origin of its own."""
    origin = (240.0 * round(west), 0.0)
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(0, east - west, 400), rng.uniform(0, north - south, 400)])
    points = np.column_stack([points + [west - origin[0], south], np.full(400, height)])
    polygon = shapely.box(west - origin[0], south, east - origin[0], north)
    plane = RoofPlane((0.0, 0.0, height), np.arange(400), 0.0)
    model = reconstruct_building(points, Footprint(polygon, origin), [plane], 0.0, Prism())
    assert isinstance(model, BuildingModel)
    return model


def test_the_lower_of_two_walls_is_shared() -> None:
    low, high = block(0, 0, 10, 6, 5.0), block(10, 0, 16, 8, 9.0)
    assert party_wall_area(low, [high]) == pytest.approx(6 * 5.0, abs=0.01)
    assert party_wall_area(high, [low]) == pytest.approx(6 * 5.0, abs=0.01)


def test_a_gap_of_less_than_a_wall_is_none_and_an_alley_is_one() -> None:
    house = block(0, 0, 10, 6, 5.0)
    assert party_wall_area(house, [block(10.2, 0, 16, 6, 5.0)]) == pytest.approx(30.0, abs=0.01)
    assert party_wall_area(house, [block(10.6, 0, 16, 6, 5.0)]) == 0.0


def test_two_neighbours_at_one_wall_are_added_and_counted_once() -> None:
    house = block(0, 0, 10, 6, 5.0)
    pair = [block(10, 0, 16, 3, 5.0), block(10, 3, 16, 6, 5.0)]
    assert party_wall_area(house, pair) == pytest.approx(30.0, abs=0.01)
    assert party_wall_area(house, [*pair, *pair]) == pytest.approx(30.0, abs=0.01)


def test_a_house_alone_shares_nothing() -> None:
    assert party_wall_area(block(0, 0, 10, 6, 5.0), []) == 0.0
