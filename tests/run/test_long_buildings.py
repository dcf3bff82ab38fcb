"""A row of houses and a hall longer than a block come out once and whole, however the run is cut."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely
from tests.conftest import build_in_blocks, write_laz
from tests.run.test_tiles import contents

BLOCK = 48.0
SIDE = BLOCK * 5
PLACE = np.array([84960.0, 447120.0, 0.0])
"""A corner of blocks, so that the places below are places in blocks."""
HALL, ROW = (60.0, 70.0), (65.0, 150.0)
"""South-west corners of the hall and of the row, which cross three blocks, and tiles of two blocks."""
HOUSES, FRONTAGE, DEPTH = 18, 6.0, 9.0


@pytest.fixture(scope="module")
def points(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The scene as one file: a hall of 110 by 30 m, and a row of 18 houses, 108 m long."""
    path = tmp_path_factory.mktemp("long") / "long.laz"
    write_laz(path, scene() + PLACE)
    return path


def scene() -> np.ndarray:
    """Points (N, 3) of both buildings on level ground, 4 a square metre, with 2 cm of noise."""
    rng = np.random.default_rng(4)
    xyz = np.column_stack([rng.uniform(0, SIDE, (int(4 * SIDE * SIDE), 2)), np.zeros(int(4 * SIDE * SIDE))])
    x, y = xyz[:, 0] - HALL[0], xyz[:, 1] - HALL[1]
    hall = (x >= 0) & (x < 110) & (y >= 0) & (y < 30)
    xyz[hall, 2] = 9.0
    x, y = xyz[:, 0] - ROW[0], xyz[:, 1] - ROW[1]
    row = (x >= 0) & (x < HOUSES * FRONTAGE) & (y >= 0) & (y < DEPTH)
    xyz[row, 2] = 5.0 + 0.8 * (DEPTH / 2 - np.abs(y[row] - DEPTH / 2))
    xyz[:, 2] += rng.normal(0, 0.02, len(xyz))
    return xyz


def footprints(folder: Path) -> dict[str, shapely.Polygon]:
    meta, _, geometry, fields = pyogrio.raw.read(folder / "footprints.gpkg", layer="footprints")
    ids = fields[list(meta["fields"]).index("id")]
    return dict(zip(ids, shapely.from_wkb(geometry), strict=True))


def features(paths: list[Path]) -> dict[str, object]:
    """Vertices (whole millimetres in the world) and city objects of all buildings, by id."""
    found: dict[str, object] = {}
    for path in paths:
        frame, *lines = map(json.loads, path.read_text(encoding="utf-8").splitlines())
        scale, start = (np.array(frame["transform"][name]) for name in ("scale", "translate"))
        for line in lines:
            vertices = np.round(np.array(line["vertices"]) + start / scale).astype(int).tolist()
            found[line["id"]] = (vertices, line["CityObjects"])
    return found


@pytest.fixture(scope="module")
def whole(points: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("whole")
    assert build_in_blocks(BLOCK, points, out).complete
    return out


def test_a_hall_and_a_row_longer_than_two_blocks_come_out_once_and_whole(whole: Path) -> None:
    found = list(footprints(whole).values())
    assert len(found) == 2
    hall = shapely.box(*HALL, HALL[0] + 110, HALL[1] + 30)
    row = shapely.box(*ROW, ROW[0] + HOUSES * FRONTAGE, ROW[1] + DEPTH)
    for truth in (hall, row):
        placed = shapely.transform(truth, lambda xy: xy + PLACE[:2])
        overlap = [placed.intersection(one).area / placed.union(one).area for one in found]
        assert max(overlap) > 0.93


@pytest.mark.slow
def test_blocks_larger_than_the_buildings_find_the_same_two(
    points: Path, whole: Path, tmp_path: Path
) -> None:
    assert build_in_blocks(SIDE, points, tmp_path).complete
    one, other = footprints(whole).values(), footprints(tmp_path).values()
    assert len(other) == 2
    for polygon in one:
        assert max(polygon.intersection(p).area / polygon.union(p).area for p in other) > 0.97


@pytest.mark.slow  # tests/run/test_tiles.py holds the same law on smaller scenes
def test_tile_by_tile_gives_what_the_whole_run_gives(points: Path, tmp_path: Path) -> None:
    outputs = ("footprints", "models", "rasters", "mask")
    build_in_blocks(BLOCK, points, tmp_path / "whole", outputs=outputs)
    build_in_blocks(BLOCK, points, tmp_path / "tiled", outputs=outputs, per_tile=True, tile_blocks=2)
    assert contents(tmp_path / "tiled") == contents(tmp_path / "whole")
