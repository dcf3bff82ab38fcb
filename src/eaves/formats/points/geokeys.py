"""The coordinate system of GeoTIFF keys, as in LAS 1.0 to 1.3 files."""

from __future__ import annotations

import struct
import warnings

import numpy as np
import pyproj
from pyproj.exceptions import CRSError

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
