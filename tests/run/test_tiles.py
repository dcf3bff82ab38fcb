"""Tiles: given footprints, what a second run keeps, and what a failing tile leaves to the others."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import laspy
import numpy as np
import pytest
import rasterio
import shapely
from rasterio.windows import from_bounds
from tests.conftest import build_in_blocks
from tests.run.test_long_buildings import features

from eaves import pipeline
from eaves.flow import tiles
from eaves.formats.vectors.geopackage import Row, write_geopackage
from eaves.model import CoordinateSystem
from eaves.simulate.objects.roofs import ExactScene

build = partial(build_in_blocks, 60.0)

PLACE = np.array([84960.0, 447120.0])


@pytest.fixture
def small_tiles(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tiles, "TILE_BLOCKS", 1)


def of_tiles(folder: Path) -> dict[str, object]:
    return features(sorted((folder / "tiles").glob("*/buildings.city.jsonl")))


@pytest.mark.usefixtures("small_tiles")
def test_given_footprints_are_modelled_once_each__by_tiles_and_whole_on_the_border_of_two_files(
    nine_roofs: ExactScene, nine_roofs_file: Path, tmp_path: Path
) -> None:
    polygons = [shapely.transform(one.footprint, lambda xy: xy + PLACE) for one in nine_roofs.buildings]
    rows = [Row(polygon, {"name": f"house {k}"}) for k, polygon in enumerate(polygons)]
    write_geopackage(tmp_path / "given.gpkg", rows, (), CoordinateSystem())
    las = laspy.read(nine_roofs_file)
    east = las.x >= polygons[4].centroid.x
    halves = [tmp_path / "east.laz", tmp_path / "west.laz"]
    for path, which in zip(halves, (east, ~east), strict=True):
        part = laspy.LasData(las.header)
        part.points = las.points[which]
        part.write(path)
    options = {"footprints": tmp_path / "given.gpkg", "id_field": "name"}
    assert build(nine_roofs_file, tmp_path / "whole", **options).found == 9
    assert build(nine_roofs_file, tmp_path / "tiled", **options, per_tile=True).found == 9
    build(halves, tmp_path / "cut", **options)
    whole, cut = (features([tmp_path / name / "buildings.city.jsonl"]) for name in ("whole", "cut"))
    assert whole == cut == of_tiles(tmp_path / "tiled")


@pytest.mark.usefixtures("small_tiles")
def test_a_second_run_computes_only_the_tile_that_failed(
    nine_roofs_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, calls = pipeline.write_outputs, []

    def fails_once(*words: object, **named: object) -> object:
        calls.append(1)
        if len(calls) == 2:
            raise RuntimeError("on purpose")
        return real(*words, **named)  # type: ignore[arg-type]

    monkeypatch.setattr(pipeline, "write_outputs", fails_once)
    options = dict(per_tile=True, resume=True, outputs=("models",))
    first = build(nine_roofs_file, tmp_path, allow_failures=True, **options)
    assert not first.complete
    assert "on purpose" in first.failed[0]
    made = len(calls)
    second = build(nine_roofs_file, tmp_path, **options)
    assert second.complete
    assert len(calls) == made + 1
    assert second.found == 9


@pytest.mark.usefixtures("small_tiles")
def test_the_mask_of_a_house_across_the_border_of_two_tiles_is_that_of_one_piece(
    nine_roofs: ExactScene, nine_roofs_file: Path, tmp_path: Path
) -> None:
    las = laspy.read(nine_roofs_file)
    las.x = np.asarray(las.x) - nine_roofs.buildings[4].footprint.centroid.x  # the border runs through it
    las.write(tmp_path / "moved.laz")
    wanted = ("footprints", "models", "rasters", "mask")
    build(tmp_path / "moved.laz", tmp_path / "whole", outputs=wanted)
    build(tmp_path / "moved.laz", tmp_path / "tiled", outputs=wanted, per_tile=True)
    with rasterio.open(tmp_path / "whole" / "mask.tif") as whole:
        seen = np.zeros(whole.shape, np.uint8)
        for path in (tmp_path / "tiled" / "tiles").glob("*/mask.tif"):
            with rasterio.open(path) as tile:
                window = from_bounds(*tile.bounds, transform=whole.transform).round_offsets()
                rows, columns = window.toslices()
                seen[rows, columns] |= tile.read(1)
        assert np.array_equal(seen, whole.read(1))
    assert seen.any()
