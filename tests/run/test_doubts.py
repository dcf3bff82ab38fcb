"""Doubts reach the file of the block that they lie in, and from there all that tells of a run, once each."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import laspy
import numpy as np
import pytest
import shapely
from tests.conftest import build_in_blocks

from eaves.blocks.block import block_pass
from eaves.blocks.block_file import BlockFile, block_arrays
from eaves.blocks.ground import Surroundings
from eaves.detect.stage import OBJECT
from eaves.figures.rows import BuildingRow
from eaves.flow.results import LAYER, describe_doubts, distinct_doubts, doubt_row, face_doubts, objects_remark
from eaves.formats.vectors.polygons import read_polygons
from eaves.ground import classify_ground
from eaves.model import Block
from eaves.model.scene import Doubt
from eaves.model.summary import Summary
from eaves.recipe.recipe import make_recipe
from eaves.report.view import describe_run
from eaves.run.store import Store, save_part
from eaves.simulate import nine_roofs_on_a_slope, write_simulation

build = partial(build_in_blocks, 60.0)


def test_a_doubt_is_kept_by_the_block_it_lies_in(tmp_path: Path) -> None:
    truth = nine_roofs_on_a_slope(density=4.0)
    middle = truth.cloud.xyz[:, 0].mean()
    cut = truth.cloud.take(truth.cloud.xyz[:, 0] < middle)  # the rim of the data runs through three roofs
    block = Block.at(*cut.origin, 240.0)
    result = block_pass(classify_ground(cut), Surroundings(block), make_recipe())
    assert {doubt.stage for doubt in result.doubts} == {"detect"}
    assert any("rim of the data" in doubt.reason for doubt in result.doubts)
    save_part(tmp_path / "block.part", block_arrays(result))
    found = BlockFile(tmp_path / "block.part", block, Store(tmp_path).read_points).metadata().doubts
    for read, written in zip(found, result.doubts, strict=True):
        assert read.x == pytest.approx(written.x)
        assert read.reason == written.reason


@pytest.fixture(scope="module")
def cut_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The nine roofs in world coordinates, where the rim of the data runs through three of them."""
    folder = tmp_path_factory.mktemp("cut")
    las = laspy.read(write_simulation(nine_roofs_on_a_slope(density=4.0), folder)["points"])
    las.points = las.points[las.x < las.x.min() + 0.5 * (las.x.max() - las.x.min())]
    las.write(folder / "cut.laz")
    return folder / "cut.laz"


def layer_of(folder: Path) -> list[tuple[object, ...]]:
    polygons, _, rows, _ = read_polygons(folder / "footprints.gpkg", layer="doubts")
    return [
        (row["stage"], row["reason"], row["area_m2"], *np.round(polygon.bounds, 2))
        for polygon, row in zip(polygons, rows, strict=True)
    ]


@pytest.mark.slow
def test_doubts_are_told_in_all_files_and_once_also_by_tiles(cut_file: Path, tmp_path: Path) -> None:
    whole = build(cut_file, tmp_path / "whole")
    told = json.loads((tmp_path / "whole" / "run.json").read_text())["doubts"]
    found = layer_of(tmp_path / "whole")
    assert told["count"] == len(found) == sum(kind["count"] for kind in told["kinds"]) > 0
    assert {kind["reason"] for kind in told["kinds"]} <= {row[1] for row in found}
    assert any("rim of the data" in str(row[1]) for row in found)
    line = f"doubts: {len(found)} of {len(told['kinds'])} kinds, see the layer doubts of footprints.gpkg"
    assert line in whole.as_text().splitlines()
    assert line in describe_run(tmp_path / "whole")
    tiled = build(cut_file, tmp_path / "tiled", per_tile=True)
    assert layer_of(tmp_path / "tiled") == found
    assert tiled.run["doubts"] == whole.run["doubts"]
    assert line in tiled.as_text()


def test_a_run_without_doubts_says_nothing_of_them() -> None:
    assert distinct_doubts([], 240.0) == []
    assert describe_doubts([], 1.0, LAYER)["count"] == 0


