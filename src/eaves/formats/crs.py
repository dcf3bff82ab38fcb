"""The coordinate system and its units, from a file's records or a user's text."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import Any

import pyproj
from pyproj.crs import CompoundCRS
from pyproj.database import get_units_map
from pyproj.enums import WktVersion
from pyproj.exceptions import CRSError

from eaves.formats.errors import InputError
from eaves.model import CoordinateSystem

LENGTHS = {"metres": 1.0, "feet": 0.3048, "us-feet": 1200 / 3937}
"""Words that stand for a local plane in a unit (m), where data have no place on Earth."""
CERTAIN = 100
"""PROJ's confidence (%) in a registered system with nothing that differs, the axes neither."""
SAME_UNIT = 1e-9
"""Relative difference under which two units are one: the two feet differ by 2e-6."""


def crs_text(crs: Any) -> str:
    """The text, as `parse_crs` takes it, of a code, of a text, or of what geopandas, pyproj and rasterio name
    a system by."""
    return crs.to_wkt() if hasattr(crs, "to_wkt") else f"EPSG:{crs}" if isinstance(crs, int) else str(crs)


def parse_crs(text: str, path: str | Path = "--crs") -> pyproj.CRS:
    """The system a text names: `EPSG:28992`, `28992+5709`, WKT, PROJJSON, the path of a file with one
    of the last, or `metres`, `feet`, `us-feet` for a local plane.

    Raises
    ------
    InputError
        When it names none; `path` is what the message blames.
    """
    code = text.strip()
    if code in LENGTHS:
        return pyproj.CRS.from_wkt(
            f'ENGCRS["local plane in {code}",EDATUM["local"],CS[Cartesian,2],AXIS["x",east],AXIS["y",north],'
            f'LENGTHUNIT["{code}",{LENGTHS[code]!r}]]'
        )
    try:
        if not set(code) & set("[{") and Path(code).is_file():
            code = Path(code).read_text(encoding="utf-8").strip()
        if code.replace("+", "").isdigit():
            code = f"EPSG:{code}"
        return pyproj.CRS.from_user_input(code)
    except (CRSError, OSError, UnicodeDecodeError):
        shown = text if len(text) < 60 else text[:57] + "..."
        raise InputError.about(
            path,
            f"'{shown}' names no coordinate system",
            "give an EPSG code (EPSG:28992), a compound one (28992+5709), a file with WKT or PROJJSON, or "
            "metres, feet or us-feet of a local plane",
        ) from None


def system_of(
    crs: pyproj.CRS,
    path: str | Path,
    centre: tuple[float, float],
    vertical_unit: float | None = None,
    named: bool = True,
) -> CoordinateSystem:
    """The system of data whose middle is `centre` (in the system's own units).

    A system without heights is taken to measure them in its horizontal unit, unless `vertical_unit` (m) is
    known. Unless it is to be `named` it has no code, which PROJ may have to look for in its whole registry.

    Raises
    ------
    InputError
        When the system is not a plane one.
    """
    plain, horizontal = unbound(crs), plane_part(crs)
    parts = plain.sub_crs_list if plain.is_compound else [plain]
    if horizontal.is_geographic:
        raise InputError.about(
            path, f"coordinates are in degrees ({horizontal.name})", degrees_remedy(*centre)
        )
    if not (horizontal.is_projected or horizontal.is_engineering or horizontal.is_derived):
        raise InputError.about(
            path,
            f"{horizontal.name} is a {horizontal.type_name}, not a plane system",
            "reproject the data to a projected system",
        )
    axes = [axis for part in parts for axis in part.axis_info]
    flat = [axis.unit_conversion_factor for axis in axes if axis.direction not in ("up", "down")]
    upright = [axis.unit_conversion_factor for axis in axes if axis.direction in ("up", "down")]
    unit = flat[0] if flat else 1.0
    height_unit = upright[0] if upright else unit
    if not all(math.isfinite(length) and length > 0 for length in (unit, height_unit)):
        raise InputError.about(
            path,
            f"{horizontal.name} has units of {unit:g} m, {height_unit:g} m upright",
            "pass the right system with crs= or --crs",
        )
    if vertical_unit is not None and not is_same_unit(vertical_unit, height_unit):
        height_unit, plain = vertical_unit, with_heights_in(horizontal, vertical_unit)
    code = code_of(plain) if named else None
    return CoordinateSystem(plain.to_wkt(WktVersion.WKT2_2019), unit, height_unit, code)


def unbound(crs: pyproj.CRS) -> pyproj.CRS:
    """A system without the way to another one that it may be bound to."""
    return crs.source_crs if crs.is_bound and crs.source_crs is not None else crs


def plane_part(crs: pyproj.CRS) -> pyproj.CRS:
    """The plane part of a system."""
    plain = unbound(crs)
    return unbound(plain.sub_crs_list[0] if plain.is_compound else plain)


def with_heights_in(horizontal: pyproj.CRS, unit: float) -> pyproj.CRS:
    """The plane system with heights above an unknown surface, measured in `unit` (m)."""
    heights = pyproj.CRS.from_wkt(
        'VERTCRS["height",VDATUM["unknown"],CS[vertical,1],'
        f'AXIS["gravity-related height (H)",up],LENGTHUNIT["unit",{unit!r}]]'
    )
    return compound(horizontal, heights)


