"""Every export is opened by a reader we did not write, and holds what was put in."""

from __future__ import annotations

import json
import shutil
import struct
import subprocess
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest
import shapely
import shapely.affinity
from shapely import Polygon

from eaves.exports import lod_layers, write_3dtiles, write_glb, write_lod_layers, write_obj
from eaves.exports.ifc import write_ifc
from eaves.flow.formats import check_formats
from eaves.formats import read_polygons, write_geoparquet
from eaves.formats.crs import parse_crs, system_of
from eaves.formats.models import meshes
from eaves.formats.models.meshes import mesh_of_solids
from eaves.formats.vectors.geopackage import Row, write_polygons
from eaves.model import BuildingModel, CoordinateSystem, Face, Failure, Footprint, Solid
from eaves.model.building import GROUND_SURFACE, ROOF_SURFACE, WALL_SURFACE
from tests.judges import judging_module, need_judge

trimesh = pytest.importorskip("trimesh")

ORIGIN = (84960.0, 447120.0)
DUTCH = system_of(parse_crs("EPSG:28992"), "test", ORIGIN)
OREGON_FEET = system_of(parse_crs("EPSG:2994"), "test", (636000.0, 849000.0))
COURT = Polygon([(0, 0), (6, 0), (12, 0), (12, 10), (0, 10)], [[(3, 3), (3, 6), (8, 6), (8, 3)]])


def block_with_court(base: float = 2.0, height: float = 7.0) -> Solid:
    """A building around a court: its roof and ground have a hole, and a vertex on a straight edge."""
    rings = [np.asarray(ring.coords)[:-1] for ring in (COURT.exterior, *COURT.interiors)]
    flat = np.concatenate(rings)
    count = len(flat)
    vertices = np.vstack([np.column_stack([flat, np.full(count, z)]) for z in (base, base + height)])
    starts = np.cumsum([0, *map(len, rings)])
    lower = [tuple(range(a, b)) for a, b in pairwise(starts)]
    faces = [Face(tuple(tuple(v + count for v in ring) for ring in lower), ROOF_SURFACE, 0)]
    faces.append(Face(tuple(ring[::-1] for ring in lower), GROUND_SURFACE))
    for ring in lower:
        faces += [
            Face(((a, b, b + count, a + count),), WALL_SURFACE)
            for a, b in zip(ring, ring[1:] + ring[:1], strict=True)
        ]
    return Solid.of(vertices, tuple(faces))


def model_at(origin: tuple[float, float], name: str) -> BuildingModel:
    attributes = {"h_ground": 2.0, "roof_type": "flat", "h_roof_70p": None}
    return BuildingModel(Footprint(COURT, origin, name, 0.9), {"2.2": (block_with_court(),)}, (), attributes)


@pytest.fixture
def town() -> list[BuildingModel | Failure]:
    """Two blocks with a building each, and a building without a model."""
    failure = Failure("no_plane", "no plane has\n3 points", "roof", Footprint(COURT, ORIGIN, "c"))
    return [model_at(ORIGIN, "a b"), failure, model_at((ORIGIN[0] + 240, ORIGIN[1]), "d")]


def read_glb(path: Path) -> tuple[dict[str, Any], bytes]:
    """JSON and numbers of a GLB file."""
    data = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON"
    return json.loads(data[20 : 20 + size]), data[28 + size :]


def test_triangles_close_around_a_court() -> None:
    mesh = mesh_of_solids([block_with_court()])
    solid = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)
    assert solid.is_watertight and solid.is_winding_consistent
    assert solid.volume == pytest.approx(COURT.area * 7.0)


def test_a_sloped_concave_face_is_covered() -> None:
    ring = np.array([[0, 0], [9, 0], [9, 4], [5, 4], [5, 8], [0, 8]], float)
    vertices = np.column_stack([ring, 0.7 * ring[:, 0] - 1.3 * ring[:, 1] + 5])
    mesh = mesh_of_solids([Solid.of(vertices, (Face((tuple(range(6)),), ROOF_SURFACE),))])
    found = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)
    assert found.area == pytest.approx(Polygon(ring).area * np.sqrt(1 + 0.7**2 + 1.3**2))
    assert (found.face_normals[:, 2] > 0).all()


