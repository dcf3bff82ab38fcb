"""Points of a scan with what its records state of pulses, for the figures of the scan alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eaves.formats.errors import InputError
from eaves.formats.points.las import (
    FIRST_LAYERED_FORMAT,
    decode_records,
    iter_records,
    readable_fields,
    returns_and_class,
)
from eaves.formats.points.las_header import LasHeader
from eaves.formats.points.plausible import TIME_AT, height_ratios
from eaves.formats.points.source import Source, has_coordinates, iter_chunks
from eaves.model import Points, Values

FLOWN = {
    number: [18, 19, *range(22, 30)] if number > 5 else [16, *(range(20, 28) if number in TIME_AT else ())]
    for number in range(11)
}
"""Bytes of the angle and the time of a point by format."""
COLOURS_AT = {2: 20, 3: 28, 5: 28, 7: 30, 8: 30, 10: 30}
"""First byte of the three colours by format."""


@dataclass(frozen=True, eq=False)
class Sample:
    """Points (N,) of a scan with what their records state, and the `height_ratios` (K,) of their pulses."""

    xyz: Points
    number: NDArray[np.uint8]
    of: NDArray[np.uint8]
    classes: NDArray[np.uint8]
    strip: NDArray[np.uint16]
    ratios: Values
    intensity: bool
    pulses: bool
    colours: bool
    read: int


def read_sample(source: Source, part: tuple[int, int], size: int) -> Iterator[Sample]:
    """One run of the records of an input, piece by piece."""
    header = source.layout
    if not isinstance(header, LasHeader):
        left = size if part[1] > 1 else source.count
        for chunk in iter_chunks(source, chunk_points=size):
            none, nothing = np.zeros(len(chunk), np.uint8), np.zeros(0)
            classes = none if chunk.classification is None else chunk.classification
            strips = none.astype(np.uint16)
            yield Sample(chunk.xyz, none, none, classes, strips, nothing, False, False, False, len(chunk))
            left -= len(chunk)
            if left <= 0:
                return
        return
    try:
        fields = readable_fields(header)
    except InputError:  # of damaged extra dimensions; what is wanted of them will say so
        fields = {}
    byte = 20 if header.point_format >= FIRST_LAYERED_FORMAT else 18
    for position, records in iter_records(header, size, part=part):
        xyz = decode_records(header, position, records).xyz
        use = has_coordinates(xyz)
        use &= has_coordinates(source.to_metres(xyz))
        number, of, classes, _ = returns_and_class(header.point_format, records[use])
        strip = np.ascontiguousarray(records[use, byte : byte + 2]).view("<u2")[:, 0]
        pulses = records[:, FLOWN[header.point_format]].any() or len(np.unique(strip)) > 1
        intensity = bool(records[:, 12:14].any())
        at = COLOURS_AT.get(header.point_format)
        colours = at is not None and bool(records[:, at : at + 6].any())
        ratios = np.zeros(0)
        if fields.keys() >= {"gps_time", "scan_angle"}:
            split = of > 1
            several = np.flatnonzero(use)[split]
            time, angle = (fields[name](records[several]) for name in ("gps_time", "scan_angle"))
            ratios = height_ratios(xyz[several], time, angle, number[split], of[split])
        known = intensity, bool(pulses), colours
        yield Sample(xyz[use], number, of, classes, strip, ratios, *known, len(records))
