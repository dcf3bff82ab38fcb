"""Points of a scan with what its records state of pulses, for the figures of the scan alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eaves.formats.points.chunk import Chunk
from eaves.formats.points.las import iter_records
from eaves.formats.points.las_header import LasHeader
from eaves.formats.points.plausible import TIME_AT
from eaves.formats.points.source import Source, has_coordinates, iter_chunks
from eaves.model import Points

RECORD_FIELDS = {False: (18, np.uint8(7), np.uint8(3)), True: (20, np.uint8(15), np.uint8(4))}
"""Byte of the strip's number, and bits and place of the returns, in formats 0 to 5 and 6 to 10 (LAS 1.4)."""
FLOWN = {
    number: [18, 19, *range(22, 30)] if number > 5 else [16, *(range(20, 28) if number in TIME_AT else ())]
    for number in range(11)
}
"""Bytes of the angle and the time of a point by format."""


@dataclass(frozen=True, eq=False)
class Sample:
    """Points (N,) of a scan with what their records state."""

    xyz: Points
    number: NDArray[np.uint8]
    of: NDArray[np.uint8]
    classes: NDArray[np.uint8]
    strip: NDArray[np.uint16]
    intensity: bool
    pulses: bool
    read: int


def read_sample(source: Source, part: tuple[int, int], size: int) -> Iterator[Sample]:
    """One run of the records of an input, piece by piece."""
    header = source.layout
    if not isinstance(header, LasHeader):
        left = size if part[1] > 1 else source.count
        for chunk in iter_chunks(source, chunk_points=size):
            yield _of_text(chunk)
            left -= len(chunk)
            if left <= 0:
                return
        return
    layered = header.point_format >= 6
    byte, bits, shift = RECORD_FIELDS[layered]
    for _, records in iter_records(header, size, part=part):
        raw = [
            np.ascontiguousarray(records[:, 4 * axis : 4 * axis + 4]).view("<i4")[:, 0] for axis in range(3)
        ]
        xyz = (np.column_stack(raw) * header.scales + header.offsets) * source.system.unit_m
        use = has_coordinates(xyz)
        strip = np.ascontiguousarray(records[use, byte : byte + 2]).view("<u2")[:, 0]
        flown = records[:, FLOWN[header.point_format]]
        yield Sample(
            xyz[use],
            records[use, 14] & bits,
            records[use, 14] >> shift & bits,
            records[use, 16] if layered else records[use, 15] & np.uint8(31),
            strip,
            bool(records[:, 12:14].any()),
            bool(flown.any() or len(np.unique(strip)) > 1),
            len(records),
        )


def _of_text(chunk: Chunk) -> Sample:
    """Points of a file that states no returns."""
    none = np.zeros(len(chunk), np.uint8)
    classes = none if chunk.classification is None else chunk.classification
    return Sample(chunk.xyz, none, none, classes, none.astype(np.uint16), False, False, len(chunk))
