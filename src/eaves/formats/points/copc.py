"""The octree of a COPC file (Cloud Optimized Point Cloud 1.0): which chunks a rectangle needs."""

from __future__ import annotations

import struct
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from eaves.formats.errors import InputError
from eaves.formats.points.las_header import COPY_AGAIN, LasHeader
from eaves.formats.points.laz import ChunkTable

ENTRY = np.dtype(
    [("level", "<i4"), ("cell", "<i4", 3), ("offset", "<u8"), ("length", "<i4"), ("points", "<i4")]
)
DEEPEST_LEVEL = 30


def chunks_within(
    file: BinaryIO, header: LasHeader, table: ChunkTable, rectangle: tuple[float, float, float, float]
) -> NDArray[np.int64]:
    """Numbers (rising) of the chunks whose octree cell meets west, south, east, north (in the file's units).

    Raises
    ------
    InputError
        When the hierarchy is damaged or does not match the chunk table.
    """
    info = header.copc or b""
    if len(info) < 72:
        raise InputError.about(header.path, "has a COPC record that is too short", COPY_AGAIN)
    x, y, _, half, _, root_offset, root_length = struct.unpack_from("<5d2Q", info)
    entries = _hierarchy(file, header, int(root_offset), int(root_length))
    number = np.minimum(
        np.searchsorted(table.offset, entries["offset"].astype(np.int64)), len(table.offset) - 1
    )
    if not (
        len(table.offset)
        and np.isfinite([x, y, half]).all()
        and np.array_equal(np.sort(number), np.flatnonzero(table.points))
        and np.array_equal(table.offset[number], entries["offset"].astype(np.int64))
        and np.array_equal(table.points[number], entries["points"])
    ):
        raise InputError.about(header.path, "has a COPC hierarchy that is not its chunk table", COPY_AGAIN)
    side = 2.0 * half / 2.0 ** entries["level"]
    low_x, low_y = x - half + entries["cell"][:, 0] * side, y - half + entries["cell"][:, 1] * side
    west, south, east, north = rectangle
    # A point may lie one step outside its cell, by rounding.
    slack_x, slack_y = abs(header.scales[0]), abs(header.scales[1])
    meets = (low_x - slack_x <= east) & (low_x + side + slack_x >= west)
    meets &= (low_y - slack_y <= north) & (low_y + side + slack_y >= south)
    return np.sort(number[meets]).astype(np.int64)


def _hierarchy(file: BinaryIO, header: LasHeader, offset: int, length: int) -> NDArray[np.void]:
    """All entries with points, from the root page and the pages it names."""
    damaged = InputError.about(header.path, "has a damaged COPC hierarchy", COPY_AGAIN)
    pages, seen, found = [(offset, length)], set(), []
    while pages:
        offset, length = pages.pop()
        if offset in seen or offset < 0 or length % ENTRY.itemsize or not 0 < length <= header.size - offset:
            raise damaged
        seen.add(offset)
        file.seek(offset)
        entries = np.frombuffer(file.read(length), ENTRY)
        if ((entries["level"] < 0) | (entries["level"] > DEEPEST_LEVEL) | (entries["points"] < -1)).any():
            raise damaged
        deeper = entries[entries["points"] == -1]
        pages += [(int(o), int(n)) for o, n in zip(deeper["offset"], deeper["length"], strict=True)]
        found.append(entries[entries["points"] > 0])
    return np.concatenate(found)
