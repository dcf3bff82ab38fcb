"""Files against files: what `eaves evaluate` prints and writes."""

from __future__ import annotations

import csv
import json
import os
from pathlib import Path

import laspy
import numpy as np
import pytest
import rasterio
import shapely

from eaves.evaluate import evaluate_files
from eaves.formats import InputError, write_mask
from eaves.formats.vectors.geopackage import Row, write_polygons
from eaves.model import CoordinateSystem
from tests.conftest import write_laz
from tests.validate.made_shells import box, city_of

SYSTEM = CoordinateSystem(rasterio.CRS.from_epsg(32632).to_wkt(), code="EPSG:32632")
WEST, SOUTH = 500_000.0, 5_400_000.0
HOUSE = shapely.box(WEST + 5, SOUTH + 5, WEST + 15, SOUTH + 13)
SHED = shapely.box(WEST + 30, SOUTH + 5, WEST + 34, SOUTH + 9)


def write_cloud(path: Path, *houses: shapely.Polygon) -> Path:
    """Four points in each square metre: ground, and building 6 m higher inside the houses."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0.25, 40, 0.5), np.arange(0.25, 20, 0.5)))
    inside = shapely.contains_xy(shapely.union_all(houses), x + WEST, y + SOUTH)
    xyz = np.column_stack([x + WEST, y + SOUTH, np.where(inside, 106.0, 100.0)])
    write_laz(path, xyz, 32632, classification=np.where(inside, 6, 2))
    return path


def polygons(path: Path, *houses: shapely.Polygon) -> Path:
    rows = [Row(house, {"id": f"house {k}"}) for k, house in enumerate(houses)]
    write_polygons(path, rows, SYSTEM)
    return path


@pytest.fixture
def cloud(tmp_path: Path) -> Path:
    return write_cloud(tmp_path / "reference.laz", HOUSE, SHED)


def test_a_cloud_against_itself_scores_perfectly(cloud: Path) -> None:
    for what in ("ground", "detection"):
        figures = evaluate_files(what, cloud, cloud).figures
        assert all(
            v == 1 for k, v in figures.items() if k.endswith(("quality", "kappa")) and "over 50" not in k
        )


@pytest.mark.parametrize("ending", ["gpkg", "geojson", "fgb"])
def test_polygons_against_a_cloud(tmp_path: Path, cloud: Path, ending: str) -> None:
    figures = evaluate_files("detection", polygons(tmp_path / f"f.{ending}", HOUSE), cloud).figures
    assert figures["area, completeness"] == pytest.approx(80 / 96) and figures["area, correctness"] == 1
    assert figures["relation 1:0"] == 1


def test_a_mask_against_polygons_and_the_report(tmp_path: Path) -> None:
    mask = np.zeros((40, 80), bool)
    mask[14:30, 10:30] = True  # the house
    write_mask(tmp_path / "mask.tif", mask, WEST, SOUTH + 20, 0.5, SYSTEM)
    reference = polygons(tmp_path / "reference.gpkg", HOUSE, SHED)
    evaluation = evaluate_files("detection", tmp_path / "mask.tif", reference, tmp_path / "report")
    assert evaluation.figures["area, completeness"] == pytest.approx(80 / 96)
    with rasterio.open(tmp_path / "report" / "detection.tif") as image:
        values = image.read(1)
        assert (image.bounds.left, image.bounds.top, image.crs.to_epsg()) == (WEST, SOUTH + 20, 32632)
        assert ((values == 1).sum(), (values == 2).sum(), (values == 3).sum()) == (320, 64, 0)
    document = json.loads((tmp_path / "report" / "detection.json").read_text(encoding="utf-8"))
    assert document["figures"]["relation 1:1"] == 1 and len(document["rows"]) == 3
    with (tmp_path / "report" / "detection.csv").open(encoding="utf-8") as file:
        assert [row["relation"] for row in csv.DictReader(file)] == ["1:1", "1:0", "1:1"]


def test_footprints_and_their_rows_are_written(tmp_path: Path) -> None:
    import pyogrio

    reference = polygons(tmp_path / "reference.gpkg", HOUSE, SHED)
    result = polygons(tmp_path / "result.geojson", SHED)
    evaluation = evaluate_files("footprints", result, reference, tmp_path / "report")
    assert evaluation.figures["pairs"] == 1 and evaluation.figures["mean IoU of pairs"] == pytest.approx(
        1, abs=1e-3
    )
    names = pyogrio.raw.read(tmp_path / "report" / "footprints.gpkg", columns=["reference", "result"])[3]
    assert names[0].tolist() == ["house 0", "house 1"] and names[1].tolist() == [None, "house 0"]


def write_city(path: Path, east: int = 0, high: int = 6000) -> Path:
    """A box of 10 by 8 m as solid with semantics, `east` millimetres off."""
    shell = box(5000 + east, 5000, 100_000, 15_000 + east, 13_000, 100_000 + high)
    semantics = {
        "surfaces": [{"type": "GroundSurface"}, {"type": "RoofSurface"}, {"type": "WallSurface"}],
        "values": [[0, 1, 2, 2, 2, 2]],
    }
    document = city_of(shell, semantics=semantics)
    document["transform"]["translate"] = [WEST, SOUTH, 0.0]
    document["metadata"] = {"referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/32632"}
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def test_models_against_a_cloud(tmp_path: Path) -> None:
    cloud = write_cloud(tmp_path / "cloud.laz", HOUSE)
    model = write_city(tmp_path / "model.city.json", high=6100)
    figures = evaluate_files("models", model, cloud, tmp_path / "report").figures
    assert figures["roof points"] == 320 and figures["missed"] == 0
    assert figures["median distance (m)"] == pytest.approx(0.1) and figures["invalid models"] == 0
    assert (tmp_path / "report" / "models.gpkg").exists()


def test_models_against_reference_models(tmp_path: Path) -> None:
    true = write_city(tmp_path / "true.city.json")
    figures = evaluate_files("models", write_city(tmp_path / "m.city.json", high=6600), true).figures
    assert figures["RMSE by building, mean (m)"] == pytest.approx(0.6)
    assert figures["volume error"] == pytest.approx(0.1) and figures["height error (m)"] == pytest.approx(0.6)


def test_planes_of_models_shifted_by_a_metre(tmp_path: Path) -> None:
    true, mine = write_city(tmp_path / "true.city.json"), write_city(tmp_path / "m.city.json", east=1000)
    figures = evaluate_files("planes", mine, true).figures
    assert figures["planes, quality"] == 1 and figures["RMS in height (m)"] == pytest.approx(0)
    assert 0.5 < float(figures["RMS in plan (m)"]) < 0.8


def write_planes(path: Path, split: float) -> Path:
    """A roof of 10 by 10 m in two planes, parted at x = `split`, four points in each square metre."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0.25, 10, 0.5), np.arange(0.25, 10, 0.5)))
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [WEST, SOUTH, 0.0]
    header.add_extra_dim(laspy.ExtraBytesParams("plane_id", "uint32"))
    las = laspy.LasData(header)
    las.x, las.y, las.z = x + WEST, y + SOUTH, 10 - abs(x - 5)
    las.plane_id = np.where(x < split, 1, 2).astype(np.uint32)
    las.write(path)
    return path


