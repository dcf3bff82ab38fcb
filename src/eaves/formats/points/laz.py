"""The chunks of a compressed LAS file: where they are, which ones a rectangle needs, what they hold."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, BinaryIO

import laspy
import lazrs
import numpy as np
from laspy.errors import LaspyException
from numpy.typing import NDArray

from eaves.formats.errors import INSTALL, InputError
from eaves.formats.points.las_header import COPY_AGAIN, RECORD_LENGTHS, WRITE_AGAIN, LasHeader
from eaves.model import Integers, Rectangle

CHUNK_BYTES = 1 << 30
"""Largest chunk (bytes, decompressed) this reader takes; laszip's usual 50,000 points are 2 MB."""
VARIABLE_CHUNKS = 0xFFFFFFFF
NEWEST_ITEM = 3
"""Version of the items of a record (LASzip VLR) up to which lazrs decompresses them."""
POINTWISE = 1
"""LASzip's first method (`header.laszip` begins with it): no chunks."""
LAYERS = {6: 9, 7: 10, 8: 11, 9: 10, 10: 12}
"""Compressed layers of a chunk by point format; every extra byte is one more (LASzip 1.4 specification)."""
ENTRY = np.dtype(
    [("level", "<i4"), ("cell", "<i4", 3), ("offset", "<u8"), ("length", "<i4"), ("points", "<i4")]
)
"""Of a page of the octree (Cloud Optimized Point Cloud 1.0)."""
DEEPEST_LEVEL = 30


@dataclass(frozen=True, eq=False)
class ChunkTable:
    """Chunks in the file's order: first byte, bytes, points and position of the first point, each (K,)."""

    offset: Integers
    length: Integers
    points: Integers

    @property
    def first(self) -> Integers:
        """The number of each chunk's first point."""
        return np.cumsum(self.points) - self.points

    def runs(self, which: Integers, size: int) -> list[Integers]:
        """The chunks numbered `which` (rising) in runs of about `size` points."""
        run = (np.cumsum(self.points[which]) - self.points[which]) // size
        return np.split(which, np.flatnonzero(np.diff(run)) + 1)


def read_chunk_table(file: BinaryIO, header: LasHeader) -> ChunkTable:
    """The chunk table of a file, checked against its size and its number of points.

    Raises
    ------
    InputError
        When the table is missing or states more than the file can hold.
    """
    start = header.data_offset + 8
    if header.laszip[0] == POINTWISE:
        return one_stream(header)
    file.seek(header.data_offset)
    place = struct.unpack("<q", file.read(8).ljust(8, b"\0"))[0]
    if place == -1:  # a writer that could not seek leaves the place in the last eight bytes
        file.seek(header.size - 8)
        place = struct.unpack("<q", file.read(8))[0]
    if not start <= place <= header.size - 8:
        raise InputError.about(header.path, "is cut off: its chunk table is missing", COPY_AGAIN)
    file.seek(place)
    version, number = struct.unpack("<II", file.read(8))
    if version != 0 or number * header.record_length > place - start:
        raise InputError.about(
            header.path, f"has a chunk table of {number} chunks for {place - start} bytes", COPY_AGAIN
        )
    file.seek(header.data_offset)
    description = guard(header, lambda: lazrs.LazVlr(header.laszip))
    entries = guard(header, lambda: lazrs.read_chunk_table(file, description))
    table = np.array(entries, np.float64).reshape(-1, 2)
    size = struct.unpack_from("<I", header.laszip, 12)[0]
    if size != VARIABLE_CHUNKS:
        table[:, 0] = np.clip(header.count - size * np.arange(len(table)), 0, size)
    if table[:, 1].sum() > place - start or table[:, 0].sum() != header.count:
        raise InputError.about(
            header.path,
            f"has chunks of {table[:, 0].sum():.0f} points in {table[:, 1].sum():.0f} bytes, but the header "
            f"states {header.count} points and the file has {place - start} bytes of them",
            COPY_AGAIN,
        )
    if len(table) and table[:, 0].max() * header.record_length > CHUNK_BYTES:
        raise InputError.about(
            header.path, f"has a chunk of {table[:, 0].max():.0f} points, too large to open", WRITE_AGAIN
        )
    points, length = table.astype(np.int64).T
    offset = start + np.cumsum(length) - length
    filled = points > 0  # writers that end a chunk at the last point leave an empty one behind it
    return ChunkTable(offset[filled], length[filled], points[filled])


