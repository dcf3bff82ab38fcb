"""The header of a LAS, LAZ or COPC file, checked against the size of the file."""

from __future__ import annotations

import math
import os
import struct
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pyproj
from numpy.typing import NDArray
from pyproj.exceptions import CRSError

from eaves.formats.errors import InputError
from eaves.formats.inputs import LAS_SUFFIXES
from eaves.formats.statements import Stated, joined, stated_by_wkt

SIGNATURE = b"LASF"
RECORD_LENGTHS = {0: 20, 1: 28, 2: 26, 3: 34, 4: 57, 5: 63, 6: 30, 7: 36, 8: 38, 9: 59, 10: 67}
"""Bytes of a point record by point format (LAS 1.4, section 2.6)."""
HEADER_LENGTHS = {0: 227, 1: 227, 2: 227, 3: 235, 4: 375, 5: 393}
"""Bytes of the header by minor version."""
VLR_HEADER, EVLR_HEADER = 54, 60
WKT_RECORD = 2112
KEPT_RECORD_BYTES = 1 << 20
"""A projection, laszip or COPC record longer than this is damage, not data."""
LARGEST_RECORD_COUNT = 10_000
BOMB_POINTS, BOMB_POINTS_PER_BYTE = 20_000_000, 50
"""Compressed points take a byte or more each; so many in so few bytes are made to fill memory."""
LARGE_AREA, SPARSEST, BESIDE = 1e8, 1e-3, 1.0
"""A box is implausible if larger than this (square units) and sparser than that (points on each), or if its
first point lies more units outside."""
COPY_AGAIN = "copy or download it again"
WRITE_AGAIN = "write it again with another tool (for example lasinfo -repair, las2las or PDAL)"
COPY_OR_WRITE = f"{COPY_AGAIN}, or {WRITE_AGAIN}"


@dataclass(frozen=True)
class LasHeader:
    """The part of a checked header that reading points needs. Coordinates are in the file's units."""

    path: Path
    size: int
    version: tuple[int, int]
    point_format: int
    record_length: int
    count: int
    data_offset: int
    scales: tuple[float, float, float]
    offsets: tuple[float, float, float]
    lowest: tuple[float, float, float]
    highest: tuple[float, float, float]
    compressed: bool
    records: tuple[tuple[str, int, bytes], ...]
    """Owner, id and data of the projection, laszip and COPC records."""
    first: tuple[float, ...] = ()
    """The first point, which compression leaves as it is; empty where there is none."""
    room: int = 0
    """Bytes between the first point and what follows the points."""
    stated: int | None = None
    """The count of a header that is wrong; `count` is right."""
    decompressed: NDArray[np.uint8] | None = field(default=None, compare=False, repr=False)
    """All records (count, record length) of a small compressed file, where several read them."""

    def record(self, owner: str, number: int) -> bytes | None:
        """The data of one record, None when there is none."""
        return next((data for who, what, data in self.records if (who, what) == (owner, number)), None)

    @property
    def laszip(self) -> bytes:
        """The record that describes the compression; empty for uncompressed points."""
        return self.record("laszip encoded", 22204) or b""

    @property
    def copc(self) -> bytes | None:
        """The COPC info record, None for other files."""
        return self.record("copc", 1)

    @property
    def projection(self) -> tuple[tuple[str, int, bytes], ...]:
        """The records of the coordinate system."""
        return tuple(record for record in self.records if record[0] == "LASF_Projection")

    @property
    def extent_is_known(self) -> bool:
        """True if the bounding box is possible: finite, ordered, within what the record can store."""
        for low, high, scale, offset in zip(
            self.lowest, self.highest, self.scales, self.offsets, strict=True
        ):
            reach = scale * 2**31 + 1.0
            if not (low <= high and abs(low - offset) <= reach and abs(high - offset) <= reach):
                return False
        return any(self.lowest) or any(self.highest)

    @property
    def extent_is_likely(self) -> bool:
        """True if the bounding box holds the first point, and is not far too large for so few points."""
        width, depth = self.highest[0] - self.lowest[0], self.highest[1] - self.lowest[1]
        if width * depth > LARGE_AREA and self.count < SPARSEST * width * depth:
            return False
        return not any(self.first) or all(
            low - BESIDE <= value <= high + BESIDE
            for low, value, high in zip(self.lowest, self.first, self.highest, strict=True)
        )

    def system(self) -> Stated:
        """All that the file says of its coordinate system.

        Raises
        ------
        InputError
            When it says what cannot be read, or two statements contradict.
        """
        keys = {number: data for owner, number, data in self.records if owner == "LASF_Projection"}
        text = keys.get(WKT_RECORD, b"").rstrip(b"\0 ").decode("utf-8", "replace")
        by_keys = Stated(*crs_of_geokeys(keys), "GeoTIFF keys")
        if not text:
            return by_keys
        middle = [(low + high) / 2 for low, high in zip(self.lowest, self.highest, strict=True)]
        return joined(self.path, stated_by_wkt(self.path, text), by_keys, (middle[0], middle[1]))


