from __future__ import annotations

import numpy as np
import shapely
from shapely import Polygon, box

from eaves.buildings.gather import BuildingPlan, OwnedBuildings, with_addresses
from eaves.footprints.addresses import divide_buildings
from eaves.methods import Emit, ignore
from eaves.model import Block, Failure, Footprint, Points, Raster, Values
from eaves.model.results import BuildingPoints
from eaves.units import Division, UnitMethod

OWNER = Block(0, 0, 240.0)


def building_of(width: float) -> BuildingPoints:
    """A flat roof over 10 m of street, so many metres wide, a point every metre."""
    x, y = np.meshgrid(np.arange(0.5, width), np.arange(0.5, 10))
    xyz = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 6.0)])
    terrain = Raster(np.zeros((40, 80), np.float32), -5.0, 15.0, 0.5)
    part = np.zeros(len(xyz), np.uint8)
    return BuildingPoints(OWNER, xyz, np.arange(len(xyz)), part, terrain, 1.0, 0.7)


def test_a_detected_block_becomes_its_addresses_with_their_points() -> None:
    addresses = [
        Footprint(box(0.3, 0.3, 8, 9.7), id="a", attributes={"street": "Oude Delft"}),
        Footprint(box(8, 0.3, 19.7, 9.7), id="b"),
        Footprint(box(200, 200, 210, 210), id="far"),
    ]
    owned = OwnedBuildings(OWNER, (BuildingPlan(((OWNER, 1),)),))
    (plan,) = with_addresses([owned], addresses)
    assert len(plan.addresses) == 3
    block = Footprint(box(0, 0, 30, 10))
    parts, outlines = divide_buildings([building_of(30)], [block], "off", plan.addresses)
    assert [one.id for one in outlines if isinstance(one, Footprint)] == ["a", "b", ""]
    assert [len(one.xyz) for one in parts] == [80, 120, 100]
    assert all(one.score == 0.7 for one in parts)
    polygons = [one.polygon for one in outlines if isinstance(one, Footprint)]
    assert shapely.union_all(polygons).symmetric_difference(block.polygon).area < 1e-6
    assert abs(sum(polygon.area for polygon in polygons) - 300.0) < 1e-6


def test_a_block_without_addresses_and_one_without_outline_stay_as_they_are() -> None:
    buildings = [building_of(30), building_of(20)]
    drawn: list[Footprint | Failure] = [Failure("no_area", "none", "outline"), Footprint(box(0, 0, 20, 10))]
    parts, outlines = divide_buildings(buildings, drawn, "off", [Footprint(box(50, 50, 60, 60), id="a")])
    assert parts == buildings and outlines == drawn


def test_an_address_whose_inner_point_lies_elsewhere_gives_no_id_twice() -> None:
    address = Footprint(box(0, 0, 40, 10), id="a", attributes={"street": "x"})
    _, outlines = divide_buildings([building_of(10)], [Footprint(box(0, 0, 10, 10))], "off", [address])
    (only,) = outlines
    assert isinstance(only, Footprint) and only.id == "" and only.attributes == {"street": "x"}


class Breaks(UnitMethod):
    """Fails in each block wider than 20 m."""

    name = "breaks"

    def divide(
        self, points: Points, height: Values, outline: Polygon, spacing: float, emit: Emit = ignore
    ) -> Division:
        if outline.bounds[2] > 20.0:
            raise ZeroDivisionError("by nought")
        return Division((box(0, 0, 8, 10), box(8, 0, 20, 10)), (0.9, 0.9), ((0, 1, 0.9),))


def test_a_block_whose_division_fails_is_one_building_of_unsure_walls__the_others_are_divided() -> None:
    buildings = [building_of(30), building_of(20)]
    drawn: list[Footprint | Failure] = [Footprint(box(0, 0, 30, 10)), Footprint(box(0, 0, 20, 10))]
    parts, outlines = divide_buildings(buildings, drawn, Breaks())
    assert outlines[0] is drawn[0] and len(outlines) == 3
    assert [one.wall_certainty for one in parts] == [0.0, 0.9, 0.9]
