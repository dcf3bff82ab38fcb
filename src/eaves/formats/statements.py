"""What a file states of its coordinate system, all statements of it together."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pyproj
from pyproj.exceptions import CRSError, ProjError

from eaves.formats.crs import (
    compound,
    describe_system,
    is_same_unit,
    name_of_unit,
    name_units,
    plane_part,
    unbound,
    unit_of,
    with_heights_in,
)
from eaves.formats.errors import InputError
from eaves.model import CoordinateSystem

UNSTATED = "not stated"
"""Who states what nobody does."""
REMEDY = "pass the right one with crs= or --crs"
SAME_PLACE = 5.0
"""Two statements are one where they put the data within this distance (m): realisations of a datum differ by
a metre or two."""
VERTICAL = re.compile(r"VERT_?CS\s*[\[(]", re.IGNORECASE)
"""The beginning of a system of heights in WKT 1, as OGC and Esri write it."""


@dataclass(frozen=True)
class Stated:
    """A coordinate system as a file states it.

    Parameters
    ----------
    crs : CRS or None
        Plane, geographic or compound.
    height_unit : float or None
        Metres in a unit of heights where it is stated; it overrules that of `crs`.
    plane_from : str
        The statement of the system.
    heights_from : str
        That of the unit of heights; empty where nobody states it.
    """

    crs: pyproj.CRS | None = None
    height_unit: float | None = None
    plane_from: str = ""
    heights_from: str = ""

    @property
    def upright(self) -> float | None:
        """Metres in a unit of heights, None where it is not stated."""
        if self.height_unit is not None or self.crs is None:
            return self.height_unit
        units = [
            axis.unit_conversion_factor for axis in axes_of(self.crs) if axis.direction in ("up", "down")
        ]
        return units[0] if units else None

    @property
    def whole(self) -> pyproj.CRS | None:
        """The system with heights in their unit."""
        if self.crs is None or self.height_unit is None or self.crs.is_geographic:
            return self.crs
        return with_heights_in(plane_part(self.crs), self.height_unit)

    @property
    def origins(self) -> tuple[str, str]:
        """Who states the system, and who the unit of heights; empty for nobody."""
        known = self.heights_from or self.plane_from
        return self.plane_from if self.crs is not None else "", known if self.upright is not None else ""


def describe_reference(own: Stated, system: CoordinateSystem) -> dict[str, str]:
    """The system of results and the units of the files' heights and plane in words, each with who states it:
    `system`, `plane`, `heights`."""
    names = name_units(system)
    plane_from, heights_from = own.origins
    plain = f"{UNSTATED}: taken as {names['heights']}"
    return {
        "system": describe_system(system),
        "plane": f"{names['geometry']} ({plane_from or f'{UNSTATED}: taken as metre'})",
        "heights": f"{names['heights']} ({heights_from or plain})",
    }


def axes_of(crs: pyproj.CRS) -> list[pyproj._crs.Axis]:
    """The axes of all parts of a system."""
    plain = unbound(crs)
    return [axis for part in plain.sub_crs_list or [plain] for axis in unbound(part).axis_info]


def stated_by_wkt(path: Path, text: str) -> Stated:
    """The system of WKT, with the heights that Esri writes inside the brackets of a plane one, which PROJ
    passes over.

    Raises
    ------
    InputError
        When it cannot be read.
    """
    try:
        crs = pyproj.CRS.from_wkt(text)
        inside = VERTICAL.search(text)
        if inside is not None and not unbound(crs).is_compound:
            heights = pyproj.CRS.from_wkt(_closed(text[inside.start() :]))
            crs = compound(plane_part(crs), heights)
    except CRSError:
        raise InputError.about(path, "its WKT coordinate system cannot be read", REMEDY) from None
    return Stated(crs, None, "WKT")


def _closed(text: str) -> str:
    """Text up to the bracket that closes its first one; brackets in quotes do not count."""
    depth, quoted = 0, False
    for place, letter in enumerate(text):
        quoted ^= letter == '"'
        depth += 0 if quoted else (letter in "[(") - (letter in "])")
        if depth == 0 and letter in "])":
            return text[: place + 1]
    return text


def joined(path: Path, one: Stated, other: Stated, middle: tuple[float, float]) -> Stated:
    """What two statements of a file say together: where one knows more, it is used.

    Raises
    ------
    InputError
        When they contradict: in the unit of the plane or of heights, or they put `middle` apart.
    """
    if one.crs is None or (other.crs is None and other.upright is None):
        return other if one.crs is None else one
    if other.crs is not None and not _same_plane(plane_part(one.crs), plane_part(other.crs), middle):
        _refuse(path, one, other, (_told(one.crs), _told(other.crs)))
    if one.upright is None:
        heights = other.crs.sub_crs_list[1] if other.crs is not None and other.crs.is_compound else None
        crs = one.crs
        if heights is not None and not one.crs.is_geographic:
            crs = compound(one.crs, heights)
        return replace(one, crs=crs, height_unit=other.upright, heights_from=other.plane_from)
    if other.upright is not None and not is_same_unit(one.upright, other.upright):
        told = (f"heights in {name_of_unit(one.upright)}", f"in {name_of_unit(other.upright)}")
        _refuse(path, one, other, told)
    return one


def _told(crs: pyproj.CRS) -> str:
    plane = plane_part(crs)
    return f"{plane.name} ({plane.axis_info[0].unit_name})"


def _refuse(path: Path, one: Stated, other: Stated, told: tuple[str, str]) -> None:
    raise InputError.about(
        path, f"its {one.plane_from} says {told[0]}, its {other.plane_from} say {told[1]}", REMEDY
    )


def _same_plane(one: pyproj.CRS, other: pyproj.CRS, middle: tuple[float, float]) -> bool:
    """True if two plane systems have one unit and put a place within `SAME_PLACE`."""
    if one.equals(other, ignore_axis_order=True):
        return True
    unit = unit_of(other)
    if one.is_geographic != other.is_geographic or not is_same_unit(unit_of(one), unit):
        return False
    if one.is_geographic:  # datums alone
        return True
    try:
        way = pyproj.Transformer.from_crs(one, other, always_xy=True)
        moved = np.array(way.transform(*middle))
    except ProjError:
        return True  # one of them has no place on Earth that could differ
    off = float(np.hypot(*(moved - middle))) * unit
    return bool(off <= SAME_PLACE)
