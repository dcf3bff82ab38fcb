"""CityGML, layers by level, roof planes and GeoJSON: opened by others, as exact as put in."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from xml.etree import ElementTree

import numpy as np
import pyogrio
import pytest
import shapely
from benchmarks.wireframes.drawing import roof_wireframe
from shapely import Polygon

from eaves.exports import write_citygml, write_dxf, write_lod_layers
from eaves.exports.citygml import CITYGML_2, CITYGML_3, Version
from eaves.formats import read_cityjson, write_cityjson, write_cityjson_seq, write_geoparquet
from eaves.formats.crs import parse_crs, system_of
from eaves.formats.vectors.geopackage import Row, write_polygons
from eaves.model import BuildingModel, CoordinateSystem, Failure, Footprint
from eaves.model.building import Installation
from eaves.simulate import nine_roofs_on_a_slope
from eaves.simulate.objects.exact import extrude_partition
from eaves.validate import validate_file
from tests.judges import need_judge

DUTCH = system_of(parse_crs("28992+5709"), "test", (0.0, 0.0))
FEET = system_of(parse_crs("EPSG:2994"), "test", (0.0, 0.0))
PLACE = (85000.0, 447000.0)
ROOF = Polygon([(85000, 447000, 3), (85010, 447000, 3), (85010, 447003, 6), (85000, 447003, 6)])


@pytest.fixture(scope="module")
def town() -> list[BuildingModel | Failure]:
    """Nine houses with exact roofs, the first in two parts at LoD 2.2, and one without a model."""
    scene = nine_roofs_on_a_slope(density=4.0)
    models: list[BuildingModel | Failure] = []
    for building in scene.buildings:
        model = building.model((0.0, 0.0))
        models.append(model.with_(footprint=model.footprint.with_(origin=PLACE)))
    first = models[0]
    assert isinstance(first, BuildingModel)
    moved = tuple(replace(solid, vertices=solid.vertices + [30.0, 0, 0]) for solid in first.solids[first.lod])
    models[0] = first.with_(solids={**first.solids, first.lod: first.solids[first.lod] + moved})
    box = shapely.box(200, 0, 210, 10)
    print_ = Footprint(box, PLACE, "none & <no>", 0.5, {"floors": 3, "flat": True})
    return [*models, Failure("no_plane", "no plane", "roof", print_)]


@pytest.mark.parametrize("version", [CITYGML_2, CITYGML_3], ids=["2.0", "3.0"])
def test_citygml_has_every_building_and_refers_to_faces_it_has(
    tmp_path: Path, town: list[BuildingModel | Failure], version: Version
) -> None:
    path = tmp_path / "town.gml"
    assert write_citygml(path, town, DUTCH, version) == 10
    assert sorted(file.name for file in tmp_path.iterdir()) == ["town.gml"]
    root = ElementTree.parse(path).getroot()
    gml, bldg = (f"{{{version.spaces[name]}}}" for name in ("gml", "bldg"))
    assert len(root.findall(f".//{bldg}Building")) == 10 and len(root.findall(f".//{bldg}BuildingPart")) == 2
    names = [element.get(f"{gml}id") for element in root.iter() if element.get(f"{gml}id")]
    assert len(names) == len(set(names))
    link = "{http://www.w3.org/1999/xlink}href"
    references = [element.get(link, "")[1:] for element in root.iter() if element.get(link)]
    assert references and set(references) <= set(names)
    surfaces = f"{{{version.spaces[version.surface]}}}RoofSurface"
    rings = [
        np.array(list(map(float, (ring.text or "").split()))).reshape(-1, 3)
        for roof in root.iter(surfaces)
        for ring in roof.iter(f"{gml}posList")
    ]
    model = town[0]
    assert isinstance(model, BuildingModel)
    highest = max(solid.vertices[:, 2].max() for m in town[:9] for solid in m.solids[m.lod])  # type: ignore[union-attr]
    assert max(ring[:, 2].max() for ring in rings) == pytest.approx(highest, abs=1e-3)
    place = root.find(f".//{gml}Envelope")
    assert place is not None and place.get("srsName") == "https://www.opengis.net/def/crs/EPSG/0/7415"


@pytest.mark.parametrize("version", [CITYGML_2, CITYGML_3], ids=["2.0", "3.0"])
def test_citygml_has_what_stands_on_a_roof(tmp_path: Path, version: Version) -> None:
    house = nine_roofs_on_a_slope(density=4.0).buildings[0].model((0.0, 0.0))
    bodies = [
        extrude_partition([shapely.box(x, 2.0, x + 1.0, 3.0)], np.zeros(1, int), [(0.0, 0.0, 9.5)], 8.0)
        for x in (2.0, 5.0)
    ]
    chimneys = [
        Installation("chimney", shapely.box(x, 2.0, x + 1.0, 3.0), 9.5, 1.2, 20, body)
        for x, body in zip((2.0, 5.0), bodies, strict=True)
    ]
    write_citygml(tmp_path / "a.gml", [house.with_(installations=tuple(chimneys))], DUTCH, version)
    building = (
        ElementTree.parse(tmp_path / "a.gml").getroot().find(f".//{{{version.spaces['bldg']}}}Building")
    )
    assert building is not None
    gml, bldg = (f"{{{version.spaces[name]}}}" for name in ("gml", "bldg"))
    found = building.findall(f"{version.installation.replace('bldg:', bldg)}/{bldg}BuildingInstallation")
    assert [one.findtext(f"{bldg}function") for one in found] == ["chimney", "chimney"]
    for one, body in zip(found, bodies, strict=True):
        rings = [list(map(float, (ring.text or "").split())) for ring in one.iter(f"{gml}posList")]
        assert len(rings) == len(body.faces) == 6
        low = np.concatenate([np.reshape(ring, (-1, 3)) for ring in rings]).min(axis=0)
        np.testing.assert_allclose(low, body.vertices.min(axis=0) + [*house.footprint.origin, 0.0], atol=1e-4)


@pytest.mark.parametrize(("version", "modules"), [
    (CITYGML_2, {"core": "cityGMLBase", "bldg": "building", "gen": "generics"}),
    (CITYGML_3, {"core": "core", "bldg": "building", "con": "construction", "gen": "generics"}),
], ids=["2.0", "3.0"])  # fmt: skip
def test_citygml_is_valid_by_its_schema(
    tmp_path: Path, town: list[BuildingModel | Failure], version: Version, modules: dict[str, str]
) -> None:
    """EAVES_CITYGML_XSD names a folder that packaging/schemas.py filled, or that has all of 2.0 in one."""
    etree = pytest.importorskip("lxml.etree")
    folder = os.environ.get("EAVES_CITYGML_XSD")
    need_judge("schemas of CityGML", folder)
    places = {file: Path(folder or "", "citygml", version.name, f"{file}.xsd") for file in modules.values()}
    for file, place in places.items():
        apart = place.parents[1] / file / version.name / place.name
        places[file] = apart if apart.exists() else place
    imports = "".join(
        f'<xs:import namespace="{version.spaces[prefix]}" schemaLocation="{places[file]}"/>'
        for prefix, file in modules.items()
    )
    text = f'<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema">{imports}</xs:schema>'
    schema = etree.XMLSchema(etree.fromstring(text))
    write_citygml(tmp_path / "town.gml", town, DUTCH, version)
    assert schema.validate(etree.parse(str(tmp_path / "town.gml"))), schema.error_log


def test_lod_layers_hold_the_faces_of_their_level(
    tmp_path: Path, town: list[BuildingModel | Failure]
) -> None:
    path = tmp_path / "town.gpkg"
    assert write_lod_layers(path, iter(town), FEET) == 9
    layers = {name: kind for name, kind in pyogrio.list_layers(path) if kind}
    assert layers == {f"lod_{lod}": "MultiPolygon Z" for lod in ("1_2", "1_3", "2_0", "2_2", "2_3")}
    meta, _, wkb, columns = pyogrio.raw.read(path, layer="lod_2_2")
    rows = dict(zip(meta["fields"], columns, strict=True))
    roof = rows["surface"] == "RoofSurface"
    heights = shapely.get_coordinates(shapely.from_wkb(wkb[roof]), include_z=True)[:, 2] * 0.3048
    highest = max(solid.vertices[:, 2].max() for m in town[:9] for solid in m.solids[m.lod])  # type: ignore[union-attr]
    assert heights.max() == pytest.approx(highest) and set(rows["surface"]) == {
        "RoofSurface",
        "WallSurface",
        "GroundSurface",
    }
    ground = rows["surface"] == "GroundSurface"
    flat = shapely.area(shapely.from_wkb(wkb[ground])) * 0.3048**2
    assert np.allclose(flat, rows["area_m2"][ground], atol=0.01)


def test_geojson_is_in_longitude_and_latitude(tmp_path: Path) -> None:
    house = shapely.box(85000, 447000, 85010, 447006)
    write_polygons(tmp_path / "a.geojson", [Row(house, {"id": "a"})], DUTCH)
    document = json.loads((tmp_path / "a.geojson").read_text())
    assert "crs" not in document
    ring = document["features"][0]["geometry"]["coordinates"][0]
    assert np.allclose(ring[0][:2], [4.37, 52.01], atol=0.02)
    assert Polygon(ring).exterior.is_ccw
    from eaves.formats import read_polygons

    (back,), *_ = read_polygons(tmp_path / "a.geojson", target=DUTCH)
    assert back.symmetric_difference(house).area < 0.05


def test_geojson_without_a_place_says_so(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    write_polygons(tmp_path / "a.geojson", [Row(shapely.box(0, 0, 1, 1), {"id": "a"})])
    assert "not in WGS 84" in caplog.text


def test_roof_planes_keep_their_heights(tmp_path: Path) -> None:
    geopandas = pytest.importorskip("geopandas")
    rows = [Row(ROOF, {"building_id": "a"})]
    write_geoparquet(tmp_path / "r.parquet", rows, FEET)
    write_polygons(tmp_path / "r.fgb", rows, FEET, layer="roof_planes")
    for frame in (geopandas.read_parquet(tmp_path / "r.parquet"), geopandas.read_file(tmp_path / "r.fgb")):
        found = shapely.get_coordinates(frame.geometry[0], include_z=True) * 0.3048
        assert np.allclose(found, shapely.get_coordinates(ROOF, include_z=True))


def test_cjio_takes_the_file_and_knows_system_and_extent(
    tmp_path: Path, town: list[BuildingModel | Failure], cjio: ModuleType
) -> None:
    write_cityjson(tmp_path / "town.city.json", town, DUTCH, title="a town")
    write_cityjson_seq(tmp_path / "town.city.jsonl", town, DUTCH)
    program = Path(sys.executable).with_name("cjio")
    for words, file in (
        ([str(tmp_path / "town.city.json")], None),
        (["stdin"], tmp_path / "town.city.jsonl"),
    ):
        with file.open() if file else open(os.devnull) as given:
            done = subprocess.run(
                [program, *words, "info"], stdin=given, capture_output=True, text=True, timeout=60
            )
        assert done.returncode == 0, done.stderr
        assert "EPSG = 7415" in done.stdout and "Building (10)" in done.stdout
    extent = json.loads((tmp_path / "town.city.json").read_text())["metadata"]["geographicalExtent"]
    assert extent[0] == pytest.approx(PLACE[0], abs=300) and extent[2] < extent[5]


@pytest.mark.parametrize("system", [DUTCH, FEET], ids=["metres", "feet"])
def test_gdal_reads_the_edges_of_roofs_in_the_dxf(tmp_path: Path, system: CoordinateSystem) -> None:
    truth = nine_roofs_on_a_slope(density=1.0)
    models = [building.model(truth.cloud.origin) for building in truth.buildings]
    assert write_dxf(tmp_path / "roofs.dxf", [Failure("none", "no model"), *models], system) == 9
    _, _, shapes, fields = pyogrio.raw.read(tmp_path / "roofs.dxf", columns=["Layer", "Text"])
    lines = shapely.from_wkb(shapes)
    layers, texts = fields
    assert sorted(texts[layers == "BUILDING_IDS"]) == sorted(model.footprint.id for model in models)
    unit = system.unit_m[0]
    found = np.sort(shapely.get_coordinates(lines[layers == "ROOF_EDGES"], include_z=True) * unit, axis=0)
    wanted = []
    for model in models:
        corners, edges = roof_wireframe(model, 1e-6)
        wanted.append((corners + [*model.footprint.origin, 0.0])[edges].reshape(-1, 3))
    assert np.allclose(found, np.sort(np.concatenate(wanted), axis=0), atol=0.001)
    drawn = shapely.length(lines[layers == "FOOTPRINTS"]).sum() * unit
    assert drawn == pytest.approx(sum(model.footprint.polygon.length for model in models), abs=0.1)


@pytest.mark.slow
def test_what_cjio_makes_of_it_is_whole_and_valid(
    tmp_path: Path, town: list[BuildingModel | Failure], cjio: ModuleType
) -> None:
    """A subset, its merger with the whole, an attribute less, a level, a sequence."""
    whole = tmp_path / "town.city.json"
    write_cityjson(whole, town, DUTCH)
    part = tmp_path / "part.city.json"
    buildings = {name for name, one in read_cityjson(whole).items() if one.type == "Building"}
    for words, count in (
        (["subset", "--random", "3", "save", part], 3),
        (["merge", part, "save", tmp_path / "merged.city.json"], len(buildings)),
        (["attribute_remove", "roof_type", "save", tmp_path / "less.city.json"], len(buildings)),
        (["lod_filter", "2.2", "save", tmp_path / "level.city.json"], len(buildings)),
        (["export", "jsonl", tmp_path / "town.city.jsonl"], len(buildings)),
    ):
        command = [Path(sys.executable).with_name("cjio"), whole, *words]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stderr
        made = Path(words[-1])
        assert sum(one.type == "Building" for one in read_cityjson(made).values()) == count
        assert validate_file(made) == []
