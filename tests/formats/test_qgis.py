"""A GeoPackage carries styles and the names of its columns; the project opens as a map in QGIS."""

from __future__ import annotations

import json
import os
import sqlite3
import subprocess
import zipfile
from contextlib import closing
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
from tests.judges import need_judge

from eaves.formats import write_geopackage, write_raster
from eaves.formats.columns import LAYERS
from eaves.formats.crs import parse_crs, system_of, unit_lengths
from eaves.formats.qgis.project import write_project
from eaves.formats.qgis.styles import listed_styles
from eaves.formats.vectors.geopackage import Row
from eaves.model import CoordinateSystem, Raster
from eaves.model.coordinates import LOCAL_METRES

QGIS_PYTHON = "/usr/bin/python3"
DUTCH = system_of(parse_crs("28992+5709"), "test", (0.0, 0.0))
FEET = system_of(parse_crs("EPSG:2994"), "test", (0.0, 0.0))


def write_street(folder: Path, system: CoordinateSystem = DUTCH) -> Path:
    """Three houses: a gable that looks east and west, a flat roof, one without a model; and their terrain."""
    footprints, planes = [], []
    for number, (lod, code) in enumerate((("2.2", None), ("1.2", "too_few_points"), (None, "no_plane"))):
        x, y = 85000.0 + 20 * number, 447000.0
        outline = shapely.box(x, y, x + 10, y + 12)
        about = {"id": f"house {number}", "area_m2": 120.0, "lod": lod, "failure_code": code}
        about |= {
            "failure_reason": code,
            "h_ground": 1.0,
            "measuredHeight": 7.0,
            "roof_type": lod and "gable",
        }
        footprints.append(Row(outline, about | {"rmse_m": 0.04}))
        for west, azimuth in ((x, 270.0), (x + 5, 90.0)) if lod else ():
            z = (4.0, 9.0) if azimuth > 180 else (9.0, 4.0)
            ring = [(west, y, z[0]), (west + 5, y, z[1]), (west + 5, y + 12, z[1]), (west, y + 12, z[0])]
            face = {"building_id": f"house {number}", "slope_deg": 45.0, "area_m2": 84.8, "no_data": False}
            face |= {"azimuth_deg": azimuth if lod == "2.2" else None, "rmse_m": 0.04}
            heights = {"h_low": 4.0, "h_high": 9.0, "h_ground": 1.0}
            planes.append(Row(shapely.Polygon(ring), face | heights))
    write_geopackage(folder / "footprints.gpkg", footprints, planes, system)
    terrain = Raster(np.ones((40, 80), np.float32), 84990.0, 447020.0, 1.0)
    write_raster(folder / "dtm.tif", terrain, system)
    path = folder / "buildings.qgz"
    write_project(path, folder / "footprints.gpkg", [folder / "dtm.tif", folder / "mask.tif"], system)
    return path


def query(path: Path, text: str) -> list[Any]:
    with closing(sqlite3.connect(path)) as database:
        return database.execute(text).fetchall()


def test_layers_have_styles_of_which_one_is_the_default(tmp_path: Path) -> None:
    write_street(tmp_path)
    rows = query(
        tmp_path / "footprints.gpkg",
        "SELECT f_table_name, f_geometry_column, styleName, styleQML, useAsDefault FROM layer_styles",
    )
    named = {(table, style) for table, _, style, _, _ in rows}
    assert ("footprints", "Level of detail") in named and ("roof_planes", "Direction") in named
    assert sorted(table for table, *_, default in rows if default) == ["footprints", "roof_planes"]
    geometry = dict(query(tmp_path / "footprints.gpkg", "SELECT * FROM gpkg_geometry_columns")[:0]) or {
        "geom"
    }
    assert {row[1] for row in rows} == geometry
    assert all(ElementTree.fromstring(qml).find("renderer-v2") is not None for _, _, _, qml, _ in rows)


def test_columns_say_what_they_are_and_in_which_unit(tmp_path: Path) -> None:
    write_street(tmp_path)
    rows = query(
        tmp_path / "footprints.gpkg",
        "SELECT table_name, column_name, title, description FROM gpkg_data_columns",
    )
    titles = {(table, column): title for table, column, title, _ in rows}
    assert titles["footprints", "area_m2"] == "Area (m²)"
    assert titles["roof_planes", "slope_deg"] == "Slope (°)"
    assert query(tmp_path / "footprints.gpkg", "PRAGMA integrity_check") == [("ok",)]


