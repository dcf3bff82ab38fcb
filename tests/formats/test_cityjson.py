"""Models written as CityJSON and CityJSONSeq are read back as they were, by this package and by cjio."""

from __future__ import annotations

import json
import re
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from shapely import Polygon, box
from tests.formats.cityjson_schema import schema_defects

from eaves.exports.citygml import xml_name
from eaves.formats import InputError, read_cityjson, write_cityjson, write_cityjson_seq
from eaves.formats.crs import parse_crs, system_of
from eaves.formats.models.cityjson import SURFACES, WKT_MEMBER
from eaves.model import BuildingModel, CoordinateSystem, Face, Failure, Footprint, Solid
from eaves.model.building import GROUND_SURFACE, ROOF_SURFACE, WALL_SURFACE
from eaves.model.coordinates import LOCAL_METRES
from eaves.simulate.objects.houses import ExactScene
from eaves.validate import validate_file

ORIGIN = (84960.0, 447120.0)
MILLIMETRE = 0.001
SYSTEMS = {
    "local": LOCAL_METRES,
    "metres": system_of(parse_crs("EPSG:28992"), "test", ORIGIN),
    "compound": system_of(parse_crs("28992+5709"), "test", ORIGIN),
    "feet": system_of(parse_crs("EPSG:2994"), "test", ORIGIN),
    "survey feet": system_of(parse_crs("EPSG:2272"), "test", ORIGIN),
    "feet and metres": system_of(parse_crs("2994+5703"), "test", ORIGIN),
    "feet below metres": system_of(parse_crs("EPSG:26910"), "test", ORIGIN, 0.3048),
}
WRITERS = {"a.city.json": write_cityjson, "a.city.jsonl": write_cityjson_seq}


def gabled(west: float = 0.0) -> Solid:
    """A house of 8 by 6.123 m with two roof planes."""
    x = np.array([0, 8, 8, 0, 0, 8, 8, 0, 0, 8]) + west
    y = np.array([0, 0, 6.123, 6.123, 0, 0, 6.123, 6.123, 3, 3])
    z = np.array([-1.5, -1.5, -1.5, -1.5, 4, 4, 4, 4, 6.789, 6.789])
    walls = [((0, 1, 5, 4),), ((1, 2, 6, 9, 5),), ((2, 3, 7, 6),), ((3, 0, 4, 8, 7),)]
    faces = [Face(((3, 2, 1, 0),), GROUND_SURFACE), *(Face(ring, WALL_SURFACE) for ring in walls)]
    faces += [Face(((4, 5, 9, 8),), ROOF_SURFACE, 0), Face(((8, 9, 6, 7),), ROOF_SURFACE, 1)]
    return Solid.of(np.column_stack([x, y, z]), tuple(faces))


def house(name: str, parts: int = 1) -> BuildingModel:
    polygon = Polygon([(0, 0), (20, 0), (20, 6.123), (0, 6.123)], [[(9, 1), (9, 2), (10, 2), (10, 1)]])
    attributes: dict[str, Any] = {"h_ground": np.float64(-1.5), "floors": 2, "noise": float("nan")}
    attributes[SURFACES] = ({"slope": 42.5}, {"slope": np.float32(12.5)})
    solids = {
        "1.2": (gabled(),),
        "2.2": tuple(gabled(12.0 * part) for part in range(parts)),
    }
    return BuildingModel(Footprint(polygon, ORIGIN, name, 0.75), solids, (), attributes)


