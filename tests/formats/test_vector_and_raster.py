"""GeoPackages, rasters and mosaics hold what was put in; a file appears whole or not at all."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import pytest
import rasterio
import shapely
from shapely import LineString, MultiPolygon, Polygon

from eaves.formats import (
    InputError,
    MosaicWriter,
    read_polygons,
    read_raster,
    write_geopackage,
    write_mask,
    write_raster,
)
from eaves.formats.crs import parse_crs, system_of
from eaves.formats.vectors.geopackage import Row, write_polygons
from eaves.formats.vectors.polygons import list_vector_layers, read_table
from eaves.formats.whole_files import atomic
from eaves.model import Bounds, CoordinateSystem, Raster
from eaves.model.coordinates import LOCAL_METRES

DUTCH = system_of(parse_crs("EPSG:28992"), "test", (0.0, 0.0))
FEET = system_of(parse_crs("EPSG:2994"), "test", (0.0, 0.0))
FEET_AND_METRES = system_of(parse_crs("2994+5703"), "test", (0.0, 0.0))
FOOT = 0.3048
HOUSE = Polygon([(85000, 447000), (85010, 447000), (85010, 447006), (85000, 447006)])
ROOF = Polygon([(85000, 447000, 3), (85010, 447000, 3), (85010, 447003, 6), (85000, 447003, 6)])


def columns(path: Path, layer: str) -> tuple[dict[str, Any], list[Any], dict[str, list[Any]]]:
    meta, _, wkb, fields = pyogrio.raw.read(path, layer=layer)
    named = {str(name): list(values) for name, values in zip(meta["fields"], fields, strict=True)}
    return meta, list(shapely.from_wkb(wkb)), named


def test_further_columns_are_a_table_by_id_and_are_read_with_the_footprints(tmp_path: Path) -> None:
    path, square = tmp_path / "a.gpkg", shapely.box(0, 0, 1, 1)
    rows = [Row(square, {"h_70p": 1.5 * n, "tile": "0_0", "lod": "2.2", "id": f"b{n}"}) for n in range(3)]
    write_geopackage(path, rows)
    assert list_vector_layers(path)[0].columns == ("id", "lod", "tile")
    assert [row["h_70p"] for row in read_table(path, "attributes", ["h_70p"])] == [0.0, 1.5, 3.0]
    assert read_polygons(path, layer="footprints")[2] == [
        {"id": f"b{n}", "lod": "2.2", "tile": "0_0", "h_70p": 1.5 * n} for n in range(3)
    ]


def test_types_and_nulls_are_kept(tmp_path: Path) -> None:
    rows = [
        Row(HOUSE, {"id": "a", "floors": 2, "height": 7.5, "flat": True, "note": None, "only_first": 1}),
        Row(HOUSE, {"id": "b", "floors": np.int32(3), "height": float("nan"), "flat": np.bool_(False)}),
        Row(HOUSE, {"id": "ü", "floors": None, "height": 3, "flat": None, "note": "näher"}),
    ]
    write_geopackage(tmp_path / "a.gpkg", rows, [Row(ROOF, {"slope": 45.0})], DUTCH)
    polygons, ids, attributes, system = read_polygons(tmp_path / "a.gpkg", id_field="id")
    assert ids == ["a", "b", "ü"] and all(polygon.equals(HOUSE) for polygon in polygons)
    assert system.code == "EPSG:28992"
    assert [row["floors"] for row in attributes] == [2, 3, None]
    assert [row["height"] for row in attributes] == [7.5, None, 3.0]
    assert [row["flat"] for row in attributes] == [True, False, None]
    assert [type(row["flat"]) for row in attributes[:2]] == [bool, bool]
    assert [row["note"] for row in attributes] == [None, None, "näher"]
    assert [row["only_first"] for row in attributes] == [1, None, None]
    assert list(attributes[0]) == ["id", "floors", "height", "flat", "note", "only_first"]


def test_roof_planes_have_heights(tmp_path: Path) -> None:
    write_geopackage(tmp_path / "a.gpkg", [Row(HOUSE)], [Row(ROOF, {"slope": 45.0})], FEET_AND_METRES)
    meta, (roof,), fields = columns(tmp_path / "a.gpkg", "roof_planes")
    assert meta["geometry_type"] == "Polygon Z" and fields == {"slope": [45.0]}
    wanted = shapely.get_coordinates(ROOF, include_z=True) / [FOOT, FOOT, 1.0]
    assert np.allclose(shapely.get_coordinates(roof, include_z=True), wanted)
    flat = columns(tmp_path / "a.gpkg", "footprints")[0]
    assert flat["geometry_type"] == "Polygon"


@pytest.mark.parametrize("system", [LOCAL_METRES, DUTCH, FEET], ids=["local", "metres", "feet"])
def test_footprints_come_back_in_metres(tmp_path: Path, system: CoordinateSystem) -> None:
    pair = MultiPolygon([HOUSE, shapely.transform(HOUSE, lambda xy: xy + 50)])
    write_geopackage(tmp_path / "a.gpkg", [Row(HOUSE), Row(pair)], (), system)
    polygons, ids, _, found = read_polygons(tmp_path / "a.gpkg", layer="footprints")
    assert ids == ["1", "2"] and found.unit_m == system.unit_m
    assert [round(polygon.area, 6) for polygon in polygons] == [60.0, 120.0]
    assert polygons[0].hausdorff_distance(HOUSE) < 1e-6


def test_no_rows_are_two_empty_layers(tmp_path: Path) -> None:
    write_geopackage(tmp_path / "a.gpkg", [], [], DUTCH)
    layers = pyogrio.list_layers(tmp_path / "a.gpkg")
    assert [name for name, kind in layers if kind] == ["footprints", "roof_planes"]
    assert read_polygons(tmp_path / "a.gpkg")[:3] == ([], [], [])


def test_rows_without_geometry_are_left_out_and_keep_numbers(tmp_path: Path) -> None:
    rows = [Row(None, {"id": 1}), Row(HOUSE, {"id": 2}), Row(Polygon(), {"id": 3})]
    write_geopackage(tmp_path / "a.gpkg", rows, (), DUTCH)
    assert read_polygons(tmp_path / "a.gpkg")[1] == ["2"]


def test_what_is_no_polygon_file_is_refused(tmp_path: Path) -> None:
    write_geopackage(tmp_path / "a.gpkg", [Row(HOUSE, {"id": 1})], (), DUTCH)
    line = shapely.to_wkb(np.array([LineString([(0, 0), (1, 1)])], dtype=object))
    pyogrio.raw.write(
        tmp_path / "line.gpkg", line, [], [], geometry_type="LineString", crs="EPSG:28992", driver="GPKG"
    )
    (tmp_path / "text.gpkg").write_text("nothing")
    (tmp_path / "empty.geojson").write_text("")
    cases: list[tuple[str, dict[str, str], str]] = [
        ("none.gpkg", {}, "does not exist"),
        ("a.gpkg", {"layer": "roofs"}, "has no layer 'roofs'; choose one of: footprints, roof_planes"),
        ("a.gpkg", {"id_field": "name"}, "has no field 'name'; choose one of: id"),
        ("line.gpkg", {}, "holds LineString and must hold polygons"),
        ("text.gpkg", {}, "is not a vector file"),
        ("empty.geojson", {}, "is not a vector file"),
    ]
    for name, options, rule in cases:
        with pytest.raises(InputError, match=rule) as caught:
            read_polygons(tmp_path / name, **options)
        assert name in str(caught.value) and "\n" not in str(caught.value)
    with pytest.raises(InputError, match="no known vector format"):
        write_polygons(tmp_path / "a.dwg", [Row(HOUSE)])


def test_polygons_are_reprojected_to_the_target(tmp_path: Path) -> None:
    write_polygons(tmp_path / "a.gpkg", [Row(HOUSE)], DUTCH)
    ring = [[4.478, 52.005], [4.479, 52.005], [4.479, 52.006], [4.478, 52.005]]
    feature = {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [ring]}}
    (tmp_path / "a.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    utm = system_of(parse_crs("EPSG:32631"), "test", (0.0, 0.0))
    (moved,), _, _, system = read_polygons(tmp_path / "a.gpkg", target=utm)
    assert system is utm and moved.area == pytest.approx(60.0, rel=1e-3)
    assert abs(moved.centroid.y - 5.76e6) < 2e4
    (degrees,), *_ = read_polygons(tmp_path / "a.geojson", target=utm)
    assert degrees.area == pytest.approx(0.5 * 68.6 * 111.3, rel=0.01)
    with pytest.raises(InputError, match=r"degrees.*EPSG:32631"):
        read_polygons(tmp_path / "a.geojson")
    (same,), *_ = read_polygons(tmp_path / "a.gpkg", target=LOCAL_METRES)
    assert same.equals(HOUSE)


@pytest.mark.parametrize("system", [LOCAL_METRES, DUTCH, FEET, FEET_AND_METRES])
def test_heights_come_back_in_metres(tmp_path: Path, system: CoordinateSystem) -> None:
    values = np.arange(12, dtype=np.float32).reshape(3, 4)
    values[1, 2] = np.nan
    raster = Raster(values, 10.0, 20.0, 0.5)
    write_raster(tmp_path / "dtm.tif", raster, system, (85000.0, 447000.0))
    back, found = read_raster(tmp_path / "dtm.tif", (85000.0, 447000.0))
    assert np.allclose(back.values, values, equal_nan=True, atol=1e-5)
    assert (back.west, back.north, back.cell) == pytest.approx((10.0, 20.0, 0.5), abs=1e-6)
    assert found.unit_m == pytest.approx(system.unit_m)
    with rasterio.open(tmp_path / "dtm.tif") as image:
        assert image.read(1)[2, 3] == pytest.approx(11 / system.vertical_unit_m)
        assert image.transform.a == pytest.approx(0.5 / system.horizontal_unit_m)
    (tmp_path / "no.tif").write_text("no raster")
    with pytest.raises(InputError, match="is not a raster"):
        read_raster(tmp_path / "no.tif")


def test_mask_and_world_file_agree(tmp_path: Path) -> None:
    mask = np.zeros((4, 6), bool)
    mask[1, 2:5] = True
    write_mask(tmp_path / "mask.tif", mask, 85000.0, 447010.0, 0.5, DUTCH)
    with rasterio.open(tmp_path / "mask.tif") as image:
        assert image.dtypes == ("uint8",) and np.array_equal(image.read(1), mask)
        assert image.crs.to_epsg() == 28992 and image.bounds == (85000.0, 447008.0, 85003.0, 447010.0)
    lines = [float(line) for line in (tmp_path / "mask.tfw").read_text().split()]
    assert lines == [0.5, 0.0, 0.0, -0.5, 85000.25, 447009.75]


def pieces_of(bounds: Bounds, cell: float, side: float) -> list[tuple[Raster, Bounds]]:
    """Overlapping pieces of the height field 100 + x - 2 y, each with the square it answers for."""
    found = []
    for west in np.arange(bounds.west, bounds.east, side):
        for south in np.arange(bounds.south, bounds.north, side):
            core = Bounds(west, south, west + side, south + side)
            grown = core.buffered(3 * cell)
            count = round(grown.width / cell)
            x = grown.west + (np.arange(count) + 0.5) * cell
            y = grown.north - (np.arange(count) + 0.5) * cell
            values = (100 + x[None, :] - 2 * y[:, None]).astype(np.float32)
            found.append((Raster(values, grown.west, grown.north, cell), core))
    return found


@pytest.mark.parametrize("mask", [False, True])
@pytest.mark.parametrize("system", [DUTCH, FEET], ids=["metres", "feet"])
def test_pieces_in_any_order_are_one_file(tmp_path: Path, system: CoordinateSystem, mask: bool) -> None:
    bounds = Bounds(0.0, 0.0, 90.0, 60.0)
    pieces = pieces_of(bounds, 0.5, 30.0)
    orders = [np.arange(len(pieces)), np.random.default_rng(1).permutation(len(pieces))]
    for name, order in zip("ab", orders, strict=True):
        with MosaicWriter(tmp_path / f"{name}.tif", bounds, 0.5, system, mask) as mosaic:
            for number in order:
                mosaic.write(*pieces[number])
    assert (tmp_path / "a.tif").read_bytes() == (tmp_path / "b.tif").read_bytes()
    with rasterio.open(tmp_path / "a.tif") as image:
        values = image.read(1)
    x, y = (np.arange(180) + 0.5) * 0.5, 60 - (np.arange(120) + 0.5) * 0.5
    wanted = 100 + x[None, :] - 2 * y[:, None]
    assert np.allclose(values, wanted > 0 if mask else wanted / system.vertical_unit_m, atol=1e-4)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.tif", "b.tif"]


def test_cells_no_piece_covers_are_missing(tmp_path: Path) -> None:
    bounds = Bounds(0.2, 0.2, 9.9, 9.9)
    with MosaicWriter(tmp_path / "a.tif", bounds, 1.0) as mosaic:
        mosaic.write(Raster(np.ones((4, 4), np.float32), -2.0, 2.0, 1.0), Bounds(-9, -9, 99, 99))
        mosaic.write(Raster(np.ones((4, 4), np.float32), 500.0, 2.0, 1.0), Bounds(-9, -9, 999, 99))
        with pytest.raises(ValueError, match=r"cells of 0.5 m, the mosaic of 1.0 m"):
            mosaic.write(Raster(np.ones((4, 4), np.float32), 0.0, 2.0, 0.5), bounds)
    raster, _ = read_raster(tmp_path / "a.tif")
    assert raster.shape == (10, 10) and (raster.west, raster.north) == (0.0, 10.0)
    assert np.isfinite(raster.values).sum() == 4 and np.isfinite(raster.values[8:, :2]).all()


def test_an_exception_leaves_nothing_behind(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), atomic(tmp_path / "new" / "a.bin") as temporary:
        temporary.write_bytes(b"half")
        (temporary.parent / "a.bin-journal").write_bytes(b"side file")
        raise RuntimeError
    assert list((tmp_path / "new").iterdir()) == []
    kept = tmp_path / "old.bin"
    kept.write_bytes(b"whole")
    with pytest.raises(RuntimeError), atomic(kept) as temporary:
        temporary.write_bytes(b"half")
        raise RuntimeError
    assert kept.read_bytes() == b"whole"
    with atomic(kept) as temporary:
        temporary.write_bytes(b"new")
        assert kept.read_bytes() == b"whole"
    assert kept.read_bytes() == b"new"
    with pytest.raises(RuntimeError), MosaicWriter(tmp_path / "m.tif", Bounds(0, 0, 9, 9), 1.0):
        raise RuntimeError
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new", "old.bin"]


def test_a_folder_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="the folder cannot be written"):
        write_mask(tmp_path / "file" / "mask.tif", np.zeros((2, 2), bool), 0.0, 0.0, 1.0)


@pytest.mark.parametrize(("rows", "columns"), [(700, 1100), (600, 514), (300, 400)])
def test_overviews_are_means_of_two_by_two_cells__and_small_rasters_have_none(
    rows: int, columns: int, tmp_path: Path
) -> None:
    values = np.random.default_rng(rows).uniform(0, 9, (rows, columns)).astype(np.float32)
    bounds = Bounds(0.0, 0.0, 0.5 * columns, 0.5 * rows)
    with MosaicWriter(tmp_path / "dtm.tif", bounds, 0.5, DUTCH) as writer:
        writer.write(Raster(values, 0.0, 0.5 * rows, 0.5), bounds)
    with rasterio.open(tmp_path / "dtm.tif") as image:
        levels = image.overviews(1)
        assert (image.read(1) == values).all()
    assert levels == [2**k for k in (1, 2) if max(rows, columns) > 256 * 2**k]
    if levels:
        with rasterio.open(tmp_path / "dtm.tif", overview_level=0) as image:
            means = values.reshape(rows // 2, 2, -1, 2).mean(axis=(1, 3))
            assert image.read(1) == pytest.approx(means, abs=1e-5)