def test_trimesh_reads_the_obj(tmp_path: Path, town: list[BuildingModel | Failure]) -> None:
    path = tmp_path / "town.obj"
    assert write_obj(path, iter(town), DUTCH) == 2
    lines = path.read_text(encoding="utf-8").splitlines()
    offset = np.array([float(v) for v in next(x for x in lines if "offset " in x and "# o" in x).split()[2:]])
    assert [line for line in lines if line.startswith("g ")] == ["g a_b", "g d"]
    assert "# c has no model: no_plane, no plane has 3 points" in lines
    whole = trimesh.load(path, force="mesh", process=False)
    upright = np.array(whole.vertices)[:, [0, 2, 1]] * [1, -1, 1] + offset  # written as east, up, south
    assert np.allclose(upright.min(axis=0), [*ORIGIN, 2.0])
    assert np.allclose(upright.max(axis=0), [ORIGIN[0] + 252, ORIGIN[1] + 10, 9.0])
    whole.merge_vertices(merge_tex=True, merge_norm=True)
    assert whole.is_watertight and whole.volume == pytest.approx(2 * COURT.area * 7.0)
    library = (tmp_path / "town.mtl").read_text(encoding="utf-8")
    assert all(f"newmtl {name}\n" in library for name in (GROUND_SURFACE, WALL_SURFACE, ROOF_SURFACE))


def test_obj_in_feet_is_in_feet(tmp_path: Path) -> None:
    write_obj(tmp_path / "feet.obj", [model_at((193920.0, 258960.0), "a")], OREGON_FEET)
    mesh = trimesh.load(tmp_path / "feet.obj", force="mesh")
    assert np.allclose(mesh.extents, np.array([12, 7, 10]) / 0.3048, atol=1e-3)


def test_trimesh_reads_the_glb(tmp_path: Path, town: list[BuildingModel | Failure]) -> None:
    path = tmp_path / "town.glb"
    assert write_glb(path, iter(town), DUTCH) == 2
    scene = trimesh.load(path, merge_primitives=True)
    assert np.allclose(scene.bounds, [[0, 2, -10], [252, 9, 0]], atol=1e-5)
    for building in scene.geometry.values():
        building.merge_vertices(merge_tex=True, merge_norm=True)
        assert building.is_watertight and building.volume == pytest.approx(COURT.area * 7.0, rel=1e-5)
    assert len(scene.geometry) == 2
    document, _ = read_glb(path)
    assert document["asset"]["extras"]["origin"] == [*ORIGIN, 0.0]
    assert document["asset"]["extras"]["crs"] == "EPSG:28992"
    nodes = {node["name"]: node for node in document["nodes"]}
    assert list(nodes) == ["a b", "c", "d"]
    assert nodes["d"]["extras"]["roof_type"] == "flat" and nodes["d"]["extras"]["h_roof_70p"] is None
    assert "mesh" not in nodes["c"] and nodes["c"]["extras"]["failure_code"] == "no_plane"


def test_glb_normals_are_those_of_the_faces(tmp_path: Path) -> None:
    write_glb(tmp_path / "one.glb", [model_at(ORIGIN, "a")], DUTCH)
    document, numbers = read_glb(tmp_path / "one.glb")
    for primitive in document["meshes"][0]["primitives"]:
        accessor = document["accessors"][primitive["attributes"]["NORMAL"]]
        view = document["bufferViews"][accessor["bufferView"]]
        start = view["byteOffset"] + accessor["byteOffset"]
        size = 4 * (accessor["count"] - 1) * 6 + 12
        raw = np.frombuffer(numbers[start : start + size] + bytes(12), "<f4").reshape(-1, 6)[:, :3]
        assert np.allclose(np.linalg.norm(raw, axis=1), 1.0)
        name = document["materials"][primitive["material"]]["name"]
        up = {ROOF_SURFACE: 1.0, GROUND_SURFACE: -1.0, WALL_SURFACE: 0.0}[name]
        assert np.allclose(raw[:, 1], up)


@pytest.mark.parametrize("at_once", [1, 2])
def test_files_do_not_depend_on_how_many_buildings_are_made_at_once(
    tmp_path: Path, town: list[BuildingModel | Failure], monkeypatch: pytest.MonkeyPatch, at_once: int
) -> None:
    write_glb(tmp_path / "whole.glb", town, DUTCH)
    write_lod_layers(tmp_path / "whole.gpkg", town, DUTCH)
    monkeypatch.setattr(meshes, "AT_ONCE", at_once)
    monkeypatch.setattr(lod_layers, "AT_ONCE", at_once)
    write_glb(tmp_path / "parts.glb", town, DUTCH)
    write_lod_layers(tmp_path / "parts.gpkg", town, DUTCH)
    assert (tmp_path / "parts.glb").read_bytes() == (tmp_path / "whole.glb").read_bytes()
    one, other = (
        read_polygons(tmp_path / f"{name}.gpkg", layer="lod_2_2", keep_all=True)
        for name in ("whole", "parts")
    )
    assert [shape.wkb for shape in one[0]] == [shape.wkb for shape in other[0]] and one[2] == other[2]
    roofs = [row for row in one[2] if row["surface"] == ROOF_SURFACE]
    assert [(row["id"], row["area_m2"], row["face_count"]) for row in roofs] == [
        ("a b", COURT.area, 1),
        ("d", COURT.area, 1),
    ]


