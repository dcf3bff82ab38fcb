"""A COPC file comes node by node, and gives what the same points give as LAZ."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest
from tests.conftest import build_files
from tests.formats.copc_writer import write_copc
from tests.run.test_long_buildings import features

from eaves.formats import iter_chunks, open_source


@pytest.mark.slow
def test_copc_gives_what_laz_gives(nine_roofs_file: Path, tmp_path: Path) -> None:
    write_copc(tmp_path / "points.copc.laz", laspy.read(nine_roofs_file))
    assert build_files(nine_roofs_file, tmp_path / "laz").complete
    assert build_files(tmp_path / "points.copc.laz", tmp_path / "copc").complete
    one, other = (features([tmp_path / name / "buildings.city.jsonl"]) for name in ("laz", "copc"))
    assert one == other


def test_a_copc_file_is_read_in_pieces_of_a_few_nodes(nine_roofs_file: Path, tmp_path: Path) -> None:
    las = laspy.read(nine_roofs_file)
    write_copc(tmp_path / "points.copc.laz", las, levels=4)
    source = open_source(tmp_path / "points.copc.laz")
    sizes = [len(chunk) for chunk in iter_chunks(source, chunk_points=2000)]
    assert sum(sizes) == len(las)
    assert max(sizes) < len(las) / 3
    parts = [iter_chunks(source, chunk_points=2000, part=(k, 5)) for k in range(5)]
    positions = np.concatenate([chunk.position for part in parts for chunk in part])
    assert np.array_equal(np.sort(positions), np.arange(len(las)))