def test_what_two_blocks_doubt_is_told_once() -> None:
    large = Doubt(235.0, 100.0, 900.0, "a roof or not: score 0.50", "detect")
    same = Doubt(245.0, 100.0, 800.0, "a roof or not: score 0.40", "detect")
    other_kind = replace(same, reason="a building on the rim of the data")
    assert distinct_doubts([same, large, other_kind], 240.0) == [large, other_kind]
    assert distinct_doubts([large, other_kind, same], 240.0) == [large, other_kind]


def test_what_is_read_has_a_line_a_kind_and_the_layer_every_place() -> None:
    large = Doubt(35.0, 100.0, 900.0, "a roof or not: score 0.50", "detect")
    small = Doubt(36.0, 100.0, 80.0, "a roof or not: score 0.40", "detect")
    other = replace(small, area_m2=950.0, reason="a building on the rim of the data")
    found = distinct_doubts([small, large, other], 240.0)
    assert found == [other, large, small]
    first, second = describe_doubts(found, 1.0, LAYER)["kinds"]
    assert (first["count"], first["area_m2"], first["reason"], first["x"]) == (2, 980.0, large.reason, 35.0)
    assert (second["count"], second["area_m2"], second["reason"]) == (1, 950.0, other.reason)


def test_more_objects_than_buildings_are_said_with_their_number_and_the_largest() -> None:
    places = [Doubt(10.0 * k, 5.0, 30.0 + k, f"{OBJECT}: its top is rough", "detect") for k in range(3)]
    line = objects_remark([*places, Doubt(1.0, 1.0, 99.0, "a plateau", "ground")], 2, 1.0, LAYER)
    assert line is not None
    assert line.startswith("3 objects of 30 to 200 m²") and "at 20.0, 5.0, its top is rough" in line
    assert objects_remark(places, 3, 1.0, LAYER) is None


def test_places_are_in_the_unit_of_the_reference_system() -> None:
    doubt = Doubt(304.8, 609.6, 100.0, "a terrace or a roof", "ground")
    told = describe_doubts([doubt], 0.3048, LAYER)
    assert (told["kinds"][0]["x"], told["kinds"][0]["y"]) == (1000.0, 2000.0)
    assert told["kinds"][0]["stage"] == "ground"
    square = doubt_row(doubt).geometry
    assert square is not None and square.area == pytest.approx(100.0)


def test_without_a_file_that_tells_them_the_closing_lines_do(tmp_path: Path) -> None:
    doubt = Doubt(10.0, 20.0, 700.0, "a plateau", "ground")
    told = describe_doubts([doubt], 1.0, "")
    summary = Summary(tmp_path, 1, 0, 0, {}, {}, {}, {}, 1.0, (), run={"doubts": told})
    assert "doubts: 1, the largest at 10.0, 20.0: a plateau" in summary.as_text()


def face(side: float, **told: object) -> tuple[shapely.Polygon, dict[str, object]]:
    return shapely.box(100.0, 200.0, 100.0 + side, 200.0 + side), {"projected_m2": side * side, **told}


def test_a_large_face_that_its_points_do_not_support_is_a_doubt_and_a_small_one_is_not() -> None:
    faces = [
        face(4.0, weak="30% of its points within 0.2 m, RMSE 0.61 m", no_data=False),
        face(6.0, weak="70% of its plan without points", no_data=True),
        face(2.0, weak="2 points", no_data=True),
        face(9.0, weak=None, no_data=False),
    ]
    row = BuildingRow(faces[0][0], {}, {}, faces, True, None, {})
    scattered, hole = face_doubts([row])
    assert scattered.reason == "a face whose points scatter: 30% of its points within 0.2 m, RMSE 0.61 m"
    assert (scattered.x, scattered.y, scattered.area_m2, scattered.stage) == (102.0, 202.0, 16.0, "roof")
    assert hole.reason == "a hole where a roof should be: 70% of its plan without points"
    assert len(distinct_doubts([scattered, hole], 240.0)) == 2
