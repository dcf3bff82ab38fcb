"""Points of LAS, LAZ and COPC files, in the file's order and units; only the fields a detector needs are
read."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial, reduce
from operator import or_
from pathlib import Path
from typing import BinaryIO

import laspy
import lazrs
import numpy as np
from numpy.typing import NDArray

from eaves.formats.errors import InputError
from eaves.formats.points.chunk import Chunk
from eaves.formats.points.las_header import COPY_AGAIN, LasHeader
from eaves.formats.points.laz import (
    chunks_within,
    decompress,
    is_newer_than_lazrs,
    read_by_laszip,
    read_chunk_table,
)
from eaves.model import Integers, Mask, Rectangle, Values

NEEDED = (
    lazrs.SELECTIVE_DECOMPRESS_XY_RETURNS_CHANNEL
    | lazrs.SELECTIVE_DECOMPRESS_Z
    | lazrs.SELECTIVE_DECOMPRESS_CLASSIFICATION
    | lazrs.SELECTIVE_DECOMPRESS_FLAGS
)
LAYERS_OF = {
    "intensity": lazrs.SELECTIVE_DECOMPRESS_INTENSITY,
    "scan_angle": lazrs.SELECTIVE_DECOMPRESS_SCAN_ANGLE,
    "point_source_id": lazrs.SELECTIVE_DECOMPRESS_POINT_SOURCE_ID,
    "gps_time": lazrs.SELECTIVE_DECOMPRESS_GPS_TIME,
    **dict.fromkeys(("red", "green", "blue"), lazrs.SELECTIVE_DECOMPRESS_RGB),
    "nir": lazrs.SELECTIVE_DECOMPRESS_NIR,
}
"""Other fields of points and what is decompressed for them; of extra dimensions it is `EXTRA`."""
EXTRA = lazrs.SELECTIVE_DECOMPRESS_ALL_EXTRA_BYTES
SCAN_ANGLES = {"scan_angle_rank": 1.0, "scan_angle": 0.006}
"""Dimension → unit (degrees), by LAS 1.4, tables 7 and 16."""
EVERYTHING = lazrs.SELECTIVE_DECOMPRESS_ALL
WHOLE = (0, 1)
"""The one part of a file that is not shared."""
TIMELESS, TIME_PLACE = (0, 2), (20, 22)
"""Point formats without times; the byte at which times begin in formats 1 to 5, and in those from 6 on."""
FIRST_LAYERED_FORMAT = 6
"""From this point format on, classes have a byte of their own (LAS 1.4, tables 7 and 16)."""


def iter_las(
    header: LasHeader,
    rectangle: Rectangle | None,
    size: int,
    part: tuple[int, int] = WHOLE,
    copy: BinaryIO | None = None,
    fields: Sequence[str] = (),
) -> Iterator[Chunk]:
    """Chunks of about `size` points; with a rectangle (west, south, east, north), of COPC only the nodes
    it meets. `copy` receives the records, whole; `fields` are read as well."""
    selection = reduce(or_, (LAYERS_OF.get(name, EXTRA) for name in ("gps_time", *fields)), NEEDED)
    known = {"intensity": intensity_of} if {*fields} <= {"intensity"} else readable_fields(header)
    for position, records in iter_records(header, size, rectangle, EVERYTHING if copy else selection, part):
        if copy is not None:
            copy.write(records.data)
        chunk = decode_records(header, position, records)
        yield replace(chunk, fields={name: known[name](records) for name in fields}) if fields else chunk


def intensity_of(records: NDArray[np.uint8]) -> Values:
    """The intensities (N,) of records (N, record length): they lie alike in all of them."""
    return np.ascontiguousarray(records[:, 12:14]).view("<u2")[:, 0].astype(np.float64)


def readable_fields(header: LasHeader) -> dict[str, Callable[[NDArray[np.uint8]], Values]]:
    """The fields of a file beside coordinates, returns and class, each with what takes its values (N,) out of
    records (N, record length).

    Raises
    ------
    InputError
        When the records that describe the extra dimensions are damaged.
    """
    try:
        with header.path.open("rb") as file:
            layout = laspy.LasHeader.read_from(file).point_format
    except Exception as error:  # laspy raises whatever its parts raise
        raise InputError.about(header.path, f"its fields are not described ({error})", COPY_AGAIN) from None
    record = layout.dtype()

    def values_of(name: str, records: NDArray[np.uint8]) -> Values:
        whole = np.ascontiguousarray(records[:, : record.itemsize]).reshape(-1).view(record)
        values = np.asarray(laspy.PackedPointRecord(whole, layout)[name], np.float64)
        return values * SCAN_ANGLES.get(name, 1.0)

    there = {*LAYERS_OF, *SCAN_ANGLES, *layout.extra_dimension_names}
    names = [name for name in record.names or () if name in there and record[name].ndim == 0]
    return {"scan_angle" if name in SCAN_ANGLES else name: partial(values_of, name) for name in names}


def iter_records(
    header: LasHeader,
    size: int,
    rectangle: Rectangle | None = None,
    selection: int = EVERYTHING,
    part: tuple[int, int] = WHOLE,
) -> Iterator[tuple[Integers, NDArray[np.uint8]]]:
    """Positions (N,) and point records (N, record length) as bytes, decompressed, about `size` at a time.

    `part` (k, n) selects the k-th of n runs of records; a COPC file is read node by node in either case.
    """
    if not header.count:
        return
    if header.decompressed is not None and rectangle is None:
        start, end = (header.count * (part[0] + step) // part[1] for step in (0, 1))
        for first in range(start, end, size):
            last = min(first + size, end)
            yield np.arange(first, last), header.decompressed[first:last]
        return
    with header.path.open("rb") as file:
        if not header.compressed:
            start, end = (header.count * (part[0] + step) // part[1] for step in (0, 1))
            file.seek(header.data_offset + start * header.record_length)
            for first in range(start, end, size):
                number = min(size, end - first)
                data = file.read(number * header.record_length)
                if len(data) < number * header.record_length:
                    raise InputError.about(header.path, f"ends before point {first + number}", COPY_AGAIN)
                records = np.frombuffer(data, np.uint8).reshape(number, header.record_length)
                yield np.arange(first, first + number), records
            return
        if is_newer_than_lazrs(header):
            if part[0] == 0:
                yield from read_by_laszip(header, size)
            return
        table = read_chunk_table(file, header)
        which = np.arange(len(table.points))
        if rectangle is not None and header.copc is not None:
            which = chunks_within(file, header, table, rectangle)
        start, end = (len(which) * (part[0] + step) // part[1] for step in (0, 1))
        if start < end:
            yield from decompress(file, header, table, which[start:end], selection, size)


def iter_copied(
    header: LasHeader, size: int, copies: Sequence[str | Path]
) -> Iterator[tuple[int, NDArray[np.uint8]]] | None:
    """As `iter_records` of a compressed file, in the same pieces: the place of the first record of each and
    the records, from files that together hold all of them decompressed; None where they do not."""
    bytes_there = sum(Path(path).stat().st_size for path in copies)
    if not header.compressed or not header.count or bytes_there != header.count * header.record_length:
        return None
    with header.path.open("rb") as file:
        table = read_chunk_table(file, header)
    counts = [int(table.points[run].sum()) for run in table.runs(np.arange(len(table.points)), size)]
    return read_runs(copies, counts, header.record_length)


def read_runs(
    paths: Sequence[str | Path], counts: Sequence[int], length: int
) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """Runs of so many records of a length, of files that hold nothing else, one after the other."""
    left, first = iter(paths), 0
    with ExitStack() as stack:
        file = stack.enter_context(open(next(left), "rb"))
        for count in counts:
            data = file.read(count * length)
            while len(data) < count * length:
                file = stack.enter_context(open(next(left), "rb"))
                data += file.read(count * length - len(data))
            yield first, np.frombuffer(data, np.uint8).reshape(count, length)
            first += count


def decode_records(header: LasHeader, position: Integers, records: NDArray[np.uint8]) -> Chunk:
    """The points of records (N, record length) in the file's units."""
    stored = [
        np.ndarray(len(records), "<i4", records, 4 * axis, (header.record_length,)) for axis in range(3)
    ]
    xyz = np.empty((len(records), 3))
    with np.errstate(over="ignore", invalid="ignore"):  # such points are left out, and counted
        for axis in range(3):
            np.multiply(stored[axis], header.scales[axis], out=xyz[:, axis])
            xyz[:, axis] += header.offsets[axis]
    moment = moments_of(header.point_format, records)
    return Chunk(xyz, position, *returns_and_class(header.point_format, records), moment)


