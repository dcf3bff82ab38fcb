"""The flow from points to models on nine exact roofs, and its independence of blocks and files."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
import shapely

import eaves
from eaves import IncompleteRunError
from eaves.formats import write_cityjson
from eaves.pipeline import build
from eaves.simulate.objects.houses import ExactScene
from tests.conftest import build_in_blocks, write_laz
from tests.run.test_long_buildings import footprints


@pytest.fixture(scope="module")
def whole(nine_roofs_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("whole")
    assert build(nine_roofs_file, out).complete
    return out


def test_all_nine_roofs_are_found_where_they_are(whole: Path, nine_roofs: ExactScene) -> None:
    found = list(footprints(whole).values())
    shift = np.array([85000.0 - 85000.0 % 240, 447120.0])
    for building in nine_roofs.buildings:
        truth = shapely.transform(building.footprint, lambda xy: xy + shift)
        overlap = max(truth.intersection(one).area / truth.union(one).area for one in found)
        assert overlap > 0.85, building.kind


@pytest.mark.slow
def test_files_cut_elsewhere_and_points_shuffled_change_nothing(
    whole: Path, nine_roofs_file: Path, tmp_path: Path
) -> None:
    las = laspy.read(nine_roofs_file)
    xyz = np.column_stack([las.x, las.y, las.z])
    order = np.random.default_rng(9).permutation(len(xyz))
    parts = np.array_split(order, 3)
    for number, part in enumerate(parts):
        write_laz(tmp_path / f"part{number}.laz", xyz[part])
    assert build(tmp_path, tmp_path / "out").complete
    expected, got = footprints(whole), footprints(tmp_path / "out")
    assert expected.keys() == got.keys()
    assert all(expected[name].equals_exact(got[name], 1e-9) for name in expected)
    texts = [(out / "buildings.city.jsonl").read_text() for out in (whole, tmp_path / "out")]
    (first, models), (other, same_models) = (text.split("\n", 1) for text in texts)
    assert models == same_models
    heads = [json.loads(line) for line in (first, other)]
    for head in heads:  # which name the files
        assert head["metadata"].pop("pointSources")
        assert head["metadata"].pop("pointSourceCount") in (1, 3)
    assert heads[0] == heads[1]


@pytest.fixture(scope="module")
def in_small_blocks(nine_roofs_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("blocks")
    assert build_in_blocks(30.0, nine_roofs_file, folder).complete
    return folder


def test_small_blocks_leave_no_seam(whole: Path, in_small_blocks: Path) -> None:
    expected, got = list(footprints(whole).values()), list(footprints(in_small_blocks).values())
    assert len(expected) == len(got)
    for polygon in expected:
        overlap = max(polygon.intersection(one).area / polygon.union(one).area for one in got)
        assert overlap > 0.95


def test_processes_give_what_one_process_gives(
    in_small_blocks: Path, nine_roofs_file: Path, tmp_path: Path
) -> None:
    build_in_blocks(30.0, nine_roofs_file, tmp_path, jobs=2)
    one, two = footprints(in_small_blocks), footprints(tmp_path)
    assert one.keys() == two.keys()
    assert all(one[name].equals(two[name]) for name in one)


def test_resume_does_not_compute_what_is_done(
    nine_roofs_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from eaves import pipeline
    from eaves.blocks import block

    monkeypatch.setattr(pipeline, "write_outputs", lambda *args, **kwargs: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        pipeline.build(nine_roofs_file, tmp_path)
    monkeypatch.undo()
    monkeypatch.setattr(block, "block_pass", lambda *args: 1 / 0)
    assert pipeline.build(nine_roofs_file, tmp_path, resume=True).complete
    with pytest.raises(IncompleteRunError, match=r"ZeroDivisionError.*allow_failures=True") as raised:
        pipeline.build(nine_roofs_file, tmp_path)
    assert not raised.value.results.complete
    summary = pipeline.build(nine_roofs_file, tmp_path, allow_failures=True)
    assert "ZeroDivisionError" in summary.failed[0]


def test_a_broken_building_keeps_the_others(
    nine_roofs_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from eaves import pipeline
    from eaves.buildings import owned

    real, seen = owned.building_pass, []

    def fails_once(*words: Any) -> object:
        seen.append(1)
        if len(seen) == 2:
            raise RuntimeError("on purpose")
        return real(*words)

    monkeypatch.setattr(owned, "building_pass", fails_once)
    summary = pipeline.build(nine_roofs_file, tmp_path)
    assert summary.found == 9
    assert summary.failures == {"internal_error": 1}


def test_the_stage_functions_make_the_same_flow(nine_roofs: ExactScene) -> None:
    classified = eaves.classify_ground(nine_roofs.cloud)
    scene = eaves.make_scene(classified, classified.bounds.buffered(5.0))
    regions = eaves.detect_buildings(scene)
    assert regions.count == 9
    points = nine_roofs.cloud.xyz[regions.mask_of(1)]
    boundary = eaves.trace_outline(points, scene.spacing)
    footprint = eaves.regularise_outlines([boundary])[0]
    planes = eaves.segment_roof(points, scene.spacing)
    model = eaves.reconstruct_building(points, footprint, planes, 0.0)
    assert model
    assert eaves.validate_model(model) == []


def test_without_a_building_the_tables_have_their_columns(whole: Path, tmp_path: Path) -> None:
    x, y = (side.ravel() for side in np.mgrid[0:40:0.7, 0:40:0.7])
    write_laz(tmp_path / "field.laz", np.column_stack([x + 85000.0, y + 447120.0, 0.02 * x]))
    summary = build(tmp_path / "field.laz", tmp_path / "out")
    assert summary.found == 0
    for layer in ("footprints", "roof_planes"):
        full, empty = (columns_of(out / "footprints.gpkg", layer) for out in (whole, tmp_path / "out"))
        assert full == empty, layer
    assert len(full) > 10


def columns_of(path: Path, layer: str) -> list[tuple[str, str]]:
    """Names and types of a layer's columns; geometries have one dimension more where there is one."""
    with closing(sqlite3.connect(path)) as base:
        found = base.execute(f"PRAGMA table_info({layer})").fetchall()
    return [(row[1], row[2]) for row in found if row[1] != "geom"]


def test_a_region_modelled_in_python_is_written_where_it_stands(
    nine_roofs_file: Path, tmp_path: Path
) -> None:
    cloud = eaves.classify_ground(eaves.read(nine_roofs_file))
    regions = eaves.detect_buildings(eaves.make_scene(cloud, cloud.bounds))
    points = cloud.xyz[regions.label == 1]
    boundary = eaves.trace_outline(points, 0.4, origin=cloud.origin)
    (footprint,) = eaves.regularise_outlines([boundary])
    planes = eaves.segment_roof(points, 0.4)
    models = [eaves.reconstruct_building(points, one, planes, points[:, 2].min() - 5) for one in (footprint,)]
    write_cityjson(tmp_path / "one.city.json", models)
    written = json.loads((tmp_path / "one.city.json").read_text("utf-8"))
    corners = (
        np.array(written["vertices"]) * written["transform"]["scale"] + written["transform"]["translate"]
    )
    assert np.abs(corners[:, :2].mean(axis=0) - cloud.origin - points[:, :2].mean(axis=0)).max() < 5.0
    failure = eaves.Failure("no_area", "no outline")
    assert eaves.reconstruct_building(points, failure, planes, 0.0) is failure