def one_stream(header: LasHeader) -> ChunkTable:
    """The table of a file without one: LASzip's first method compressed all its points as one stream."""
    if header.count * header.record_length > CHUNK_BYTES:
        raise InputError.about(
            header.path, f"has {header.count} points in one piece, too large to open", WRITE_AGAIN
        )
    values = header.data_offset, header.size - header.data_offset, header.count
    return ChunkTable(*(np.array([value] if header.count else [], np.int64) for value in values))


def decompress(
    file: BinaryIO, header: LasHeader, table: ChunkTable, which: Integers, selection: int, size: int
) -> Iterator[tuple[Integers, NDArray[np.uint8]]]:
    """Runs of about `size` points of the chunks numbered `which` (rising).

    Yields positions (N,) and records (N, record length); fields outside `selection` (lazrs's bits) are zero.
    """
    if not len(which):
        return
    for part in table.runs(which, size):
        pieces = []
        for number in part:
            file.seek(int(table.offset[number]))
            piece = file.read(int(table.length[number]))
            _check_layers(header, piece, int(number))
            pieces.append(piece)
        counts = [(int(table.points[k]), int(table.length[k])) for k in part]
        total = int(table.points[part].sum())
        records = np.zeros(total * header.record_length, np.uint8)
        call = partial(
            lazrs.decompress_points_with_chunk_table,
            b"".join(pieces),
            header.laszip,
            records,
            counts,
            lazrs.DecompressionSelection(selection),
        )
        guard(header, call)
        positions = np.concatenate([table.first[k] + np.arange(table.points[k]) for k in part])
        yield positions, records.reshape(total, header.record_length)


def is_newer_than_lazrs(header: LasHeader) -> bool:
    """True if LASzip compressed the points in a way that lazrs does not know (items of version 4)."""
    versions = [
        item[2]
        for item in struct.iter_unpack("<3H", header.laszip[34 : 34 + (len(header.laszip) - 34) // 6 * 6])
    ]
    return max(versions, default=0) > NEWEST_ITEM


def read_by_laszip(header: LasHeader, size: int) -> Iterator[tuple[Integers, NDArray[np.uint8]]]:
    """Positions (N,) and records (N, record length), about `size` at a time, by LASzip's own library.

    Raises
    ------
    InputError
        When it is not installed, or refuses the file.
    """
    if not laspy.LazBackend.Laszip.is_available():
        raise InputError.about(
            header.path,
            "is compressed in LASzip's newest way, which an extra reads",
            INSTALL.format("laszip"),
        )
    first = 0
    try:
        with laspy.open(header.path, laz_backend=laspy.LazBackend.Laszip) as reader:
            for points in reader.chunk_iterator(size):
                record = points.array.dtype.itemsize
                records = np.frombuffer(points.array.tobytes(), np.uint8).reshape(len(points), record)
                yield np.arange(first, first + len(records)), records
                first += len(records)
    except (LaspyException, RuntimeError, ValueError, OSError):
        raise InputError.about(header.path, "is refused by LASzip: it is damaged", COPY_AGAIN) from None


def guard(header: LasHeader, call: Callable[[], Any]) -> Any:
    """The answer of a call into lazrs; any complaint of it, a Rust panic included, becomes an InputError."""
    try:
        return call()
    except (lazrs.LazrsError, ValueError, TypeError, OverflowError, OSError, MemoryError):
        pass
    except BaseException as error:
        if type(error).__name__ != "PanicException":  # pyo3's own class, which no module exports
            raise
    raise InputError.about(
        header.path,
        "holds compressed points that are damaged, or compressed in a way that lazrs does not know",
        f"{COPY_AGAIN}, or write it as LAS with PDAL or las2las",
    )


def _check_layers(header: LasHeader, piece: bytes, number: int) -> None:
    """A chunk of layers holds the size of each: together they must fit, or memory is requested that never
    fills."""
    if header.point_format < 6:
        return
    layers = LAYERS[header.point_format] + header.record_length - RECORD_LENGTHS[header.point_format]
    start = header.record_length + 4
    sizes = np.frombuffer(piece[start : start + 4 * layers], "<u4")
    if len(sizes) < layers or sizes.sum(dtype=np.int64) > len(piece):
        raise InputError.about(
            header.path, f"holds compressed points that are damaged (chunk {number})", COPY_AGAIN
        )


def chunks_within(file: BinaryIO, header: LasHeader, table: ChunkTable, rectangle: Rectangle) -> Integers:
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
