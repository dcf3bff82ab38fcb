"""Maps of several layers, polygons that a map holds twice, ids as tables keep them, systems nobody states."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import geopandas
import numpy as np
import pyogrio
import pytest
import shapely
from shapely import Polygon, affinity, box

from eaves.footprints.read import (
    polygon_layer,
    read_footprints,
    recognise_map,
    repair_footprints,
    without_doubled,
)
from eaves.formats import InputError
from eaves.formats.crs import parse_crs, system_of
from eaves.model import CoordinateSystem

HOUSES = [box(85010, 447010, 85020, 447018), box(85030, 447010, 85042, 447018)]
DUTCH = system_of(parse_crs("EPSG:28992"), "map", (85000.0, 447000.0))
AREA = box(85000, 447000, 85060, 447040)


def write_layers(path: Path, *names: str, epsg: int | None = 28992, **columns: Sequence[object]) -> Path:
    """A file with the houses in a layer of each name."""
    for name in names:
        table = geopandas.GeoDataFrame(columns or {"n": [1, 2]}, geometry=HOUSES, crs=epsg)
        table.to_file(path, layer=name, engine="pyogrio")
    return path


@pytest.mark.parametrize(
    ("names", "chosen"),
    [
        (("parcels", "buildings"), "buildings"),
        (("cadastral parcels", "Building footprints"), "Building footprints"),
        (("perceel", "bag_pand", "wegdeel"), "bag_pand"),
        (("Flurstücke", "Gebäude"), "Gebäude"),
        (("parcelle", "bâtiment"), "bâtiment"),
        (("parcelas", "edificios"), "edificios"),
        (("dzialki", "budynki"), "budynki"),
        (("mark", "byggnader"), "byggnader"),
        (("alone",), None),
    ],
)
def test_of_several_layers_the_one_that_is_named_as_buildings_is_read(
    names: tuple[str, ...], chosen: str | None, tmp_path: Path
) -> None:
    assert polygon_layer(write_layers(tmp_path / "map.gpkg", *names), None) == chosen


@pytest.mark.parametrize("names", [("a", "b"), ("buildings_2009", "buildings_2024")])
def test_layers_that_leave_a_choice_are_refused_with_their_names(
    names: tuple[str, str], tmp_path: Path
) -> None:
    path = write_layers(tmp_path / "map.gpkg", *names)
    with pytest.raises(InputError, match=rf"'{names[0]}', '{names[1]}'; choose one with --layer NAME"):
        polygon_layer(path, None)
    assert polygon_layer(path, names[1]) == names[1]
    with pytest.raises(InputError, match=f"no layer 'c'; choose one of: {names[0]}, {names[1]}"):
        read_footprints(path, None, CoordinateSystem(), AREA, layer="c")


def test_an_empty_layer_of_buildings_is_no_choice(tmp_path: Path) -> None:
    empty = geopandas.GeoDataFrame({"n": []}, geometry=[], crs=28992)
    empty.to_file(tmp_path / "map.gpkg", layer="buildings", engine="pyogrio", geometry_type="Polygon")
    assert polygon_layer(write_layers(tmp_path / "map.gpkg", "survey"), None) == "survey"


def test_two_layers_of_a_known_map_are_refused__one_is_taken_by_its_name(tmp_path: Path) -> None:
    columns = {"build_id": ["1", "2"], "occ_cls": ["a", "b"]}
    path = write_layers(tmp_path / "map.gpkg", "old", "new", **columns)
    with pytest.raises(InputError, match="'old', 'new'; choose one with --layer"):
        recognise_map(path)
    known = recognise_map(path, layer="new")
    assert known is not None and known.layer.name == "new"


@pytest.mark.parametrize(
    "twin", [HOUSES[0], Polygon(np.roll(HOUSES[0].exterior.coords[:-1], 2, axis=0)[::-1])]
)
def test_a_polygon_twice_is_modelled_once(twin: Polygon) -> None:
    given = repair_footprints([*HOUSES, twin], ["a", "b", "c"])
    apart, doubled = without_doubled(given)
    assert [footprint.id for footprint in apart] == ["a", "b"]
    assert [(one.code, one.footprint.id, "'a'" in one.reason) for one in doubled] == [("doubled", "c", True)]


@pytest.mark.parametrize(
    ("x", "kept"), [(4.9, ["a"]), (5.1, ["a", "b"]), (10.0, ["a", "b"])], ids=["half", "less", "touching"]
)
def test_a_polygon_that_lies_by_half_in_another_is_left_out(x: float, kept: list[str]) -> None:
    given = repair_footprints([HOUSES[0], affinity.translate(HOUSES[0], x, 0)], ["a", "b"])
    assert [footprint.id for footprint in without_doubled(given)[0]] == kept


def test_of_two_one_inside_the_other_the_larger_is_kept__in_any_order() -> None:
    shapes = [affinity.scale(HOUSES[1], 0.5, 0.5), HOUSES[1], affinity.scale(HOUSES[1], 0.3, 0.3)]
    apart, doubled = without_doubled(repair_footprints(shapes, ["a", "b", "c"]))
    assert [footprint.id for footprint in apart] == ["b"]
    assert [one.footprint.id for one in doubled] == ["a", "c"]


@pytest.mark.parametrize("id_field", ["key", None])
def test_ids_of_a_column_of_floats_have_no_point(id_field: str | None, tmp_path: Path) -> None:
    name = id_field or "pand_id"
    path = write_layers(tmp_path / "map.gpkg", "b", **{name: [503100000018603.0, 503100000018604.0]})
    found, _ = read_footprints(path, id_field, CoordinateSystem(), AREA)
    assert [footprint.id for footprint in found] == ["503100000018603", "503100000018604"]


def geojson(path: Path, shapes: Sequence[Polygon], **members: object) -> Path:
    """GeoJSON of these shapes."""
    features = [
        {"type": "Feature", "properties": {}, "geometry": json.loads(shapely.to_geojson(shape))}
        for shape in shapes
    ]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features, **members}))
    return path


def test_plane_geojson_without_a_system_is_in_that_of_the_points(tmp_path: Path) -> None:
    path = geojson(tmp_path / "map.geojson", HOUSES)
    found, lost = read_footprints(path, None, DUTCH, AREA, may_miss=False)
    assert [footprint.polygon.area for footprint in found] == [80.0, 96.0] and not lost


def test_plane_geojson_beside_the_points_is_refused_with_what_places_it(tmp_path: Path) -> None:
    path = geojson(tmp_path / "a map.geojson", [affinity.translate(house, 5e5, 5e6) for house in HOUSES])
    command = rf"ogr2ogr -a_srs EPSG:CODE 'a map_placed.geojson' '{path}'"
    with pytest.raises(InputError, match=f"no coordinate system, and no polygon meets.*{command}"):
        read_footprints(path, None, DUTCH, AREA, may_miss=False)


def test_numbers_that_are_not_of_the_stated_system_are_refused(tmp_path: Path) -> None:
    member = {"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}}
    path = geojson(tmp_path / "map.geojson", HOUSES, crs=member)
    with pytest.raises(InputError, match=r"states WGS 84.*cannot be of that system; .*ogr2ogr -a_srs"):
        read_footprints(path, None, DUTCH, AREA)


@pytest.mark.parametrize("spatialite", ["YES", "NO"])
def test_spatialite_is_read(spatialite: str, tmp_path: Path) -> None:
    table = geopandas.GeoDataFrame({"n": [1, 2]}, geometry=HOUSES, crs=28992)
    path = tmp_path / "map.sqlite"
    pyogrio.write_dataframe(table, path, driver="SQLite", layer="houses", SPATIALITE=spatialite)
    found, _ = read_footprints(path, None, DUTCH, AREA)
    assert [footprint.polygon.area for footprint in found] == pytest.approx([80.0, 96.0])
