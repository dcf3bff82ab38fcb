"""Towns are buildable: every model closes, nothing stands in anything else, the same seed gives the same
town.
"""

from __future__ import annotations

import logging
from itertools import combinations

import numpy as np
import pytest
import shapely
from tests.conftest import but_first

from eaves.model import Bounds
from eaves.simulate import scan_town, simulate_epochs, simulate_town
from eaves.simulate.objects.houses import (
    draw_church,
    draw_detached,
    draw_garden_shed,
    draw_hall,
    draw_perimeter,
    draw_row,
    draw_slab,
    draw_tower,
    draw_town_house,
    make_building,
    shifted_masses,
)
from eaves.simulate.objects.surfaces import Corridor, cut_corridor, make_terrain
from eaves.simulate.town import Town
from eaves.validate import validate_model


@pytest.fixture(scope="module")
def town() -> Town:
    return simulate_town(0.04, terrain="hilly", seed=3)


def test_buildings_stand_apart_or_share_a_party_wall(town: Town) -> None:
    for one, other in combinations(town.buildings, 2):
        assert shapely.intersection(one.footprint, other.footprint).area < 0.06


def test_walls_stand_under_the_eaves(town: Town) -> None:
    for building in town.buildings:
        assert shapely.buffer(building.footprint, 1e-6).contains(building.walls)


def test_no_roof_goes_under_the_ground(town: Town) -> None:
    for building in town.buildings:
        for face in building.faces:
            corners = shapely.get_coordinates(face.polygon)
            assert (face.height_at(corners) > town.terrain.at(corners)).all()


def test_faces_are_numbered_once_in_the_whole_town(town: Town) -> None:
    numbers = [face.number for building in town.buildings for face in building.faces]
    assert numbers == list(range(1, len(numbers) + 1)) and set(numbers) == set(town.roof_planes)


@pytest.mark.parametrize("style", but_first(["mixed", "suburb", "centre", "village"]))
def test_every_reference_model_is_valid(style: str) -> None:
    town = simulate_town(0.0225, style=style, terrain="terraced", seed=7)  # type: ignore[arg-type]
    assert town.buildings
    for building in town.buildings:
        assert validate_model(building.model()) == []


@pytest.mark.parametrize("seed", range(3))
def test_every_kind_of_building_makes_a_closed_solid(seed: int) -> None:
    rng = np.random.default_rng(seed)
    designs = [draw_detached(rng) for _ in range(12)]
    designs += [
        draw_garden_shed(rng),
        draw_row(60.0, rng),
        draw_town_house(9.0, 12.0, rng),
        draw_slab(70.0, rng),
    ]
    designs += [
        draw_perimeter(70.0, 45.0, rng),
        draw_tower(rng),
        draw_hall(50.0, 30.0, rng),
        draw_church(rng),
    ]
    closed = 0
    for design in designs:
        masses = shifted_masses(design.masses, 40.0, 40.0, angle=0.3)
        try:
            building = make_building(masses, 1, 1, design.kind, -1.0, design.overhang)
            assert validate_model(building.model()) == []
            closed += 1
        except ValueError as reason:
            assert "narrower" in str(reason)
    assert closed >= len(designs) - 1


def test_same_seed_gives_the_same_town() -> None:
    one, two = simulate_town(0.0225, seed=5), simulate_town(0.0225, seed=5)
    assert [b.footprint.wkb for b in one.buildings] == [b.footprint.wkb for b in two.buildings]
    assert np.array_equal(one.furniture.corners, two.furniture.corners)
    assert np.array_equal(one.foliage.bodies, two.foliage.bodies)
    assert np.array_equal(one.terrain.heights, two.terrain.heights)


def test_no_more_buildings_than_asked_for() -> None:
    assert len(simulate_town(0.04, buildings=5, seed=1).buildings) == 5


def test_too_many_buildings_give_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING, logger="eaves"):
        simulate_town(0.01, buildings=500, seed=1)
    assert "of 500 buildings fit" in caplog.text


def test_too_small_an_area_is_refused() -> None:
    with pytest.raises(ValueError, match=r"area_km2 must be at least 0\.01"):
        simulate_town(0.001)


def test_town_without_trees_has_no_leaves() -> None:
    assert len(simulate_town(0.0225, trees=0.0, seed=2).foliage.shape) == 0


def test_terrain_between_nodes_is_the_two_triangles() -> None:
    terrain = make_terrain("slope", Bounds(0, 0, 20, 20), np.random.default_rng(0))
    nodes = terrain.nodes()[3:6, 3:6].reshape(-1, 2)
    assert np.allclose(terrain.at(nodes), terrain.heights[3:6, 3:6].reshape(-1))
    corner = terrain.nodes()[4, 4]
    middle = corner + [0.5, 0.5]
    assert terrain.at(middle[None])[0] == pytest.approx((terrain.heights[4, 4] + terrain.heights[5, 5]) / 2)


def test_canal_is_dug_and_embankment_raised() -> None:
    terrain = make_terrain("flat", Bounds(0, 0, 60, 60), np.random.default_rng(0))
    axis = np.array([[30.0, 30.0]])
    dug = cut_corridor(terrain, Corridor(30.0, 30.0, 0.2, 5.0, -1.5))
    raised = cut_corridor(terrain, Corridor(30.0, 30.0, 0.2, 5.0, 3.0))
    assert dug.at(axis)[0] < terrain.at(axis)[0] - 1.0 and dug.water.any()
    assert raised.at(axis)[0] == pytest.approx(terrain.at(axis)[0] + 3.0) and not raised.water.any()


@pytest.mark.slow
def test_more_trees_than_usual_make_a_wooded_town() -> None:
    few, many = (simulate_town(0.02, terrain="flat", trees=trees, seed=3) for trees in (1.0, 3.0))
    usual, wooded = (scan_town(town, 1.0, seed=3).truth_class for town in (few, many))
    assert (wooded == 5).mean() > 1.5 * (usual == 5).mean()


def test_an_annex_on_a_hill_stands_over_the_ground_beside_it() -> None:
    epochs = simulate_epochs(0.02, "hilly", seed=4, changed=1.0)
    town = epochs.new
    built = [one for one in epochs.changes if one.change == "extended"]
    assert built
    for one in built:
        assert one.old is not None and one.new is not None
        house = next(b for b in town.buildings if b.footprint.equals(one.new))
        annex = shapely.difference(one.new, one.old).representative_point()
        roof = next(face for face in house.faces if face.polygon.contains(annex))
        place = np.array([[annex.x, annex.y]])
        assert roof.height_at(place)[0] - town.terrain.at(place)[0] > 1.9
