"""The page and what goes into it, without a browser."""

from __future__ import annotations

import base64
import csv
import json
import re
import zlib
from pathlib import Path

import numpy as np
import pyogrio.raw
import pytest

from eaves.flow import formats
from eaves.formats import Format, InputError
from eaves.model.summary import IncompleteRunError, Summary
from eaves.pipeline import build
from eaves.report import output, sample
from eaves.report.contents import SURFACES, UNKNOWN_ERROR, read_contents
from eaves.report.output import iter_arrays, iter_page
from eaves.report.sample import PointSample
from eaves.report.view import open_report

from ..conftest import build_in_blocks, write_laz

PIECE = 50_000
"""Points that LASzip compresses together."""


def data_of(page: Path) -> dict:
    return data_of_text(page.read_text(encoding="utf-8"))


def data_of_text(text: str) -> dict:
    found = re.search(r'id="data">(.*?)</script>', text, re.S)
    assert found
    return json.loads(found[1])


def unpacked(packed: dict) -> np.ndarray:
    planes = np.frombuffer(zlib.decompress(base64.b64decode(packed["data"])), np.uint8)
    kind = np.dtype(packed["type"])
    return np.ascontiguousarray(planes.reshape(kind.itemsize, -1).T).view(kind).ravel()


def test_the_page_holds_every_building_and_asks_for_no_network(nine_run: Summary) -> None:
    page = nine_run.folder / "report.html"
    text = page.read_text(encoding="utf-8")
    assert not re.search(r'(src|href)="(https?:)?//', text)
    data = data_of(page)
    assert len(data["rows"]) == nine_run.found
    arrays = data["arrays"]
    assert set(unpacked(arrays["outline_building"])) == set(range(1, nine_run.found + 1))
    contents = read_contents(nine_run.folder)
    assert np.array_equal(unpacked(arrays["point_xyz"]), dict(iter_arrays(contents))["point_xyz"].ravel())


def test_every_roof_face_has_its_own_error(nine_run: Summary) -> None:
    arrays = dict(iter_arrays(read_contents(nine_run.folder)))
    finest = arrays["triangle_lod"] == arrays["triangle_lod"].max()
    roof = finest & (arrays["triangle_kind"] == SURFACES.index("RoofSurface"))
    errors = arrays["triangle_error"][roof]
    assert (errors != UNKNOWN_ERROR).all() and len(set(errors)) > 5
    assert np.median(errors) < 30  # mm; the scan's noise is 20
    assert (arrays["triangle_error"][finest & ~roof] == UNKNOWN_ERROR).all()


def test_the_review_of_a_run_says_the_same_in_layer_and_table(nine_run: Summary) -> None:
    with (nine_run.folder / "review.csv").open(newline="", encoding="utf-8") as file:
        table = [(row["id"], row["link"]) for row in csv.DictReader(file)]
    layer: list[tuple[str, str]] = []
    if "review" in pyogrio.list_layers(nine_run.folder / "footprints.gpkg")[:, 0]:
        read = pyogrio.raw.read(nine_run.folder / "footprints.gpkg", layer="review", columns=["id", "link"])
        layer = list(zip(*(column.tolist() for column in read[3]), strict=True))
    assert table == layer


def test_roof_points_lie_on_the_models(nine_run: Summary) -> None:
    contents = read_contents(nine_run.folder)
    known = contents.distance[np.isfinite(contents.distance)]
    assert len(known) > 1000
    assert np.median(np.abs(known)) < 0.05


def test_more_points_than_wanted_are_thinned_and_the_page_states_it(nine_run: Summary) -> None:
    contents = read_contents(nine_run.folder, points=2000, buildings=3)
    assert len(contents.points) < 6000, "points of neighbours come on top"
    assert len(contents.rows) == 3
    text = "".join(iter_page(contents, "summary"))
    assert f"{len(contents.points):,} of {contents.points.total:,} points drawn" in text
    assert f"3 of {nine_run.found} buildings, those nearest to the middle" in text
    table = data_of_text(text)["others"]
    listed = json.loads(zlib.decompress(base64.b64decode(table["data"])))
    assert len(listed[table["names"].index("id")]) == nine_run.found - 3, "the table lists those not drawn"
    again = read_contents(nine_run.folder, points=2000, buildings=3)
    assert np.array_equal(contents.points.xyz, again.points.xyz)


