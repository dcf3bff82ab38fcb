"""A header that puts its file elsewhere costs one warning, and no point."""

from __future__ import annotations

import logging
import struct
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from tests.conftest import build_in_blocks, write_laz

from eaves.flow.tiles import plan_tiles
from eaves.run.index import index_inputs
from eaves.simulate.objects.houses import ExactScene

build = partial(build_in_blocks, 60.0)

PLACE = np.array([84960.0, 447120.0, 0.0])
BOX = 179
"""Where a LAS header states the largest x, the smallest x, the largest y, … (LAS 1.4, table 3)."""


def halves(scene: ExactScene, folder: Path) -> list[Path]:
    """The scene in two files, each beginning with its western points; the second's header is cut short."""
    xyz = scene.cloud.xyz[np.argsort(scene.cloud.xyz[:, 0], kind="stable")] + PLACE
    paths = [folder / "a.laz", folder / "b.laz"]
    for path, part in zip(paths, np.array_split(xyz, 2), strict=True):
        write_laz(path, part)
    state(paths[1], BOX, float(np.array_split(xyz, 2)[1][0, 0]) + 0.5)
    return paths


def state(path: Path, place: int, value: float) -> None:
    """Let a header say something else."""
    data = bytearray(path.read_bytes())
    struct.pack_into("<d", data, place, value)
    path.write_bytes(data)


def test_points_outside_the_box_are_used_where_they_are(
    nine_roofs: ExactScene, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "in").mkdir()
    halves(nine_roofs, tmp_path / "in")
    with caplog.at_level(logging.WARNING, "eaves"):
        assert build(tmp_path / "in", tmp_path / "tiled", per_tile=True).found == 9
    told = [record.message for record in caplog.records if "bounding box" in record.message]
    assert len(told) == 1
    assert "b.laz" in told[0]


@pytest.mark.slow
def test_tiles_give_the_models_of_one_piece_where_a_box_is_wrong(
    nine_roofs: ExactScene, tmp_path: Path
) -> None:
    (tmp_path / "in").mkdir()
    halves(nine_roofs, tmp_path / "in")
    assert build(tmp_path / "in", tmp_path / "tiled", per_tile=True).complete
    assert build(tmp_path / "in", tmp_path / "whole").found == 9
    models = [tmp_path / name / "buildings.city.jsonl" for name in ("whole", "tiled")]
    assert models[0].read_bytes() == models[1].read_bytes()


def test_a_box_without_the_first_point_is_measured(
    nine_roofs: ExactScene, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    paths = halves(nine_roofs, tmp_path)
    state(paths[0], BOX + 8, PLACE[0] + 50.0)
    truth = nine_roofs.cloud.xyz[:, 0].min() + PLACE[0]
    with caplog.at_level(logging.WARNING, "eaves"):
        index = index_inputs(paths, None, [])
    assert index.entries["box"][0][0] == pytest.approx(truth, abs=0.01)
    assert sum("bounding box" in record.message for record in caplog.records) == 1


def test_a_box_as_large_as_a_country_does_not_plan_a_country(nine_roofs: ExactScene, tmp_path: Path) -> None:
    paths = halves(nine_roofs, tmp_path)
    state(paths[1], BOX, PLACE[0] + 1_000_000.0)
    assert len(plan_tiles(index_inputs(paths, None, []), 3840.0)) <= 4