def read_las_header(path: Path, file: BinaryIO) -> LasHeader | None:
    """The checked header of an open file; only the header and the records that matter are read. None when
    the file neither begins as LAS, LAZ and COPC do nor is named so.

    Raises
    ------
    InputError
        When the header contradicts itself or the size of the file.
    """
    size = os.fstat(file.fileno()).st_size
    file.seek(0)
    head = file.read(375)
    if head[:4] != SIGNATURE and path.suffix.lower() not in LAS_SUFFIXES:
        return None
    if head[:4] != SIGNATURE:
        raise InputError.about(
            path, f"begins with {head[:4]!r}, not with LASF", "give a LAS, LAZ or COPC file"
        )
    if len(head) < 227:
        raise InputError.about(path, f"is cut off after {size} bytes, within its header", COPY_AGAIN)
    return _parse(path, file, head, size)


def _parse(path: Path, file: BinaryIO, head: bytes, size: int) -> LasHeader:
    def refuse(rule: str, remedy: str = WRITE_AGAIN) -> InputError:
        return InputError.about(path, rule, remedy)

    major, minor = head[24], head[25]
    header_size, data_offset, record_count = struct.unpack_from("<HII", head, 94)
    format_byte, record_length, count = struct.unpack_from("<BHI", head, 104)
    scales, offsets = struct.unpack_from("<3d", head, 131), struct.unpack_from("<3d", head, 155)
    east, west, north, south, top, bottom = struct.unpack_from("<6d", head, 179)
    point_format, compressed = format_byte & 0x3F, bool(format_byte & 0xC0)
    if major != 1 or minor not in HEADER_LENGTHS:
        raise refuse(f"is LAS {major}.{minor}, known are 1.0 to 1.5")
    if header_size < HEADER_LENGTHS[minor] or header_size > data_offset:
        raise refuse(f"states a header of {header_size} bytes before points at byte {data_offset}")
    if data_offset > size:
        raise refuse(f"states points from byte {data_offset} and has {size} bytes", COPY_AGAIN)
    if point_format not in RECORD_LENGTHS:
        raise refuse(f"has point format {point_format}, known are 0 to 10")
    if record_length < RECORD_LENGTHS[point_format]:
        raise refuse(
            f"states point records of {record_length} bytes, format {point_format} needs "
            f"{RECORD_LENGTHS[point_format]}"
        )
    if not all(math.isfinite(value) and value != 0 for value in scales):
        raise refuse(f"has coordinate scales {scales}, which must be finite and not zero")
    if not all(math.isfinite(value) for value in offsets):
        raise refuse(f"has coordinate offsets {offsets}, which must be finite")
    first_evlr = evlr_count = 0
    if minor >= 4:
        first_evlr, evlr_count, long_count = struct.unpack_from("<QIQ", head, 235)
        count = long_count or count
    records = _read_vlrs(file, path, header_size, record_count, data_offset, VLR_HEADER)
    records += _read_vlrs(file, path, first_evlr, evlr_count, size, EVLR_HEADER)
    behind = struct.unpack_from("<Q", head, 227)[0] if minor >= 3 and len(head) >= 235 else 0
    ends = [place for place in (behind, first_evlr if evlr_count else 0) if data_offset < place < size]
    room = min([size, *ends]) - data_offset
    header = LasHeader(
        path=path,
        size=size,
        version=(major, minor),
        point_format=point_format,
        record_length=record_length,
        count=count,
        data_offset=data_offset,
        scales=scales,
        offsets=offsets,
        lowest=(west, south, bottom),
        highest=(east, north, top),
        compressed=compressed,
        records=records,
        room=room,
        first=_first_point(file, data_offset + (8 if compressed else 0), scales, offsets) if count else (),
    )
    _check_point_bytes(header)
    return header


