"""Headers that count fewer points than the file holds."""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import BinaryIO

import numpy as np

from eaves.formats.errors import InputError
from eaves.formats.points.las import FIRST_LAYERED_FORMAT, returns_and_class
from eaves.formats.points.las_header import WRITE_AGAIN, LasHeader
from eaves.formats.points.laz import VARIABLE_CHUNKS, read_chunk_table

LOOKED_AT = 1000
"""Number of records behind the last one that the header counts that are looked at."""
LIKELY_POINTS = 0.9
"""Share of them whose return number is within the number of returns from which they are points."""


def corrected(header: LasHeader, file: BinaryIO) -> LasHeader:
    """The header with the number of points that the file holds, where that can be known.

    A writer that crashed leaves a count of zero, or that of its last flush.

    Raises
    ------
    InputError
        When points are there that the header does not count, and their number is not known.
    """
    if header.compressed:
        return replace_count(header, file)
    held = header.room // header.record_length
    more = header.count < held and are_points(header, file, held)
    return replace(header, count=held, stated=header.count) if more else header


def are_points(header: LasHeader, file: BinaryIO, held: int) -> bool:
    """True if the records after the last point that the header counts are points, too."""
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
            raise InputError.about(header.path, "holds points, but its header counts none", WRITE_AGAIN)
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
        WRITE_AGAIN,
    )


LARGER, SMALL_CHUNK = 1.5, 1000
"""A chunk of points is compressed to less than its size; one that is so many times as large, and some bytes,
holds more points than are counted."""