def compound(horizontal: pyproj.CRS, heights: pyproj.CRS) -> pyproj.CRS:
    """A plane or geographic system together with one of heights."""
    return CompoundCRS(f"{horizontal.name} + {heights.name}", [horizontal, heights])


@lru_cache(maxsize=32)
def epsg_of(crs: pyproj.CRS) -> int | None:
    """The system's EPSG code, None for one that is not registered; looked up once, for it takes a while.

    WKT 1 often says nothing of axes. In Esri's form, which never does, PROJ knows a system by its name and
    its parameters, also one of two with the same plane and another order of axes (31468 and 5678).
    """
    code: int | None = crs.to_epsg(min_confidence=CERTAIN)
    if code is None and crs.is_projected:
        code = pyproj.CRS.from_wkt(crs.to_wkt(WktVersion.WKT1_ESRI)).to_epsg()
    return code or crs.to_epsg()


def code_of(crs: pyproj.CRS) -> str | None:
    """`EPSG:7415`, `EPSG:28992+5703` for an unregistered pair, the horizontal code alone, or None."""
    whole = epsg_of(crs)
    if whole is not None or not crs.is_compound:
        return None if whole is None else f"EPSG:{whole}"
    codes = [epsg_of(part) for part in crs.sub_crs_list]
    known = codes[: codes.index(None)] if None in codes else codes
    return "EPSG:" + "+".join(str(code) for code in known) if known else None


def pyproj_crs(system: CoordinateSystem) -> pyproj.CRS | None:
    """The system as pyproj's object, None for a local one."""
    return None if system.wkt is None else pyproj.CRS.from_wkt(system.wkt)


def horizontal_crs(system: CoordinateSystem) -> pyproj.CRS | None:
    """The plane part of the system, None for a local one."""
    crs = pyproj_crs(system)
    return crs.sub_crs_list[0] if crs is not None and crs.is_compound else crs


def unit_lengths(system: CoordinateSystem) -> tuple[float, float]:
    """Metres a unit, along the ground and upright, of the system as it is registered."""
    if system.wkt is None:
        return system.horizontal_unit_m, system.vertical_unit_m
    known = system_of(parse_crs(system.wkt), "", (0.0, 0.0))
    return known.horizontal_unit_m, known.vertical_unit_m


def name_units(system: CoordinateSystem) -> dict[str, str]:
    """EPSG's names of the units of results: of geometry and rasters along the ground and upright, which are
    those of the system, and of attributes, which are metres whatever the system is."""
    names = map(name_of_unit, unit_lengths(system))
    return dict(zip(("geometry", "heights", "attributes"), (*names, "metre"), strict=True))


def unit_of(crs: pyproj.CRS) -> float:
    """Metres in the unit of a system's first axis; 1 where it has none."""
    return float(crs.axis_info[0].unit_conversion_factor) if crs.axis_info else 1.0


def is_same_unit(one: float, other: float) -> bool:
    """True if two lengths of a unit (m) are of one unit."""
    return abs(one - other) <= SAME_UNIT * other


def name_of_unit(length: float) -> str:
    """EPSG's name of the unit of a length (m)."""
    known = get_units_map("EPSG", "linear").values()
    return str(min(known, key=lambda one: abs(one.conv_factor - length)).name)


def degrees_remedy(longitude: float, latitude: float) -> str:
    """The remedy for data in degrees: the EPSG code of the UTM zone of the place."""
    if not (-180 <= longitude <= 180 and -90 <= latitude <= 90):
        return "the coordinates do not fit that system; pass the right one with crs= or --crs"
    zone = min(int((longitude + 180) // 6) + 1, 60)
    code = (32600 if latitude >= 0 else 32700) + zone
    return f"reproject the data to metres first, for example to UTM zone {zone}, EPSG:{code}"


def agree(systems: Iterable[tuple[Path, CoordinateSystem]]) -> CoordinateSystem:
    """The one system several files share; heights may be described in some of them only.

    Raises
    ------
    InputError
        When units or projections differ, or only some files have a system.
    """
    pairs = list(systems)
    chosen_path, chosen = max(pairs, key=lambda pair: (pair[1].wkt is not None, len(pair[1].wkt or "")))
    remedy = (
        "run them apart, pass --to-crs CODE to transform all to one, or, if they are in one, pass that "
        "as crs= or --crs"
    )
    for path, system in pairs:
        for unit, others in zip(system.unit_m, chosen.unit_m, strict=True):
            if not is_same_unit(unit, others):
                raise InputError.about(
                    path, f"its units ({unit:.6g} m) are not those of {chosen_path} ({others:.6g} m)", remedy
                )
        if system.wkt != chosen.wkt and not _same_plane(system, chosen):
            raise InputError.about(
                path,
                f"its system ({describe_system(system)}) is not that of {chosen_path} "
                f"({describe_system(chosen)})",
                remedy,
            )
    return chosen


def describe_system(system: CoordinateSystem) -> str:
    """Code, else name, else `none`."""
    crs = pyproj_crs(system)
    return system.code or (crs.name if crs is not None else "none")


def _same_plane(one: CoordinateSystem, other: CoordinateSystem) -> bool:
    first, second = horizontal_crs(one), horizontal_crs(other)
    if first is None or second is None:
        return first is second
    return first.equals(second, ignore_axis_order=True) or (
        epsg_of(first) is not None and epsg_of(first) == epsg_of(second)
    )