def _first_point(
    file: BinaryIO, start: int, scales: tuple[float, ...], offsets: tuple[float, ...]
) -> tuple[float, ...]:
    """The coordinates stored at a byte (behind the place of the chunk table, where there is one)."""
    file.seek(start)
    raw = file.read(12)
    if len(raw) < 12:
        return ()
    stored = zip(struct.unpack("<3i", raw), scales, offsets, strict=True)
    return tuple(number * scale + offset for number, scale, offset in stored)


def _check_point_bytes(header: LasHeader) -> None:
    path, space = header.path, header.size - header.data_offset
    if not header.compressed:
        if header.count * header.record_length > space:
            held = space // header.record_length
            raise InputError.about(
                path,
                f"is cut off: the header states {header.count} points, the file holds {held}",
                COPY_OR_WRITE,
            )
        return
    _check_laszip(header)
    if header.count > BOMB_POINTS and header.count > BOMB_POINTS_PER_BYTE * space:
        raise InputError.about(
            path,
            f"states {header.count} points in {space} bytes, which no survey compresses to",
            WRITE_AGAIN,
        )


def _check_laszip(header: LasHeader) -> None:
    """Compressor 1 (one stream), 2 (by chunk) or 3 (by chunk and layer), whose items add up to the record
    (LASzip VLR)."""
    data = header.laszip
    if len(data) < 34:
        raise InputError.about(header.path, "is compressed but has no laszip record", WRITE_AGAIN)
    compressor, chunk_size, item_count = (
        *struct.unpack_from("<H", data, 0),
        *struct.unpack_from("<I", data, 12),
        *struct.unpack_from("<H", data, 32),
    )
    if compressor not in (1, 2, 3) or (chunk_size == 0 and compressor > 1):
        raise InputError.about(
            header.path,
            f"is compressed by method {compressor} in chunks of {chunk_size} points, which this reader "
            "does not know",
            WRITE_AGAIN,
        )
    sizes = [
        struct.unpack_from("<H", data, 36 + 6 * k)[0] for k in range(min(item_count, (len(data) - 34) // 6))
    ]
    if len(sizes) != item_count or sum(sizes) != header.record_length:
        raise InputError.about(
            header.path,
            f"compresses records of {sum(sizes)} bytes but states {header.record_length}",
            WRITE_AGAIN,
        )


def _read_vlrs(
    file: BinaryIO, path: Path, start: int, count: int, end: int, header_length: int
) -> tuple[tuple[str, int, bytes], ...]:
    """The records that matter among `count` ones from byte `start`, none of which may pass byte `end`."""
    if count > LARGEST_RECORD_COUNT:
        raise InputError.about(path, f"announces {count} variable length records", COPY_OR_WRITE)
    kept: list[tuple[str, int, bytes]] = []
    for _ in range(count):
        if start + header_length > end:  # before seeking: no file reaches 2^63
            raise InputError.about(
                path, f"has a variable length record cut off at byte {start}", COPY_OR_WRITE
            )
        file.seek(start)
        head = file.read(header_length)
        owner = head[2:18].split(b"\0")[0].decode("ascii", "replace")
        number, length = struct.unpack_from("<HQ" if header_length == EVLR_HEADER else "<HH", head, 18)
        if start + header_length + length > end:
            raise InputError.about(
                path,
                f"has a variable length record of {length} bytes at byte {start}, past its end",
                COPY_OR_WRITE,
            )
        wanted = owner in ("LASF_Projection", "laszip encoded") or (owner, number) == ("copc", 1)
        if wanted and length <= KEPT_RECORD_BYTES:
            kept.append((owner, number, file.read(length)))
        start += header_length + length
    return tuple(kept)


DIRECTORY, DOUBLES, ASCII = 34735, 34736, 34737
"""Record ids of user `LASF_Projection` (LAS 1.4, section 3.1) and TIFF tags of the same meaning."""

PROJECTED_CODE, LINEAR_UNIT, VERTICAL_CODE, VERTICAL_UNIT = 3072, 3076, 4096, 4099
UNIT_METRES = {9001: 1.0, 9002: 0.3048, 9003: 1200 / 3937}
"""EPSG units of length: metre, international foot, US survey foot."""
EPSG_CODES = range(1024, 32767)
"""Values that are EPSG codes (OGC 19-008r4, requirement 'ProjectedCRSGeoKey')."""


def crs_of_geokeys(records: dict[int, bytes]) -> tuple[pyproj.CRS | None, float | None]:
    """The system of GeoTIFF key records (id → bytes) and the vertical unit (m) where a key names it.

    A registered projection is looked up; one described by parameters is left to GDAL, which reads the
    keys from a TIFF of one pixel made in memory.
    """
    directory = records.get(DIRECTORY, b"")
    values = np.frombuffer(directory[: len(directory) // 8 * 8], "<u2").reshape(-1, 4)[1:]
    keys = {int(key): int(value) for key, location, _, value in values if location == 0}
    vertical_unit = UNIT_METRES.get(keys.get(VERTICAL_UNIT, 0))
    code, unit = keys.get(PROJECTED_CODE, 0), UNIT_METRES.get(keys.get(LINEAR_UNIT, 0))
    crs = _registered(str(code)) if code in EPSG_CODES else None
    if crs is None or (unit is not None and abs(crs.axis_info[0].unit_conversion_factor - unit) > 1e-9):
        crs = _described(records)
    elif keys.get(VERTICAL_CODE, 0) in EPSG_CODES:
        crs = _registered(f"{code}+{keys[VERTICAL_CODE]}") or crs
    return crs, vertical_unit


def _registered(code: str) -> pyproj.CRS | None:
    try:
        return pyproj.CRS.from_user_input(f"EPSG:{code}")
    except CRSError:
        return None


def _described(records: dict[int, bytes]) -> pyproj.CRS | None:
    import rasterio
    from rasterio.errors import NotGeoreferencedWarning, RasterioError
    from rasterio.io import MemoryFile

    try:
        with (
            warnings.catch_warnings(),
            rasterio.Env(GTIFF_REPORT_COMPD_CS=True),
            MemoryFile(_one_pixel(records)) as memory,
            memory.open() as image,
        ):
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            return pyproj.CRS.from_wkt(image.crs.to_wkt()) if image.crs else None
    except (RasterioError, CRSError):
        return None


def _one_pixel(records: dict[int, bytes]) -> bytes:
    """A TIFF of one pixel (TIFF 6.0, section 2) with the key records as its tags."""
    short, long, text, double = 3, 4, 2, 12
    size = {short: 2, long: 4, text: 1, double: 8}
    one, eight = struct.pack("<I", 1), struct.pack("<I", 8)
    tags: list[tuple[int, int, bytes]] = [
        (256, long, one),  # width
        (257, long, one),  # height
        (258, long, eight),  # bits a sample
        (259, long, one),  # no compression
        (262, long, one),  # black is zero
        (273, long, eight),  # the pixel's place: any byte of the file will do
        (277, long, one),  # samples a pixel
        (278, long, one),  # rows a strip
        (279, long, one),  # bytes a strip
        (33550, double, struct.pack("<3d", 1, 1, 0)),  # pixel size
        (33922, double, bytes(48)),  # tie point
    ]
    kinds = {DIRECTORY: short, DOUBLES: double, ASCII: text}
    tags += [(tag, kind, records[tag]) for tag, kind in kinds.items() if records.get(tag)]
    entries, blobs = b"", b""
    start = 8 + 2 + 12 * len(tags) + 4
    for tag, kind, data in tags:
        value = data.ljust(4, b"\0") if len(data) <= 4 else struct.pack("<I", start + len(blobs))
        blobs += data + bytes(len(data) % 2) if len(data) > 4 else b""
        entries += struct.pack("<HHI", tag, kind, len(data) // size[kind]) + value
    return b"II*\0" + eight + struct.pack("<H", len(tags)) + entries + bytes(4) + blobs
