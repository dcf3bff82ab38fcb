"""What a run writes agrees with itself, as other libraries read it: the judges of the benchmark."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from tests.conftest import write_laz

from eaves.pipeline import build
from eaves.simulate.objects.houses import ExactScene

judges = pytest.importorskip("benchmarks.accuracy.judges")
pytestmark = pytest.mark.usefixtures("cjio")  # which the judges import
COLORADO = 950_000.0, 380_000.0, 1_600.0
"""A place (m) in EPSG:2231, whose unit is the US survey foot; heights are in it, too."""
FEET = "geometry in US survey feet, attributes in metres"


def test_files_of_a_clipped_run_at_lod_2_3_contradict_nothing(nine_roofs_file: Path, tmp_path: Path) -> None:
    bounds = 84960.0, 447120.0, 85010.0, 447200.0
    summary = build(nine_roofs_file, tmp_path, lod="2.3", bounds=bounds, formats=["cityjson", "geojson"])
    judged = judges.judge(tmp_path)
    assert dict(judged.wrong) == {} and summary.found and judged.compared["volumes"]
    assert "attributes in" not in summary.as_text() and set(summary.run["units"].values()) == {"metre"}


def test_files_of_a_survey_in_feet_contradict_nothing_and_name_their_units(
    nine_roofs: ExactScene, tmp_path: Path
) -> None:
    write_laz(tmp_path / "feet.laz", (nine_roofs.cloud.xyz + COLORADO) * 3937 / 1200, 2231)
    summary = build(tmp_path / "feet.laz", tmp_path / "out")
    judged = judges.judge(tmp_path / "out")
    assert dict(judged.wrong) == {} and judged.compared["volumes"]
    units = {"geometry": "US survey foot", "heights": "US survey foot", "attributes": "metre"}
    head = json.loads((tmp_path / "out" / "buildings.city.jsonl").read_text("utf-8").splitlines()[0])
    assert (
        json.loads((tmp_path / "out" / "run.json").read_text())["units"] == head["metadata"]["units"] == units
    )
    assert FEET in summary.as_text().splitlines()
    page = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert f"all lengths here in metres; in the files {FEET}" in page
    assert all(title in page for title in ("eaves above datum (m)", "height (m)"))
    with closing(sqlite3.connect(tmp_path / "out" / "footprints.gpkg")) as base:
        layers = dict(base.execute("SELECT table_name, description FROM gpkg_contents"))
        titles = base.execute("SELECT column_name, title FROM gpkg_data_columns").fetchall()
        columns = {row[1] for layer in layers for row in base.execute(f"PRAGMA table_info({layer})")}
    assert {layers[name] for name in ("footprints", "roof_planes")} == {FEET}
    measured = {
        name for name in columns if name.startswith("h_") or name.endswith(("_m", "_m2", "_m3", "Height"))
    }
    assert measured and measured == {
        name for name, title in titles if title.endswith(("(m)", "(m²)", "(m³)"))
    }
