"""Every output says which files its points are from, and what its heights are measured from."""

from __future__ import annotations

import json
import sqlite3
import struct
from contextlib import closing
from pathlib import Path

import laspy
import pytest
import rasterio
from tests.conftest import build_files

from eaves.flow.formats import places_of_formats
from eaves.formats.crs_check import vertical_datum
from eaves.model.coordinates import NOTHING_KNOWN, Provenance
from eaves.simulate import nine_roofs_on_a_slope, write_simulation


@pytest.fixture(scope="module", params=["EPSG:28992", "EPSG:7415"])
def results(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, Provenance]:
    """A run that writes all formats, and what is true of it."""
    place = tmp_path_factory.mktemp("all")
    truth = nine_roofs_on_a_slope(density=2.0).placed(request.param)
    points = write_simulation(truth, place / "in")["points"]
    formats = [name for name in places_of_formats() if name not in ("copc", "ifc")]
    build_files(points, place / "out", formats=formats)
    datum = vertical_datum(truth.cloud.system)
    return place / "out", Provenance((points.name,), 1, datum["name"], str(datum["status"]))


OTHERS = ("3dtiles", "buildings.mtl", "buildings.qgz", "review.csv")
"""Files that have no place for it, beside others that have."""


def test_every_output_names_its_sources_and_its_datum(results: tuple[Path, Provenance]) -> None:
    out, true = results
    for path in sorted(out.iterdir()):
        if path.name in OTHERS:
            continue
        assert says(path, true), path.name
    assert says(out / "3dtiles" / "tileset.json", true)


def says(path: Path, true: Provenance) -> bool:
    """Whether a file holds what is true of it, where files of its kind do."""
    if path.suffix == ".gpkg":
        with closing(sqlite3.connect(path)) as base:
            told = " ".join(row[0] for row in base.execute("SELECT metadata FROM gpkg_metadata"))
        return bool(json.loads(told) == true.members)
    if path.suffix == ".laz":
        with laspy.open(path) as file:
            records = file.header.vlrs.get_by_id("eaves")
        return bool(json.loads(records[0].record_data) == true.members)
    if path.suffix == ".tif":
        with rasterio.open(path) as image:
            return true.tags.items() <= image.tags().items()
    if path.suffix == ".parquet":
        import pyarrow.parquet

        known = pyarrow.parquet.read_schema(path).metadata
        return {key.encode(): text.encode() for key, text in true.tags.items()}.items() <= known.items()
    if path.name in ("buildings.city.jsonl", "buildings.city.json"):
        first = json.loads(path.read_text(encoding="utf-8").splitlines()[0])
        return bool(true.members.items() <= first["metadata"].items())
    if path.name == "tileset.json":
        return bool(true.members.items() <= json.loads(path.read_text())["asset"]["extras"].items())
    if path.suffix == ".glb":
        data = path.read_bytes()
        (length,) = struct.unpack_from("<I", data, 12)
        return bool(true.members.items() <= json.loads(data[20 : 20 + length])["asset"]["extras"].items())
    if path.name == "run.json":
        run = json.loads(path.read_text())
        mine = {"status": true.datum_status, "name": true.datum}
        return Path(run["inputs"][0]["path"]).name == true.sources[0] and run["vertical_datum"] == mine
    return true.sentence.encode() in path.read_bytes()


def test_a_name_cannot_break_a_line(tmp_path: Path) -> None:
    assert "\n" not in Provenance(("a\nv 1 2 3.laz",), 1).sentence
    assert NOTHING_KNOWN.sentence == "" and not NOTHING_KNOWN.tags and not NOTHING_KNOWN.members


def test_of_many_files_the_first_are_named_and_all_counted() -> None:
    many = Provenance(("a.laz", "b.laz"), 7, "NAP height", "known")
    assert many.sentence == "points of a.laz, b.laz and 5 more; vertical datum: NAP height, known"
