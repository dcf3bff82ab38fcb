"""Points that a header does not own up to: wrong counts, and whole chunks of files that are cut off."""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import BinaryIO

import numpy as np

from eaves.formats.errors import InputError
from eaves.formats.points.las import FIRST_LAYERED_FORMAT, returns_and_class
from eaves.formats.points.las_header import RECORD_LENGTHS, LasHeader
from eaves.formats.points.laz import (
    LARGEST_CHUNK,
    LAYERS,
    TABLE,
    VARIABLE_CHUNKS,
    ChunkTable,
    read_chunk_table,
    whole_chunks,
)

LOOKED_AT = 1000
"""So many of the records behind the last one that the header counts are looked at."""
LIKELY_POINTS = 0.9
"""They are points when so many of them have the number of their return within that of all returns."""


def corrected(header: LasHeader, file: BinaryIO, salvage: bool = False) -> LasHeader:
    """The header with the number of points that the file holds, where that can be known.

    A writer that crashed leaves a count of zero, or that of its last flush. With `salvage` the whole chunks
    of a compressed file without its table of chunks count, too.

    Raises
    ------
    InputError
        When points are there that the header does not count, and their number is not known.
    """
    if not header.compressed and salvage:
        return replace(header, salvaged=True)  # its count is that of what is there
    if not header.compressed:
        held = header.room // header.record_length
        more = header.count < held and are_points(header, file, held)
        return replace(header, count=held, stated=header.count) if more else header
    if not salvage:
        return replace_count(header, file)
    table = find_chunks(header, file) if header.point_format >= FIRST_LAYERED_FORMAT else None
    count = int(table.points.sum()) if table is not None else sum(map(len, whole_chunks(header, file, TABLE)))
    if not count:
        raise InputError.about(header.path, "holds no whole chunk of points", "copy or download it again")
    return replace(header, count=count, stated=header.count, salvaged=True, chunks=table)


def check_chunks(header: LasHeader) -> None:
    """Refuse a compressed file without its table of chunks.

    Raises
    ------
    InputError
        When it has not.
    """
    if header.compressed and header.count:
        with header.path.open("rb") as file:
            read_chunk_table(file, header)


def are_points(header: LasHeader, file: BinaryIO, held: int) -> bool:
    """Whether what follows the last point that the header counts are points, too."""
    numbers = np.unique(np.linspace(header.count, held - 1, LOOKED_AT).astype(np.int64))
    records = np.empty((len(numbers), header.record_length), np.uint8)
    for number, record in zip(numbers.tolist(), records, strict=True):
        file.seek(header.data_offset + number * header.record_length)
        record[:] = np.frombuffer(file.read(header.record_length), np.uint8)
    which, of, _, _ = returns_and_class(header.point_format, records)
    good = records[:, :12].any(axis=1) & ((which <= of) | (of == 0))
    return bool(good.sum() >= LIKELY_POINTS * len(numbers))


def replace_count(header: LasHeader, file: BinaryIO) -> LasHeader:
    """The header with the count of its chunks, when they are more than the points it states."""
    size = struct.unpack_from("<I", header.laszip, 12)[0]
    if size == VARIABLE_CHUNKS or not size:
        return header
    file.seek(header.data_offset)
    place = struct.unpack("<q", file.read(8).ljust(8, b"\0"))[0]
    if not header.data_offset + 8 <= place <= header.size - 8:
        if header.count == 0 and header.size > header.data_offset + 8:
            raise InputError.about(
                header.path, "holds points, but its header counts none", "recover them with --salvage"
            )
        return header  # reading its points will say so
    file.seek(place)
    number = struct.unpack("<II", file.read(8))[1]
    if not 0 < number < header.size:
        return header
    # of all chunks but the last the number of points is known
    table = read_chunk_table(file, replace(header, count=number * size))
    before, length = int(table.points[:-1].sum()), int(table.length[-1])
    if length == 0:  # an empty chunk ends the table of some writers
        return header
    if header.point_format >= FIRST_LAYERED_FORMAT:
        file.seek(int(table.offset[-1]) + header.record_length)
        last = struct.unpack("<I", file.read(4).ljust(4, b"\0"))[0]
        right = 0 < last <= size and before + last > header.count
        return replace(header, count=before + last, stated=header.count) if right else header
    stated = header.count - before
    if 0 < stated <= size and length <= LARGER * stated * header.record_length + SMALL_CHUNK:
        return header
    raise InputError.about(
        header.path,
        f"counts {header.count} points, but its {number} chunks of {size} hold others",
        "recover its whole chunks with --salvage",
    )


LARGER, SMALL_CHUNK = 1.5, 1000
"""A chunk of points is compressed to less than its size; one that is so many times as large, and some bytes,
holds more points than are counted."""


def find_chunks(header: LasHeader, file: BinaryIO) -> ChunkTable:
    """The whole chunks of a layered file, each of which says how long it is."""
    layers = LAYERS[header.point_format] + header.record_length - RECORD_LENGTHS[header.point_format]
    file.seek(header.data_offset)
    table = struct.unpack("<q", file.read(8).ljust(8, b"\0"))[0]
    place, end = header.data_offset + 8, table if header.data_offset < table <= header.size else header.size
    found: list[tuple[int, int, int]] = []
    while place + header.record_length + 4 + 4 * layers <= end:
        file.seek(place + header.record_length)
        count, *sizes = struct.unpack(f"<{1 + layers}I", file.read(4 + 4 * layers))
        length = header.record_length + 4 + 4 * layers + sum(sizes)
        if not 0 < count <= LARGEST_CHUNK or place + length > end:
            break
        found.append((place, length, count))
        place += length
    return ChunkTable(*np.array(found, np.int64).reshape(-1, 3).T)