KHRONOS = """
const validator = require('gltf-validator'), { readFileSync } = require('fs');
Promise.all(process.argv.slice(1).map(path => validator.validateBytes(new Uint8Array(readFileSync(path)))))
  .then(reports => console.log(JSON.stringify(reports.map(report => report.issues))));
"""


def test_the_validator_of_khronos_finds_nothing(tmp_path: Path, town: list[BuildingModel | Failure]) -> None:
    """Needs Node.js and, where NODE_PATH leads, the package gltf-validator."""
    node = shutil.which("node")
    asked = [node or "", "-e", "require.resolve('gltf-validator')"]
    need_judge("gltf-validator", node and not subprocess.run(asked, capture_output=True).returncode)
    write_glb(tmp_path / "town.glb", iter(town), DUTCH)
    write_3dtiles(tmp_path / "tiles", iter(town), DUTCH)
    files = [tmp_path / "town.glb", *sorted((tmp_path / "tiles" / "content").glob("*.glb"))]
    done = subprocess.run([node, "-e", KHRONOS, *map(str, files)], capture_output=True, text=True, check=True)
    alone, *tiles = json.loads(done.stdout)
    assert alone["messages"] == [] and len(tiles) == 2
    for issues in tiles:  # it does not know what the extensions are for, nor their buffers
        assert issues["numErrors"] == issues["numWarnings"] == 0
        assert {one["code"] for one in issues["messages"]} <= {"UNSUPPORTED_EXTENSION", "UNUSED_OBJECT"}
        unused = [one["pointer"] for one in issues["messages"] if one["code"] == "UNUSED_OBJECT"]
        assert all(pointer.startswith("/bufferViews/") for pointer in unused)


@pytest.mark.parametrize("system", [DUTCH, OREGON_FEET], ids=["metres", "feet"])
def test_tiles_lie_where_the_buildings_are(tmp_path: Path, system: CoordinateSystem) -> None:
    start = ORIGIN if system is DUTCH else (193920.0, 258960.0)
    town = [
        model_at((start[0] + 240 * i, start[1] + 240 * j), f"{i}-{j}") for i in range(4) for j in range(4)
    ]
    assert write_3dtiles(tmp_path / "tiles", iter(town), system) == 16
    tileset = json.loads((tmp_path / "tiles" / "tileset.json").read_text(encoding="utf-8"))
    check_tile(tileset["root"], tileset["geometricError"], tmp_path / "tiles")
    to_earth = pyproj.Transformer.from_crs(pyproj.CRS(system.wkt), "EPSG:4979", always_xy=True)
    to_centre = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    found = contents(tileset["root"], np.eye(4), tmp_path / "tiles")
    assert sum(uri.startswith("content/") for uri in found) == 16
    for number, model in enumerate(town, 1):
        placed = found[f"content/{number}.glb"]
        world = model.solids["2.2"][0].vertices + np.array([*model.footprint.origin, 0.0])
        degrees = to_earth.transform(world[:, 0] / system.unit_m[0], world[:, 1] / system.unit_m[1])
        wanted = np.column_stack(to_centre.transform(*degrees, world[:, 2]))
        apart = np.linalg.norm(placed[:, None] - wanted[None], axis=2)
        assert apart.min(axis=1).max() < 0.002 and apart.min(axis=0).max() < 0.002


def check_tile(tile: dict[str, Any], error: float, folder: Path, above: str = "ADD") -> None:
    """What the schema of 3D Tiles 1.1 asks of a tile and its children."""
    assert 0 <= tile["geometricError"] <= error
    ((kind, numbers),) = tile["boundingVolume"].items()
    assert len(numbers) == {"box": 12, "sphere": 4}[kind] and np.isfinite(numbers).all()
    refine = tile.get("refine", above)
    assert refine == ("REPLACE" if "content" in tile and "children" in tile else above)
    assert set(tile) <= {"boundingVolume", "geometricError", "refine", "transform", "content", "children"}
    if "content" in tile:
        document, _ = read_glb(folder / tile["content"]["uri"])
        assert document["extensionsUsed"] == ["EXT_mesh_features", "EXT_structural_metadata"]
    assert len(tile.get("children", [0])) > 0
    for child in tile.get("children", []):
        check_tile(child, tile["geometricError"], folder, refine)


