"""Of vector files only formats that hold their own data are opened."""

from __future__ import annotations

import json
import sqlite3
from pathlib import Path

import pytest
import shapely

from eaves.formats import InputError, read_polygons
from eaves.formats.crs import parse_crs, system_of
from eaves.formats.vectors.geopackage import Row, write_polygons
from eaves.formats.vectors.polygons import list_vector_layers

SQUARE = shapely.box(85000, 447000, 85010, 447010)
PLANE = system_of(parse_crs("EPSG:28992"), "test", (85000.0, 447000.0))


@pytest.fixture
def square(tmp_path: Path) -> Path:
    """A file that must not be read by way of another one."""
    write_polygons(tmp_path / "secret.gpkg", [Row(SQUARE, {"id": "secret"})], PLANE)
    return tmp_path / "secret.gpkg"


@pytest.mark.parametrize("suffix", [".gpkg", ".fgb", ".geojson", ".shp"])
def test_the_known_formats_are_read(suffix: str, tmp_path: Path) -> None:
    import pyogrio.raw

    path = tmp_path / f"a{suffix}"
    if suffix == ".shp":
        from numpy import array

        wkb = array([shapely.to_wkb(SQUARE)], dtype=object)
        pyogrio.raw.write(
            path, wkb, [array(["x"], object)], ["id"], geometry_type="Polygon", crs="EPSG:28992"
        )
    else:
        write_polygons(path, [Row(SQUARE, {"id": "x"})], PLANE)
    assert read_polygons(path, id_field="id", target=PLANE)[1] == ["x"]


@pytest.mark.parametrize("name", ["a.vrt", "a.gpkg", "a.geojson", "a.shp"])
def test_a_vrt_under_any_name_reads_nothing(name: str, square: Path) -> None:
    path = square.parent / name
    source = f"<SrcDataSource>{square}</SrcDataSource><SrcLayer>footprints</SrcLayer>"
    path.write_text(f'<OGRVRTDataSource><OGRVRTLayer name="a">{source}</OGRVRTLayer></OGRVRTDataSource>')
    with pytest.raises(InputError, match="vector file"):
        read_polygons(path)


@pytest.mark.parametrize(
    "told",
    [
        {"type": "gdal_streamed_alg", "command_line": "gdal vector pipeline ! read SECRET ! write x"},
        {"stac_version": "1.0.0", "type": "Item", "assets": {"a": {"href": "SECRET"}}},
        {"conformsTo": [], "links": [{"rel": "data", "href": "http://127.0.0.1:1/collections"}]},
        {"type": "Topology", "arcs": [], "objects": {}},
        {"\u0074ype": "x", "links": []},
    ],
)
def test_json_that_leads_elsewhere_is_no_geojson(told: dict[str, object], square: Path) -> None:
    path = square.parent / "a.geojson"
    path.write_text(json.dumps(told).replace("SECRET", str(square)))
    with pytest.raises(InputError):
        read_polygons(path)


def test_links_in_a_geojson_are_not_followed(square: Path) -> None:
    path = square.parent / "a.geojson"
    write_polygons(path, [Row(SQUARE, {"id": "own"})], PLANE)
    told = json.loads(path.read_text())
    told["links"] = [{"rel": "next", "href": str(square)}, {"rel": "next", "href": "http://127.0.0.1:1/"}]
    path.write_text(json.dumps(told))
    assert read_polygons(path, id_field="id", target=PLANE)[1] == ["own"]


def test_a_database_with_tables_that_read_other_files_is_refused(square: Path) -> None:
    with sqlite3.connect(square) as database:
        database.execute("PRAGMA writable_schema = 1")
        database.execute(
            "INSERT INTO sqlite_master VALUES ('table', 'v', 'v', 0, "
            "'CREATE VIRTUAL TABLE v USING VirtualOGR(''/etc/passwd'')')"
        )
    database.close()
    with pytest.raises(InputError, match="VirtualOGR"):
        read_polygons(square)


def test_a_folder_and_an_archive_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.zip").write_bytes(b"PK\3\4" + b"\0" * 100)
    for path in (tmp_path, tmp_path / "a.zip"):
        with pytest.raises(InputError, match="vector file"):
            read_polygons(path)


def test_a_map_is_parsed_once_until_it_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import pyogrio

    path, parsed, real = tmp_path / "map.geojson", list[int](), pyogrio.read_info
    monkeypatch.setattr(pyogrio, "read_info", lambda *args, **more: parsed.append(1) or real(*args, **more))  # type: ignore[func-returns-value]
    for count in (1, 2):
        feature = {"type": "Feature", "properties": {}, "geometry": shapely.geometry.mapping(SQUARE)}
        path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature] * count}))
        assert list_vector_layers(path)[0].count == count
        calls = len(parsed)
        assert list_vector_layers(path)[0].count == count
        assert calls == len(parsed) > 0
        parsed.clear()
