"""Walls that neighbours share."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from eaves.figures.party_walls import Walls, envelope_figures, shared_areas, wall_figures
from eaves.model import BuildingModel, Footprint, RoofPlane
from eaves.reconstruct import reconstruct_building
from eaves.reconstruct.prism import Prism


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


def party_wall_area(model: BuildingModel, neighbours: list[BuildingModel]) -> float:
    return float(shared_areas(Walls.of(model), [Walls.of(neighbour) for neighbour in neighbours]).sum())


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


def test_free_walls_are_known_by_the_way_they_look() -> None:
    """A house of 10 × 6 × 5 m; one of 8 m depth and 9 m height stands at its east wall."""
    low, high = (Walls.of(one) for one in (block(0, 0, 10, 6, 5.0), block(10, 0, 16, 8, 9.0)))
    mine, theirs = wall_figures(low, [high]), wall_figures(high, [low])
    free = {"n": 50.0, "e": 0.0, "s": 50.0, "w": 30.0}
    assert {side: mine[f"free_wall_{side}_m2"] for side in free} == pytest.approx(free, abs=0.01)
    free = {"n": 54.0, "e": 72.0, "s": 54.0, "w": 72.0 - 30.0}
    assert {side: theirs[f"free_wall_{side}_m2"] for side in free} == pytest.approx(free, abs=0.01)
    assert mine["party_wall_area_m2"] == theirs["party_wall_area_m2"] == pytest.approx(30.0, abs=0.01)
    assert mine["free_wall_area_m2"] == pytest.approx(130.0, abs=0.01)


def test_floors_and_envelope_are_those_of_the_box__storeys_of_the_map_go_first() -> None:
    walls = wall_figures(Walls.of(block(0, 0, 10, 6, 5.0)), [])
    known = {"storeysAboveGround": 2, "floor_area_m2": 120.0, "roof_area_m2": 60.0, "volume_m3": 300.0}
    figures = envelope_figures(walls, known, 60.0)
    assert (figures["floor_area_m2"], figures["envelope_m2"]) == (120.0, 280.0)
    assert figures["envelope_per_volume"] == pytest.approx(280.0 / 300.0, abs=1e-3)
    assert envelope_figures(walls, known, 60.0, 3)["floor_area_m2"] == 180.0
    assert "floor_area_m2" not in envelope_figures(walls, {}, 60.0)