def test_styles_without_columns_to_draw_are_left_out(tmp_path: Path) -> None:
    square = shapely.box(0, 0, 1, 1)
    write_geopackage(tmp_path / "a.gpkg", [Row(square, {"id": "a"})], [Row(square, {"building_id": "a"})])
    found = query(tmp_path / "a.gpkg", "SELECT f_table_name, styleName FROM layer_styles")
    assert sorted(found) == [("footprints", "Level of detail"), ("roof_planes", "Roof")]


def test_project_is_the_same_every_time_and_has_relative_paths(tmp_path: Path) -> None:
    path = write_street(tmp_path)
    first = path.read_bytes()
    assert write_street(tmp_path).read_bytes() == first
    with zipfile.ZipFile(path) as archive:
        root = ElementTree.fromstring(archive.read("buildings.qgs"))
    sources = [element.text or "" for element in root.iter("datasource")]
    assert len(sources) == 4 and all(source.startswith("./") for source in sources)
    assert all(len(element.text or "") > 10 for element in root.iterfind("projectlayers/maplayer/id"))
    assert root.find("mapViewDocks3D/view/qgis3d/terrain/generator") is not None
    assert root.findtext("properties/SpatialRefSys/ProjectionsEnabled") == "1"
    assert root.findtext("projectCrs/spatialrefsys/authid") == "EPSG:28992"


def test_every_style_has_its_column_in_the_layer() -> None:
    for layer in ("footprints", "roof_planes"):
        wanted = {style["needs"] for style in listed_styles()[layer]["styles"] if "needs" in style}
        assert wanted <= {*LAYERS["footprints"], "azimuth_deg"}, layer


def test_project_of_an_empty_run_is_written(tmp_path: Path) -> None:
    write_geopackage(tmp_path / "footprints.gpkg", [], [], LOCAL_METRES)
    write_project(tmp_path / "a.qgz", tmp_path / "footprints.gpkg", [], LOCAL_METRES)
    assert zipfile.is_zipfile(tmp_path / "a.qgz")


def test_units_are_those_of_the_system_also_where_the_data_are_already_converted() -> None:
    converted = CoordinateSystem(FEET.wkt)
    assert unit_lengths(converted) == unit_lengths(FEET) == (0.3048, 0.3048)


@pytest.fixture(scope="session")
def qgis() -> dict[str, str]:
    """The environment in which QGIS's Python runs without a screen."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    environment |= {"QT_QPA_PLATFORM": "offscreen", "XDG_RUNTIME_DIR": "/tmp"}
    command = [QGIS_PYTHON, "-c", "import qgis._3d"]
    there = Path(QGIS_PYTHON).exists()
    need_judge("QGIS", there and not subprocess.run(command, env=environment, capture_output=True).returncode)
    return environment


@pytest.mark.parametrize("theme", ["Map", pytest.param("Oblique (2.5D)", marks=pytest.mark.slow)])
def test_qgis_draws_the_project_in_its_colours(tmp_path: Path, qgis: dict[str, str], theme: str) -> None:
    path = write_street(tmp_path)
    script = Path(__file__).with_name("qgis_render.py")
    command = [QGIS_PYTHON, str(script), str(path), theme, str(tmp_path / "map.png")]
    done = subprocess.run(command, env=qgis, capture_output=True, text=True, timeout=120)
    line = next(line for line in done.stdout.splitlines() if line.startswith("found: "))
    found = json.loads(line.removeprefix("found: "))
    assert found["read"] and not found["errors"]
    layers = found["layers"]
    assert set(layers) == {"Roof planes", "Walls (3D view)", "Buildings", "Relief"}
    assert all(layer["valid"] and layer["crs"] == "EPSG:28992" for layer in layers.values())
    assert layers["Roof planes"]["3d"] and layers["Walls (3D view)"]["3d"]
    assert layers["Buildings"]["names"]["area_m2"] == "Area (m²)"
    assert "Oblique" in layers["Buildings"]["styles"]
    assert set(found["themes"]) == {"Map", "Oblique (2.5D)"}
    opened, renderer, attribute = found["default style"]
    assert opened and renderer == "QgsCategorizedSymbolRenderer" and "lod" in attribute
    assert "Level of detail" in found["styles in the file"]
    colours = set(found["colours"])
    if theme == "Map":
        drawn = {"roof_planes": ("east", "west", "flat"), "footprints": ("none",)}
        assert colours >= {
            one["fill"]
            for layer, values in drawn.items()
            for style in listed_styles()[layer]["styles"]
            for one in style.get("classes", ())
            if style["name"] in ("Direction", "Level of detail") and one.get("value") in values
        }
    else:
        assert {"#c8102e", "#f2c14e", "#d98c6a"} <= colours
