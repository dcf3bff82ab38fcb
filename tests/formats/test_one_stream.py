"""Files that LASzip's first method compressed: one stream of points without chunks."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import laspy
import numpy as np
import pytest

from eaves.formats import InputError, read


def written(count: int, points: int) -> bytes:
    """A LAZ file of points, as LASzip's first method wrote it; the header states `count` of them."""
    rng = np.random.default_rng(1)
    las = laspy.LasData(laspy.LasHeader(version="1.2", point_format=1))
    las.x, las.y, las.z = rng.uniform(0.0, 100.0, (3, points)).round(2)
    las.intensity, las.gps_time = rng.integers(0, 99, points), np.arange(points) * 0.1
    buffer = io.BytesIO()
    las.write(buffer, do_compress=True)
    data = bytearray(buffer.getvalue())
    (start,) = struct.unpack_from("<I", data, 96)
    (table,) = struct.unpack_from("<q", data, start)
    laszip = data.find(b"laszip encoded") + 52
    struct.pack_into("<H", data, laszip, 1)
    struct.pack_into("<I", data, laszip + 12, 1)
    struct.pack_into("<I", data, 107, count)
    return bytes(data[:start] + data[start + 8 : table])


def test_it_is_read_as_laspy_reads_it(tmp_path: Path) -> None:
    path = tmp_path / "old.laz"
    path.write_bytes(written(5000, 5000))
    known, cloud = laspy.read(path), read(path)
    xyz = np.column_stack([known.x, known.y, known.z])
    assert np.abs(cloud.xyz + [*cloud.origin, 0.0] - xyz).max() < 1e-3


@pytest.mark.parametrize("count", [50_000, 90_000_000])
def test_more_points_than_there_are_is_one_line(tmp_path: Path, count: int) -> None:
    path = tmp_path / "old.laz"
    path.write_bytes(written(count, 5000))
    with pytest.raises(InputError, match=r"old\.laz"):
        read(path)


@pytest.mark.skipif(laspy.LazBackend.Laszip.is_available(), reason="the extra is installed")
def test_newer_compression_without_its_extra_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "new.laz"
    las = laspy.LasData(laspy.LasHeader(version="1.4", point_format=6))
    las.x = las.y = las.z = np.arange(1.0, 50.0)
    las.write(path)
    data = bytearray(path.read_bytes())
    struct.pack_into(
        "<H", data, data.find(b"laszip encoded") + 52 + 34 + 4, 4
    )  # the version of the first item
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"new\.laz: .*\.\[laszip\]"):
        read(path, crs="metres")