def documents(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def check_structure(document: dict[str, Any]) -> None:
    """What CityJSON 2.0 asks of objects and geometries."""
    vertices, objects = document["vertices"], document["CityObjects"]
    assert all(len(vertex) == 3 and all(type(step) is int for step in vertex) for vertex in vertices)
    assert len(set(map(tuple, vertices))) == len(vertices)
    used = set()
    for name, found in objects.items():
        assert found["type"] in ("Building", "BuildingPart")
        assert all(name in objects[child]["parents"] for child in found.get("children", []))
        assert all(name in objects[parent]["children"] for parent in found.get("parents", []))
        assert ("parents" in found) == (found["type"] == "BuildingPart")
        for geometry in found["geometry"]:
            shell = geometry["boundaries"]
            if geometry["type"] == "Solid":
                (shell,) = geometry["boundaries"]
                (values,) = geometry["semantics"]["values"]
                assert len(values) == len(shell)
                assert set(values) == set(range(len(geometry["semantics"]["surfaces"])))
            used |= {vertex for surface in shell for ring in surface for vertex in ring}
    assert used == set(range(len(vertices)))


@pytest.mark.parametrize("system", SYSTEMS.values(), ids=SYSTEMS)
@pytest.mark.parametrize("name", WRITERS)
def test_solids_come_back_to_a_millimetre(tmp_path: Path, name: str, system: CoordinateSystem) -> None:
    path = tmp_path / name
    assert WRITERS[name](path, iter([house("a"), house("b", 2)]), system, "Town") == 2
    for document in documents(path):
        check_structure(document)
    objects = read_cityjson(path)
    assert list(objects) == ["a", "b", "b-1", "b-2"]
    assert objects["a"].system.unit_m == pytest.approx(system.unit_m, rel=1e-12)
    assert objects["a"].system.code == system.code
    wanted = {"a": gabled(), "b-1": gabled(), "b-2": gabled(12.0)}
    for identifier, solid in wanted.items():
        (geometry,) = objects[identifier].lod("2.2")
        (found,) = objects[identifier].as_solids(geometry, ORIGIN)
        assert [face.surface for face in found.faces] == [face.surface for face in solid.faces]
        for mine, theirs in zip(found.faces, solid.faces, strict=True):
            apart = found.vertices[list(mine.rings[0])] - solid.vertices[list(theirs.rings[0])]
            assert np.abs(apart).max() <= MILLIMETRE
        slopes = [
            geometry.surfaces[face.plane].get("slope") for face in found.faces if face.plane is not None
        ]
        assert slopes[-2:] == [42.5, 12.5]


@pytest.mark.parametrize("name", WRITERS)
def test_a_building_and_its_parts_are_a_family(tmp_path: Path, name: str) -> None:
    WRITERS[name](tmp_path / name, [house("b", 2)])
    objects = read_cityjson(tmp_path / name)
    assert objects["b"].children == ("b-1", "b-2") and objects["b-2"].parents == ("b",)
    assert [geometry.lod for geometry in objects["b"].geometries] == ["0", "1.2"]
    assert objects["b"].attributes == {"score": 0.75, "h_ground": -1.5, "floors": 2, "noise": None}
    (flat,) = objects["b"].lod("0")
    (face,) = flat.faces
    assert not flat.is_solid and [len(ring) for ring in face.rings] == [4, 4]
    assert np.allclose(objects["b"].vertices[list(face.rings[0]), 2], -1.5)


@pytest.mark.parametrize("name", WRITERS)
def test_a_failure_keeps_its_footprint_and_reason(tmp_path: Path, name: str) -> None:
    place = Footprint(Polygon([(0, 0), (4, 0), (4, 4)]), ORIGIN, "c", attributes={"h_ground": 3.25})
    lost = Failure("no_plane", "no plane has 3 points", "roof", place)
    assert WRITERS[name](tmp_path / name, [lost, Failure("empty", "nothing there")]) == 1
    objects = read_cityjson(tmp_path / name)
    assert [geometry.lod for geometry in objects["c"].geometries] == ["0"]
    assert objects["c"].attributes["failure_code"] == "no_plane"
    assert objects["c"].attributes["failure_reason"] == "no plane has 3 points"
    assert np.allclose(objects["c"].vertices[:, 2], 3.25)


@pytest.mark.parametrize("name", WRITERS)
def test_the_reference_system_is_named_only_with_a_code(tmp_path: Path, name: str) -> None:
    def metadata(system: CoordinateSystem) -> dict[str, Any]:
        WRITERS[name](tmp_path / name, [house("a")], system)
        found: dict[str, Any] = documents(tmp_path / name)[0].get("metadata", {})
        return {key: value for key, value in found.items() if key != "geographicalExtent"}

    assert metadata(LOCAL_METRES) == {}
    base = "https://www.opengis.net/def/crs/EPSG/0/"
    assert metadata(SYSTEMS["metres"]) == {"referenceSystem": base + "28992"}
    assert metadata(SYSTEMS["compound"]) == {"referenceSystem": base + "7415"}
    assert WKT_MEMBER in metadata(SYSTEMS["feet and metres"])
    uncoded = CoordinateSystem(SYSTEMS["metres"].wkt)
    assert set(metadata(uncoded)) == {WKT_MEMBER}


def test_steps_in_feet_are_at_most_a_millimetre(tmp_path: Path) -> None:
    write_cityjson(tmp_path / "a.city.json", [house("a")], SYSTEMS["feet"])
    (city,) = documents(tmp_path / "a.city.json")
    assert city["transform"]["scale"] == [0.001, 0.001, 0.001]
    east = city["vertices"][0][0] * 0.001 + city["transform"]["translate"][0]
    assert east * 0.3048 == pytest.approx(ORIGIN[0], abs=MILLIMETRE)


def test_cjio_reads_both(tmp_path: Path, cjio: ModuleType) -> None:
    town = [house("a"), house("b", 2)]
    write_cityjson(tmp_path / "a.city.json", town, SYSTEMS["metres"])
    write_cityjson_seq(tmp_path / "a.city.jsonl", town, SYSTEMS["metres"])
    with (tmp_path / "a.city.json").open(encoding="utf-8") as file:
        whole = cjio.CityJSON(file=file)
    head, *features = documents(tmp_path / "a.city.jsonl")
    joined = cjio.CityJSON(j=head)
    for feature in features:
        joined.add_cityjsonfeature(feature)
    for city in (whole, joined):
        assert city.get_version() == "2.0" and city.get_epsg() == 28992
        assert sorted(city.j["CityObjects"]) == ["a", "b", "b-1", "b-2"]
        box = city.calculate_bbox()
        assert np.allclose(box, [*ORIGIN, -1.5, ORIGIN[0] + 20, ORIGIN[1] + 6.123, 6.789], atol=MILLIMETRE)
        assert city.number_city_objects_level1() == 2
    count = len(whole.j["vertices"])
    whole.remove_orphan_vertices()
    whole.remove_duplicate_vertices()
    assert len(whole.j["vertices"]) == count


@pytest.mark.parametrize("name", WRITERS)
def test_no_building_is_a_file_without_buildings(tmp_path: Path, name: str) -> None:
    assert WRITERS[name](tmp_path / name, [], SYSTEMS["metres"]) == 0
    assert read_cityjson(tmp_path / name) == {}


@pytest.mark.parametrize(("place", "value"), [("scale", 1e300), ("translate", 1e18)])
def test_vertices_out_of_this_world_are_refused(tmp_path: Path, place: str, value: float) -> None:
    path = tmp_path / "a.city.json"
    write_cityjson(path, [house("a")])
    document = json.loads(path.read_text())
    document["transform"][place][0] = value
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match="out of this world"):
        read_cityjson(path)