def moments_of(point_format: int, records: NDArray[np.uint8]) -> NDArray[np.uint16] | None:
    """Digests (N,) of the times in LAS records (N, record length); None for a format without."""
    if point_format in TIMELESS:
        return None
    place = TIME_PLACE[point_format >= FIRST_LAYERED_FORMAT]
    bits = np.ndarray(len(records), "<u8", records, place, (records.shape[1],))
    folded = bits ^ bits >> np.uint64(32)
    return np.asarray(folded ^ folded >> np.uint64(16)).astype(np.uint16)


def returns_and_class(
    point_format: int, records: NDArray[np.uint8]
) -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.uint8], Mask]:
    """Of LAS records (N, record length): number of the return, of returns of the pulse, class and whether the
    point is withheld (N,), after LAS 1.4, tables 7 (formats 0 to 5) and 16 (6 to 10)."""
    layered = point_format >= FIRST_LAYERED_FORMAT
    bits, shift = (np.uint8(15), np.uint8(4)) if layered else (np.uint8(7), np.uint8(3))
    returns, flags = records[:, 14], records[:, 15]
    classes = records[:, 16].copy() if layered else flags & np.uint8(31)
    return returns & bits, returns >> shift & bits, classes, (flags & np.uint8(4 if layered else 128)) != 0
