"""With bounds or a clip area, exactly the points inside reach the blocks, whatever the format."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import laspy
import numpy as np
import pytest
import rasterio
import shapely
from tests.conftest import build_files
from tests.formats.copc_writer import write_copc

from eaves.formats import iter_chunks, open_source
from eaves.formats.vectors.geopackage import Row, write_geopackage
from eaves.model import Bounds, CoordinateSystem
from eaves.run.index import index_inputs
from eaves.run.points import SliceWriter, Window, file_slices, read_slice
from eaves.run.store import Store
from eaves.simulate.objects.houses import ExactScene

SIDE = 30.0
BORDER = 13.0
"""From the scene's corner to the south-west of the bounds (m): in the middle of a block."""
KINDS = ("las", "laz", "copc.laz", "xyz")
WINDOWS = ("bounds", "clip", "both")


@pytest.fixture(scope="module")
def inputs(nine_roofs_file: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The same points in every format."""
    folder = tmp_path_factory.mktemp("window")
    las = laspy.read(nine_roofs_file)
    paths = {kind: folder / f"points.{kind}" for kind in KINDS}
    las.write(paths["las"])
    las.write(paths["laz"])
    write_copc(paths["copc.laz"], las)
    np.savetxt(paths["xyz"], las.xyz, "%.3f")
    return paths


@pytest.fixture(scope="module")
def windows(nine_roofs: ExactScene, inputs: dict[str, Path]) -> dict[str, Window]:
    """Bounds that cut through blocks, a triangle, and both."""
    whole = open_source(inputs["laz"]).bounds
    west, south = whole.west + BORDER, whole.south + BORDER
    bounds = Bounds(west, south, west + 25.0, south + 20.0)
    clip = shapely.Polygon([(west - 5, south - 5), (west + 30, south - 5), (west - 5, south + 25)])
    return {"bounds": Window(bounds), "clip": Window(clip=clip), "both": Window(bounds, clip)}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", WINDOWS)
def test_only_points_in_the_window_are_scattered(
    inputs: dict[str, Path], windows: dict[str, Window], tmp_path: Path, kind: str, name: str
) -> None:
    window, store = windows[name], Store(tmp_path)
    store.prepare()
    for part in file_slices(index_inputs([inputs[kind]], None, [])):
        reading = SimpleNamespace(side=SIDE, window=window, fields=())
        assert read_slice(part, SliceWriter(store, part), reading).unread is None
    found = [store.read_points(block)["point_id"] for block in store.blocks(SIDE)]
    wanted = []
    for chunk in iter_chunks(open_source(inputs[kind])):
        x, y, _ = chunk.xyz.T
        inside = np.ones(len(x), bool)
        if window.bounds is not None:
            inside &= (x >= window.bounds.west) & (x < window.bounds.east)
            inside &= (y >= window.bounds.south) & (y < window.bounds.north)
        if window.clip is not None:
            inside &= shapely.contains_xy(window.clip, x, y)
        wanted.append(chunk.position[inside])
    assert np.array_equal(np.sort(np.concatenate(found)), np.sort(np.concatenate(wanted)))
    assert len(np.concatenate(wanted)) > 100


def test_a_run_with_bounds_knows_and_writes_nothing_outside(
    inputs: dict[str, Path], windows: dict[str, Window], tmp_path: Path
) -> None:
    bounds = windows["bounds"].bounds
    assert bounds is not None
    summary = build_files(inputs["laz"], tmp_path, bounds=bounds, outputs=("rasters", "classified"))
    assert summary.complete
    with rasterio.open(tmp_path / "dtm.tif") as image:
        assert Bounds(*image.bounds).buffered(-1.0).union(bounds) == bounds
    written = laspy.read(tmp_path / "classified.laz")
    assert 100 < len(written) == bounds.contains(written.xyz).sum() == summary.points_used < summary.points
    assert f"{summary.points_used:,} of {summary.points:,} points" in summary.as_text()


@pytest.mark.slow
def test_a_clip_area_that_is_a_rectangle_gives_the_buildings_of_the_same_bounds(
    inputs: dict[str, Path], tmp_path: Path
) -> None:
    whole = open_source(inputs["laz"]).bounds
    bounds = Bounds(whole.west + 1, whole.south + 1, whole.west + 45, whole.north - 1)
    write_geopackage(tmp_path / "area.gpkg", [Row(shapely.box(*bounds), {})], (), CoordinateSystem())
    outputs = ("footprints", "models")
    found = [
        build_files(inputs["laz"], tmp_path / name, outputs=outputs, **{name: area}).found
        for name, area in (("bounds", bounds), ("clip", tmp_path / "area.gpkg"))
    ]
    assert found[0] == found[1] > 1
    models = [
        (tmp_path / name / "buildings.city.jsonl").read_text(encoding="utf-8").splitlines()
        for name in ("bounds", "clip")
    ]
    assert models[0][1:] == models[1][1:]