@pytest.mark.slow
def test_the_points_received_while_writing_are_those_read_afterwards(
    nine_roofs_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for limit, jobs in ((2000, 2), (10_000_000, 1)):
        received = PointSample(limit, 1000)
        build_in_blocks(60.0, nine_roofs_file, tmp_path, jobs=jobs, sink=received, overwrite=True)
        read = read_contents(tmp_path, points=limit).points
        assert len(read) > 0 and (len(read) < 6000) == (limit == 2000)
        with monkeypatch.context() as patched:
            patched.setattr(sample, "_records", None)
            known = read_contents(tmp_path, points=limit, received=received).points
        for name, value in vars(read).items():
            assert np.array_equal(getattr(known, name), value), name
    other = read_contents(tmp_path, points=3000, received=received).points
    assert len(other) < 6000, "what was received for another page is not used"


def test_a_page_is_made_around_a_building(nine_run: Summary) -> None:
    ids = [row["id"] for row in read_contents(nine_run.folder).rows]
    for name in (ids[0], ids[-1]):
        assert name in {row["id"] for row in read_contents(nine_run.folder, buildings=2, around=name).rows}
    with pytest.raises(InputError, match="nowhere"):
        read_contents(nine_run.folder, around="nowhere")


def test_one_point_and_no_building_give_a_page(tmp_path: Path) -> None:
    write_laz(tmp_path / "one.laz", np.array([[85000.0, 447000.0, 3.0]]))
    summary = build(tmp_path / "one.laz", tmp_path / "out")
    assert summary.found == 0
    assert data_of(tmp_path / "out" / "report.html")["rows"] == []


def test_a_missing_page_is_made__a_folder_without_a_run_is_refused(nine_run: Summary, tmp_path: Path) -> None:
    (nine_run.folder / "report.html").unlink()
    page = open_report(nine_run.folder, show=False)
    assert "buildings found" in page.read_text(encoding="utf-8")
    with pytest.raises(InputError, match=r"footprints\.gpkg"):
        open_report(tmp_path, show=False)


def sorted_ground(path: Path) -> Path:
    """Two pieces of points of level ground, from west to east."""
    rng = np.random.default_rng(4)
    x = np.sort(rng.uniform(0.0, 100.0, PIECE + 5_000))
    y, z = rng.uniform(0.0, 40.0, len(x)), rng.normal(10.0, 0.02, len(x))
    write_laz(path, np.column_stack([x + 85000.0, y + 447000.0, z]))
    return path


@pytest.mark.parametrize("sides", [(85000.0, 85020.0), (85095.0, 85100.0)])
def test_bounds_that_no_point_of_a_piece_lies_in_give_a_page(
    sides: tuple[float, float], tmp_path: Path
) -> None:
    points = sorted_ground(tmp_path / "ground.laz")
    bounds = (sides[0], 447000.0, sides[1], 447040.0)
    results = build(points, tmp_path / "out", jobs=1, bounds=bounds)
    assert results.complete and 0 < results.points_used < PIECE
    assert (tmp_path / "out" / "report.html").exists()


def test_a_page_or_a_format_that_fails_is_named__the_other_files_stand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*words: object, **named: object) -> None:
        raise ZeroDivisionError("by nought")

    monkeypatch.setattr(output, "write_page", fail)
    broken = Format({"footprints": ("footprints.kml", fail)})
    monkeypatch.setattr(
        formats, "format_of", lambda name, known=formats.format_of: broken if name == "kml" else known(name)
    )
    out = tmp_path / "out"
    with pytest.raises(IncompleteRunError) as error:
        build(sorted_ground(tmp_path / "ground.laz"), out, jobs=1, formats=("kml", "fgb"))
    assert [reason.split(":")[0] for reason in error.value.failed] == ["footprints.kml", "report.html"]
    assert json.loads((out / "run.json").read_text())["incomplete"] == list(error.value.failed)
    assert {"footprints.gpkg", "footprints.fgb", "dtm.tif"} <= {path.name for path in out.iterdir()}


def test_an_output_that_fails_costs_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*words: object) -> None:
        raise ZeroDivisionError("by nought")

    monkeypatch.setattr("eaves.flow.outputs.write_surfaces", fail)
    with pytest.raises(IncompleteRunError, match="rasters: not written"):
        build(sorted_ground(tmp_path / "ground.laz"), tmp_path / "out", jobs=1)
    assert (tmp_path / "out" / "footprints.gpkg").exists()
