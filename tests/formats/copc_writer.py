"""A small COPC writer (Cloud Optimized Point Cloud 1.0), so that the reader meets files it did not write."""

from __future__ import annotations

import struct
from io import BytesIO
from pathlib import Path

import laspy
import lazrs
import numpy as np
from numpy.typing import NDArray

HEADER_BYTES = 375
COARSER = 4
"""Unless asked otherwise, every level keeps one point in so many and hands the others down."""


def write_copc(path: Path, las: laspy.LasData, levels: int = 3, coarser: int = COARSER) -> NDArray[np.int64]:
    """Write points (LAS 1.4, format 6 to 8) as COPC; return which point stands at each place of the file.

    Every branch below the root has a hierarchy page of its own, as in large files.
    """
    plain = BytesIO()
    las.write(plain)
    data = plain.getvalue()
    start, length = struct.unpack_from("<I", data, 96)[0], las.header.point_format.size
    records = np.frombuffer(data[start : start + len(las) * length], np.uint8).reshape(-1, length)
    xyz = np.asarray(las.xyz)
    centre = (xyz.min(axis=0) + xyz.max(axis=0)) / 2
    half = float(np.ptp(xyz, axis=0).max()) / 2 + 0.01
    nodes = _nodes(xyz, centre - half, 2 * half, levels, coarser)

    laszip = lazrs.LazVlr.new_for_compression(las.header.point_format.id, length - _core(las), True)
    compressed = _record("laszip encoded", 22204, bytes(laszip.record_data()))
    offset = HEADER_BYTES + 54 + 160 + (start - HEADER_BYTES) + len(compressed)
    blob, sizes = _compressed(laszip, offset, [records[which] for _, which in nodes])
    evlr = offset + len(blob)
    pages, root = _pages([key for key, _ in nodes], offset + 8, sizes, [len(n) for _, n in nodes], evlr + 60)
    info = struct.pack("<5d2Q2d", *centre, half, half / 64, evlr + 60, root, 0.0, 0.0).ljust(160, b"\0")

    head = bytearray(data[:HEADER_BYTES])
    struct.pack_into("<II", head, 96, offset, struct.unpack_from("<I", head, 100)[0] + 2)
    head[104] |= 0x80
    struct.pack_into("<QI", head, 235, evlr, 1)
    hierarchy = struct.pack("<H16sHQ32s", 0, b"copc", 1000, len(pages), b"") + pages
    records_between = _record("copc", 1, info) + data[HEADER_BYTES:start] + compressed
    path.write_bytes(bytes(head) + records_between + blob + hierarchy)
    return np.concatenate([which for _, which in nodes])


def _nodes(
    xyz: NDArray[np.float64], corner: NDArray[np.float64], side: float, levels: int, coarser: int
) -> list[tuple[tuple[int, int, int, int], NDArray[np.int64]]]:
    """Keys (level, x, y, z) and the points of every node, coarse to fine."""
    left, nodes = np.arange(len(xyz)), []
    for level in range(levels):
        last = level == levels - 1
        mine = left if last else left[::coarser]
        left = left[:0] if last else np.setdiff1d(left, mine)
        cells = np.floor((xyz[mine] - corner) / (side / 2**level)).astype(int)
        names, group, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
        members = np.split(mine[np.argsort(group.ravel(), kind="stable")], np.cumsum(counts)[:-1])
        nodes += [((level, *name), which) for name, which in zip(names.tolist(), members, strict=True)]
    return nodes


def _compressed(
    laszip: lazrs.LazVlr, offset: int, chunks: list[NDArray[np.uint8]]
) -> tuple[bytes, list[int]]:
    """All chunks as they stand from byte `offset` on, chunk table included, and the bytes of each chunk."""
    file = BytesIO(bytes(offset))
    file.seek(offset)
    compressor = lazrs.LasZipCompressor(file, laszip)
    compressor.reserve_offset_to_chunk_table()
    ends = [file.tell()]
    for chunk in chunks:
        compressor.compress_many(chunk.reshape(-1))
        compressor.finish_current_chunk()
        ends.append(file.tell())
    compressor.done()
    return file.getvalue()[offset:], np.diff(ends).tolist()


def _pages(
    keys: list[tuple[int, int, int, int]], first: int, sizes: list[int], counts: list[int], place: int
) -> tuple[bytes, int]:
    """The hierarchy from byte `place` on, the root's page first, and the bytes of that page."""
    starts = first + np.cumsum(sizes) - sizes
    entries = {
        key: struct.pack("<4iQii", *key, int(start), size, count)
        for key, start, size, count in zip(keys, starts, sizes, counts, strict=True)
    }
    branches = [key for key in keys if key[0] == 1]
    root, deeper = entries[keys[0]], b""
    root_bytes = 32 * (1 + len(branches))
    for branch in branches:
        page = b"".join(entries[key] for key in keys if key[0] and _ancestor(key) == branch)
        root += struct.pack("<4iQii", *branch, place + root_bytes + len(deeper), len(page), -1)
        deeper += page
    assert len(root + deeper) == 32 * (len(keys) + len(branches)), "a node has no parent"
    return root + deeper, root_bytes


def _ancestor(key: tuple[int, int, int, int]) -> tuple[int, int, int, int]:
    """The key's forebear on level 1."""
    level, x, y, z = key
    return 1, x >> (level - 1), y >> (level - 1), z >> (level - 1)


def _core(las: laspy.LasData) -> int:
    return int(laspy.PointFormat(las.header.point_format.id).size)


def _record(owner: str, number: int, data: bytes) -> bytes:
    return struct.pack("<H16sHH32s", 0, owner.encode(), number, len(data), b"") + data
