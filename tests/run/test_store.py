"""What is loaded of the store: the points of a window in canonical order, whatever files they lie in."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from eaves.formats import Chunk
from eaves.model import Block, Bounds, PointCloud
from eaves.run.points import FileSlice, SliceWriter, Window, load_window, partition_chunk
from eaves.run.store import Store


@pytest.mark.parametrize("side", [60.0, 33.3])
@pytest.mark.parametrize("files", [1, 3])
def test_a_window_has_its_points_in_canonical_order(tmp_path: Path, side: float, files: int) -> None:
    random = np.random.default_rng(files)
    # heights apart from one another and many places twice; borders of blocks and cells are among them
    world = np.round(random.uniform(-70.0, 130.0, (6000, 3)) * [1.0, 1.0, 0.0], 1) + [85000.0, 447000.0, 0.0]
    world[:, 2] = random.permutation(len(world)) / 100.0
    store = Store(tmp_path, has_returns=False, has_classes=False)
    store.prepare()
    for number, some in enumerate(np.array_split(np.arange(len(world)), files)):
        writer = SliceWriter(store, cast(FileSlice, SimpleNamespace(name=f"{number:07d}-0000")))
        for piece in np.array_split(some, 2):
            chunk = Chunk(world[piece], piece - some[0])
            partition_chunk(chunk, int(some[0]), side, Window(), writer)
        writer.finish(True)
    block, reach = Block.at(85000.0, 447000.0, side), 21.3
    bounds = block.bounds.buffered(reach)
    inside = np.flatnonzero(bounds.contains(world))
    right = PointCloud.from_world(world[inside], block.origin, point_id=inside).in_canonical_order()
    window = load_window(store, block, reach)
    cloud, number = window.cloud, window.inside
    assert cloud.ordered and np.array_equal(cloud.point_id, right.point_id)
    assert np.allclose(cloud.xyz, right.xyz, atol=1e-6)
    core = Bounds(0.0, 0.0, side, side).contains(cloud.xyz)
    assert np.array_equal(store.read_points(block)["point_id"][number], cloud.point_id[core])
    assert np.array_equal(np.sort(number), np.arange(store.count_points(block)))