def test_a_part_gives_way_to_a_building_of_its_id(tmp_path: Path) -> None:
    square = box(0, 0, 4, 4)
    parts = [gabled(), gabled(20.0)]
    for order in (1, -1):
        models = [
            BuildingModel(Footprint(square, id="h"), {"2.2": parts}),
            BuildingModel(Footprint(square, id="h-1"), {"2.2": [gabled(40.0)]}),
        ][::order]
        path = tmp_path / f"two{order}.city.json"
        assert write_cityjson(path, models) == 2
        objects = json.loads(path.read_text())["CityObjects"]
        assert {name: one["type"] for name, one in objects.items()} == {
            "h": "Building",
            "h-1": "Building",
            "h-1~2": "BuildingPart",
            "h-2": "BuildingPart",
        }
        assert sorted(objects["h"]["children"]) == ["h-1~2", "h-2"]
        assert not {finding.code for finding in validate_file(path)} - {601}
        assert schema_defects(path) == []


@pytest.mark.parametrize("pair", [("a b", "a_b"), ("1", "_1"), ("a/b", "a_x2f_b"), ("ä", "_xe4_")])
def test_two_ids_never_become_one_in_xml(pair: tuple[str, str]) -> None:
    first, second = map(xml_name, pair)
    assert first != second
    assert re.fullmatch(r"[A-Za-z_][\w.-]*", first, flags=re.ASCII)


def test_corners_of_a_footprint_a_millimetre_apart_are_written_as_one(tmp_path: Path) -> None:
    corners = [(0, 0), (5, 0), (5.001, 0.0004), (5, 5), (0, 5), (0.0005, 0.0009)]
    footprint = Footprint(Polygon(corners), id="h")
    write_cityjson(tmp_path / "a.city.json", [Failure("no_points", "none", "tiling", footprint)])
    assert not validate_file(tmp_path / "a.city.json")
    assert schema_defects(tmp_path / "a.city.json") == []


def test_files_are_as_the_schema_of_the_standard_says(tmp_path: Path, nine_roofs: ExactScene) -> None:
    """Of buildings with all that is written of them, and one without a model; and a break of it is seen."""
    models = [house("a", 2), *(building.model() for building in nine_roofs.buildings)]
    failure = Failure("no_points", "none", "tiling", house("b").footprint)
    for name, write in WRITERS.items():
        write(tmp_path / name, [*models, failure], SYSTEMS["compound"])
        assert schema_defects(tmp_path / name) == []
        text = (tmp_path / name).read_text(encoding="utf-8")
        for old, new in (('"lod":"2.2"', '"lod":2.2'), ('"RoofSurface"', '"Attic"'), ('"2.0"', '"2.1"')):
            assert old in text
            (tmp_path / "wrong.json").write_text(text.replace(old, new), encoding="utf-8")
            assert schema_defects(tmp_path / "wrong.json") != []
