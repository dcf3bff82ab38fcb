"""Points strewn far from all others cost neither days nor a survey: they are left out and counted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rasterio
from rasterio.windows import from_bounds
from tests.conftest import build_files

from eaves.model import Block
from eaves.run.manifest import check_folder
from eaves.run.points import find_isolated_blocks
from eaves.run.store import RECORD, Store

SIDE = 60.0


def filled(folder: Path, counts: dict[tuple[int, int], int], wide: float = 50.0) -> tuple[Store, list[Block]]:
    """A store of blocks with so many points each, on a square `wide` metres."""
    store = Store(folder)
    store.prepare()
    rng = np.random.default_rng(1)
    for (column, row), count in counts.items():
        records = np.zeros(count, RECORD)
        records["xyz"][:, :2] = rng.random((count, 2)) * wide / 1e-4
        path = store.points_path(Block(column, row, SIDE))
        path.mkdir()
        records.tofile(path / "0.bin")
    return store, store.blocks(SIDE)


def test_a_lone_point_is_isolated_and_a_sliver_of_a_survey_is_not(tmp_path: Path) -> None:
    store, blocks = filled(tmp_path, {(0, 0): 2000, (1, 1): 1, (3, 3): 1, (90, 90): 9})
    assert find_isolated_blocks(store, blocks) == {Block(3, 3, SIDE): 1, Block(90, 90, SIDE): 9}


def test_few_points_are_isolated_only_where_they_are_sparse(tmp_path: Path) -> None:
    store, blocks = filled(tmp_path / "dense", {(0, 0): 60}, wide=5.0)
    assert not find_isolated_blocks(store, blocks)
    strewn = {(column, row): 2 for column in range(9) for row in range(9)}
    store, blocks = filled(tmp_path / "strewn", strewn)
    assert len(find_isolated_blocks(store, blocks)) == 81


@pytest.mark.slow
def test_a_strewn_cloud_gives_valid_empty_results_at_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    xyz = np.random.default_rng(2).random((3000, 3)) * [4e6, 4e6, 1e3]
    np.savetxt(tmp_path / "a.xyz", xyz, "%.2f")
    summary = build_files(tmp_path / "a.xyz", tmp_path / "out")
    assert summary.complete and summary.found == 0
    assert "are left out" in caplog.text


def test_rasters_over_a_continent_are_written_where_points_lie(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    near = rng.random((500, 3)) * [30, 30, 0]
    np.savetxt(tmp_path / "a.xyz", np.concatenate([near, near + [3e6, 2e6, 7]]), "%.2f")
    out = tmp_path / "out"
    assert build_files(tmp_path / "a.xyz", out).complete
    assert len(list((out / "tiles").glob("*/dtm.tif"))) == len(list((out / "tiles").glob("*/mask.tif"))) == 2
    assert not (out / "dtm.tif").exists()
    for place, height in ((np.array([15.0, 15.0]), 0.0), (np.array([3e6 + 15, 2e6 + 15]), 7.0)):
        with rasterio.open(out / "dtm.vrt") as terrain, rasterio.open(out / "mask.vrt") as mask:
            window = from_bounds(*(place - 5), *(place + 5), transform=terrain.transform)
            assert terrain.read(1, window=window) == pytest.approx(height, abs=1e-3)
            assert not mask.read(1, window=from_bounds(*place, *(place + 5), mask.transform)).any()
    assert check_folder(out) == []
    assert build_files(tmp_path / "a.xyz", out, outputs=("models",)).complete
    assert not (out / "tiles").exists()