def contents(tile: dict[str, Any], frame: np.ndarray, folder: Path) -> dict[str, np.ndarray]:
    """Address of a content → its vertices (N, 3) in the tileset's coordinates, all within their volumes."""
    if "transform" in tile:
        frame = frame @ np.array(tile["transform"]).reshape(4, 4).T
    found: dict[str, np.ndarray] = {}
    if "content" in tile:
        y_up = trimesh.load(folder / tile["content"]["uri"], force="mesh").vertices
        z_up = np.column_stack([y_up[:, 0], -y_up[:, 2], y_up[:, 1]])
        found[tile["content"]["uri"]] = z_up @ frame[:3, :3].T + frame[:3, 3]
    for child in tile.get("children", []):
        found |= contents(child, frame, folder)
    if "sphere" in tile["boundingVolume"]:
        *middle, radius = tile["boundingVolume"]["sphere"]
        centre = frame[:3, :3] @ middle + frame[:3, 3]
        for vertices in found.values():
            assert np.linalg.norm(vertices - centre, axis=1).max() <= radius * np.linalg.norm(frame[:3, 0])
    return found


def test_from_afar_a_city_has_prisms_in_place_of_its_largest_buildings(tmp_path: Path) -> None:
    small = model_at(ORIGIN, "small").with_(attributes={"roof_type": "flat", "secret": 1})
    town = [
        model_at((ORIGIN[0] + 240 * i, ORIGIN[1] + 240 * j), f"{i}-{j}") for i in range(3) for j in range(3)
    ]
    assert write_3dtiles(tmp_path, [small, *town], DUTCH) == 10
    root = json.loads((tmp_path / "tileset.json").read_text(encoding="utf-8"))["root"]
    assert root["refine"] == "REPLACE" and root["content"]["uri"] == "overview/1.glb"
    document, _ = read_glb(tmp_path / root["content"]["uri"])
    (table,) = document["extensions"]["EXT_structural_metadata"]["propertyTables"]
    assert table["count"] == 10 and "secret" not in table["properties"]
    mesh = trimesh.load(tmp_path / root["content"]["uri"], force="mesh")
    assert mesh.vertices[:, 1].max() - mesh.vertices[:, 1].min() == pytest.approx(7.0)
    hull = COURT.convex_hull
    whole = 10 * (hull.area + 7.0 * hull.length)
    assert mesh.area == pytest.approx(whole, rel=1e-4), "walls and roof, no ground"
    names = {path.name for path in (tmp_path / "overview").glob("*.glb")}
    write_3dtiles(tmp_path, [small], DUTCH)
    assert len(names) == 5 and not list((tmp_path / "overview").glob("*.glb")), "old ones are removed"


def test_a_tile_knows_its_buildings(tmp_path: Path) -> None:
    second = model_at(ORIGIN, "süd").with_(attributes={"roof_type": "gabled", "1st floor": 3})
    write_3dtiles(tmp_path, [model_at(ORIGIN, "a"), second], DUTCH)
    document, numbers = read_glb(tmp_path / "content" / "1.glb")
    metadata = document["extensions"]["EXT_structural_metadata"]
    (table,) = metadata["propertyTables"]
    schema = metadata["schema"]["classes"][table["class"]]["properties"]
    assert table["count"] == 2 and set(table["properties"]) == set(schema)

    def bytes_of(view: int) -> bytes:
        found = document["bufferViews"][view]
        assert found["byteOffset"] % 8 == 0
        return numbers[found["byteOffset"] :][: found["byteLength"]]

    ends = np.frombuffer(bytes_of(table["properties"]["id"]["stringOffsets"]), "<u4")
    names = bytes_of(table["properties"]["id"]["values"])
    assert [names[a:b].decode() for a, b in pairwise(ends)] == ["a", "süd"]
    assert schema["_1st_floor"]["name"] == "1st floor"
    floors = np.frombuffer(bytes_of(table["properties"]["_1st_floor"]["values"]), "<f8")
    assert floors.tolist() == [schema["_1st_floor"]["noData"], 3.0]
    for primitive in document["meshes"][0]["primitives"]:
        accessor = document["accessors"][primitive["attributes"]["_FEATURE_ID_0"]]
        assert accessor["count"] == document["accessors"][primitive["attributes"]["POSITION"]]["count"]