def test_planes_of_points_are_matched_by_place(tmp_path: Path) -> None:
    true, mine = write_planes(tmp_path / "true.laz", 5.0), write_planes(tmp_path / "mine.laz", 6.0)
    evaluation = evaluate_files("planes", mine, true)
    assert evaluation.figures["planes, quality"] == 1 and evaluation.figures["relation 1:1"] == 2
    areas = {(row["set"], row["label"]): row["area_m2"] for row in evaluation.rows}
    assert areas["result", 1] / areas["reference", 1] == pytest.approx(1.2)
    assert areas["result", 2] / areas["reference", 2] == pytest.approx(0.8)


def test_a_cloud_without_plane_numbers_is_refused(tmp_path: Path, cloud: Path) -> None:
    with pytest.raises(InputError, match="plane_id"):
        evaluate_files("planes", cloud, cloud)


def test_the_filter_test_of_the_isprs_has_ground_zero(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    xyz = rng.uniform(0, 50, (200, 3)) + [WEST, SOUTH, 100]
    label = np.repeat([0, 1], [120, 80])
    path = tmp_path / "samp.txt"
    np.savetxt(path, np.column_stack([xyz, label]), fmt=["%.3f"] * 3 + ["%d"])
    figures = evaluate_files("ground", path, path).figures
    assert figures["points"] == 200 and figures["total error"] == 0


def test_the_table_is_aligned_and_a_missing_figure_is_a_dash(tmp_path: Path) -> None:
    empty = write_cloud(tmp_path / "empty.laz")
    text = evaluate_files("detection", empty, empty).as_text()
    lines = text.splitlines()
    assert lines[0].startswith("detection:") and "area, quality" in text and "–" in text
    assert len({line.index("  ", 4) > 0 for line in lines[1:]}) == 1


def test_an_unknown_comparison_is_refused_with_the_ones_there_are(cloud: Path) -> None:
    with pytest.raises(ValueError, match="detection"):
        evaluate_files("trees", cloud, cloud)


def test_a_cloud_has_no_footprints_to_compare(tmp_path: Path, cloud: Path) -> None:
    with pytest.raises(InputError, match="polygons"):
        evaluate_files("footprints", cloud, polygons(tmp_path / "f.gpkg", HOUSE))


def test_a_cloud_and_polygons_have_no_common_planes(tmp_path: Path) -> None:
    cloud = write_planes(tmp_path / "planes.laz", 5.0)
    with pytest.raises(InputError, match="cloud"):
        evaluate_files("planes", cloud, polygons(tmp_path / "f.gpkg", HOUSE))


def test_cityjson_is_known_by_its_content_too(tmp_path: Path) -> None:
    model = write_city(tmp_path / "model.json")
    assert evaluate_files("footprints", model, polygons(tmp_path / "f.gpkg", HOUSE)).figures["pairs"] == 1


@pytest.mark.parametrize("what", ["ground", "detection", "footprints", "planes", "models"])
def test_a_file_that_is_not_there_or_empty_is_refused_in_one_line(tmp_path: Path, what: str) -> None:
    for name in ("none.laz", "none.gpkg", "none.city.json", "none.tif", "none.obj", "none.txt"):
        for there in (False, True):
            path = tmp_path / name
            if there:
                path.write_bytes(b"")
            with pytest.raises(InputError) as raised:
                evaluate_files(what, path, path)
            assert "\n" not in str(raised.value) and name in str(raised.value)


@pytest.mark.skipif("EAVES_DATA" not in os.environ, reason="EAVES_DATA is not set")
def test_the_delft_cloud_against_itself_scores_perfectly() -> None:
    path = Path(os.environ["EAVES_DATA"]) / "delft" / "ahn3.laz"
    assert evaluate_files("detection", path, path).figures["objects, quality"] == 1
