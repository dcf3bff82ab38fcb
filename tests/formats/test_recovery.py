"""Points are read to the end of a file whatever its header counts; a file that is cut off is refused."""

from __future__ import annotations

import struct
from pathlib import Path

import laspy
import numpy as np
import pytest
from copc_writer import write_copc
from tests.conftest import build_files

from eaves.formats import InputError, iter_chunks, open_source
from eaves.run.index import index_inputs

COUNT = 120_000
"""Three chunks of laszip's 50,000 points."""


def cloud(point_format: int, count: int = COUNT) -> laspy.LasData:
    header = laspy.LasHeader(version="1.4" if point_format > 5 else "1.2", point_format=point_format)
    header.scales, header.offsets = np.full(3, 0.001), np.array([85000.0, 447000.0, 0.0])
    las = laspy.LasData(header)
    las.x, las.y, las.z = (np.random.default_rng(1).random((count, 3)) * [50, 50, 4]).T + [
        [85000],
        [447000],
        [1],
    ]
    las.return_number = las.number_of_returns = np.ones(count, np.uint8)
    return las


def with_count(path: Path, count: int) -> Path:
    data = bytearray(path.read_bytes())
    struct.pack_into("<I", data, 107, count if data[25] < 4 else 0)
    if data[25] >= 4:
        struct.pack_into("<Q", data, 247, count)
    path.write_bytes(data)
    return path


def points_of(path: Path) -> np.ndarray:
    source = index_inputs([path], None, []).source(0)
    return np.concatenate([chunk.xyz for chunk in iter_chunks(source)])


@pytest.mark.parametrize("suffix", [".las", ".laz"])
@pytest.mark.parametrize("point_format", [1, 6])
@pytest.mark.parametrize("count", [0, 1000, 60_000])
def test_a_count_too_small_loses_no_point_in_silence(
    suffix: str, point_format: int, count: int, tmp_path: Path
) -> None:
    path = tmp_path / f"a{suffix}"
    cloud(point_format).write(path)
    whole = points_of(path)
    with_count(path, count)
    if (suffix, point_format) == (".laz", 1):  # the last chunk does not tell how many points it has
        if count == 60_000:
            count = 40_000  # less than its first chunk alone
            with_count(path, count)
        with pytest.raises(InputError, match="write it again"):
            open_source(path)
    else:
        assert np.array_equal(points_of(path), whole)


@pytest.mark.parametrize("count", [0, 1, 700, 20_000])
def test_within_one_chunk_too(count: int, tmp_path: Path) -> None:
    cloud(6, 30_000).write(tmp_path / "a.laz")
    whole = points_of(tmp_path / "a.laz")
    assert np.array_equal(points_of(with_count(tmp_path / "a.laz", count)), whole)
    cloud(1, 30_000).write(tmp_path / "b.laz")
    if count in (0, 1, 700):
        with pytest.raises(InputError, match="counts"):
            open_source(with_count(tmp_path / "b.laz", count))


def test_what_follows_the_points_is_no_point(tmp_path: Path) -> None:
    cloud(1, 500).write(tmp_path / "a.las")
    with (tmp_path / "a.las").open("ab") as file:
        file.write(b"\0" * 5000)
    assert open_source(tmp_path / "a.las").count == 500


@pytest.mark.parametrize(
    ("point_format", "suffix"), [(1, ".laz"), (6, ".laz"), (1, ".las"), (6, ".copc.laz")]
)
def test_a_cut_file_is_refused_with_the_remedy(point_format: int, suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a{suffix}"
    if "copc" in suffix:
        write_copc(path, cloud(6, 5000), levels=3)
    else:
        cloud(point_format).write(path)
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * 0.9)])
    with pytest.raises(InputError, match="copy or download it again"):
        points_of(path)
    with pytest.raises(InputError, match="copy or download it again"):
        build_files(path, tmp_path / "out", lod="0", outputs=("classified",))