def test_geopandas_reads_the_parquet(tmp_path: Path) -> None:
    geopandas = pytest.importorskip("geopandas")
    pytest.importorskip("pyarrow")
    moved = shapely.transform(COURT, lambda xy: xy + np.array([193920.0, 258960.0]))
    rows = [
        Row(moved, {"id": "a", "floors": 3, "h": 2.5}),
        Row(moved, {"id": "b", "floors": None, "h": None}),
    ]
    write_geoparquet(tmp_path / "f.parquet", rows, OREGON_FEET)
    frame = geopandas.read_parquet(tmp_path / "f.parquet")
    assert frame.crs.to_epsg() == 2994
    assert list(frame["id"]) == ["a", "b"] and frame["floors"][0] == 3 and np.isnan(frame["floors"][1])
    assert frame.geometry[0].area == pytest.approx(COURT.area / 0.3048**2)
    east = 193920.0 / 0.3048
    assert len(geopandas.read_parquet(tmp_path / "f.parquet", bbox=(east, 0, east + 9, 1e7))) == 2
    assert len(geopandas.read_parquet(tmp_path / "f.parquet", bbox=(0, 0, 9, 9))) == 0


@pytest.mark.parametrize("name", ["f.geojson", "f.fgb"])
def test_geopandas_reads_the_other_vector_files(tmp_path: Path, name: str) -> None:
    geopandas = pytest.importorskip("geopandas")
    write_polygons(tmp_path / name, [Row(shapely.affinity.translate(COURT, *ORIGIN), {"id": "a"})], DUTCH)
    frame = geopandas.read_file(tmp_path / name).to_crs(28992)
    assert list(frame["id"]) == ["a"] and frame.geometry[0].area == pytest.approx(COURT.area, rel=1e-4)


@pytest.mark.parametrize("system", [DUTCH, OREGON_FEET], ids=["metres", "feet"])
def test_ifcopenshell_finds_closed_bodies_in_place(system: CoordinateSystem, tmp_path: Path) -> None:
    ifcopenshell = judging_module("ifcopenshell")
    geom, validate = import_module("ifcopenshell.geom"), import_module("ifcopenshell.validate")
    models = [model_at(ORIGIN, "a"), model_at((ORIGIN[0] + 240.0, ORIGIN[1]), "b")]
    for name in ("one.ifc", "two.ifc"):
        assert write_ifc(tmp_path / name, models, system) == 2
    assert (tmp_path / "one.ifc").read_bytes() == (tmp_path / "two.ifc").read_bytes()
    file, log = ifcopenshell.open(str(tmp_path / "one.ifc")), validate.json_logger()
    validate.validate(file, log)
    assert log.statements == []
    place = file.by_type("IfcMapConversion")[0]
    assert place.Scale == pytest.approx(1.0 / system.horizontal_unit_m)
    for number, building in enumerate(file.by_type("IfcBuilding")):
        shape = geom.create_shape(geom.settings(), building).geometry
        body = trimesh.Trimesh(np.reshape(shape.verts, (-1, 3)), np.reshape(shape.faces, (-1, 3)))
        assert body.is_watertight and body.volume == pytest.approx(COURT.area * 7.0, rel=1e-6)
        west = (place.Eastings * system.horizontal_unit_m) + body.vertices[:, 0].min()
        assert west == pytest.approx(ORIGIN[0] + 240.0 * number)


def test_an_unknown_format_is_refused_in_one_line() -> None:
    with pytest.raises(
        ValueError, match="--formats dwg: unknown format; choose among: cityjson, geojson, fgb"
    ):
        check_formats(["obj", "dwg"])


def test_nothing_to_write_gives_readable_files(tmp_path: Path) -> None:
    assert write_obj(tmp_path / "no.obj", [], DUTCH) == 0
    assert write_glb(tmp_path / "no.glb", [], DUTCH) == 0
    assert write_3dtiles(tmp_path / "no", [], DUTCH) == 0
    write_geoparquet(tmp_path / "no.parquet", [], DUTCH)
    assert read_glb(tmp_path / "no.glb")[0]["nodes"] == []
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "no",
        "no.glb",
        "no.mtl",
        "no.obj",
        "no.parquet",
    ]
