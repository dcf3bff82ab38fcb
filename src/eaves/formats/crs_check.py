"""Check of a file's numbers against its reference system, and what heights are measured from."""

from __future__ import annotations

import logging
import warnings
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import pyproj
import pyproj.exceptions
from pyproj.transformer import TransformerGroup

from eaves.formats.crs import (
    code_of,
    horizontal_crs,
    is_same_unit,
    name_of_unit,
    parse_crs,
    plane_part,
    pyproj_crs,
    unit_of,
)
from eaves.formats.errors import InputError
from eaves.model import Bounds, CoordinateSystem, Rectangle

log = logging.getLogger("eaves")

SAME_PLACE = 1.0
"""Two systems are one where they put the data within this distance (m)."""
BESIDE_DEG = 1.5
"""Distance (degrees) by which surveys extend beyond the area a system is made for."""
FOOT = 0.3048
FORCE = "or, if it is meant, say so with --crs-force"


def refuse_conflict(path: Path, said: str, own: pyproj.CRS | None, box: Bounds) -> None:
    """Refuse a stated system that puts the file's box elsewhere than its `own` does.

    The box is in the units of the file. A system with heights in place of one without is no conflict.

    Raises
    ------
    InputError
        When they do not.
    """
    if own is None:
        return
    stated, given = plane_part(own), plane_part(parse_crs(said))
    if given.is_engineering and not is_same_unit(unit_of(stated), unit_of(given)):
        raise InputError.about(
            path,
            f"says it is in {own.name}, in {name_of_unit(unit_of(stated))}, --crs says {said}",
            f"leave --crs out, {FORCE}",
        )
    if stated.equals(given, ignore_axis_order=True) and same_heights(own, parse_crs(said)):
        return
    x, y = (box.west + box.east) / 2, (box.south + box.north) / 2
    try:
        east, north = pyproj.Transformer.from_crs(stated, given, always_xy=True).transform(x, y)
    except pyproj.exceptions.ProjError:
        log.warning("%s: says a system that PROJ cannot place on Earth, %s; --crs is taken", path, own.name)
        return
    unit = unit_of(given)
    near = np.isfinite([east, north]).all() and np.hypot(east - x, north - y) * unit <= SAME_PLACE
    if near and same_heights(own, parse_crs(said)):
        return
    raise InputError.about(
        path, f"says it is in {own.name}, --crs says {parse_crs(said).name}", f"leave --crs out, {FORCE}"
    )


def same_heights(one: pyproj.CRS, other: pyproj.CRS) -> bool:
    """True if two systems measure heights alike, or one of them does not say how."""
    upright = [crs.sub_crs_list[-1] for crs in (one, other) if crs.is_compound]
    if len(upright) < 2:
        return True
    unnamed = any("unknown" in crs.to_wkt() for crs in upright)
    return is_same_unit(*map(unit_of, upright)) and (unnamed or upright[0].name == upright[1].name)


def refuse_numbers(path: Path, system: CoordinateSystem, box: Bounds) -> None:
    """Refuse a box (in the file's units) that cannot lie in its system's area of use; a warning where
    it lies elsewhere and nothing explains it.

    Raises
    ------
    InputError
        When it would lie there in other units, or with x and y exchanged, or is in degrees.
    """
    area = area_of_use(system)
    if area is None:
        return
    x, y = (box.west + box.east) / 2, (box.south + box.north) / 2
    if area.holds(x, y):
        return
    flat = max(abs(box.west), abs(box.east)) <= 180 and max(abs(box.south), abs(box.north)) <= 90
    if flat and area.holds_degrees(x, y):
        raise InputError.about(
            path,
            f"coordinates around {x:.4f}, {y:.4f} are degrees, not {area.name}",
            f"reproject the data to {area.name}, {FORCE}",
        )
    for factor, words in ((FOOT, "feet, not metres"), (1 / FOOT, "metres, not feet")):
        if area.holds(x * factor, y * factor):
            raise InputError.about(
                path,
                f"the area of {area.name} holds coordinates around {x:.0f}, {y:.0f} only in {words}",
                f"pass the system they are in with --crs, {FORCE}",
            )
    if area.holds(y, x):
        raise InputError.about(
            path,
            f"the area of {area.name} holds coordinates around {x:.0f}, {y:.0f} only with x and y exchanged",
            f"exchange them, {FORCE}",
        )
    log.warning(
        "%s: coordinates around %.0f, %.0f lie outside the area %s is made for; check the coordinate system",
        path, x, y, area.name,
    )  # fmt: skip


@dataclass(frozen=True)
class Area:
    """The area a plane system is made for: west, south, east, north in degrees; `east` over 180 across the
    date line."""

    name: str
    sides: Rectangle
    to_degrees: pyproj.Transformer

    def holds_degrees(self, longitude: float, latitude: float) -> bool:
        """True if a longitude and latitude (degrees) are in the area or beside it."""
        west, south, east, north = self.sides
        across = any(
            west - BESIDE_DEG <= longitude + turn <= east + BESIDE_DEG for turn in (0.0, 360.0, -360.0)
        )
        return across and south - BESIDE_DEG <= latitude <= north + BESIDE_DEG

    def holds(self, x: float, y: float) -> bool:
        """True if a place, in the system's units, is in the area or beside it."""
        longitude, latitude = self.to_degrees.transform(x, y)
        return bool(np.isfinite([longitude, latitude]).all()) and self.holds_degrees(longitude, latitude)


@lru_cache(maxsize=64)  # the tiles of a country ask the same a million times
def area_of_use(system: CoordinateSystem) -> Area | None:
    """The area of a system's plane part, or of its code's; None when neither states one."""
    crs = horizontal_crs(system)
    if crs is None or crs.geodetic_crs is None:
        return None
    code = code_of(crs)
    used = crs.area_of_use or (pyproj.CRS.from_user_input(code).area_of_use if code else None)
    if used is None:
        return None
    east = used.east + (360.0 if used.east < used.west else 0.0)
    way = pyproj.Transformer.from_crs(crs, crs.geodetic_crs, always_xy=True)
    return Area(code or crs.name, (used.west, used.south, east, used.north), way)


def vertical_datum(system: CoordinateSystem) -> dict[str, str | None]:
    """The datum of the heights: its `name`, and the `status`.

    `known`: PROJ relates it to the ellipsoid. `geoid missing`: it has a name, but this computer lacks the
    grid for that. `unknown`: the files do not say.

    Examples
    --------
    >>> from eaves.formats.crs_check import vertical_datum
    >>> from eaves.model import CoordinateSystem
    >>> vertical_datum(CoordinateSystem())
    {'status': 'unknown', 'name': None}
    """
    crs = pyproj_crs(system)
    if crs is None or not crs.is_compound or "unknown" in crs.sub_crs_list[-1].to_wkt():
        return {"status": "unknown", "name": None}
    return {
        "status": "geoid missing" if geoid_is_missing(crs) else "known",
        "name": crs.sub_crs_list[-1].name,
    }


@lru_cache(maxsize=64)
def geoid_is_missing(crs: pyproj.CRS) -> bool:
    """True if PROJ here lacks the geoid grid to convert heights of a compound system to ellipsoidal ones."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Best transformation is not available")
        group = TransformerGroup(crs, pyproj.CRS.from_epsg(4979), always_xy=True)
    return not group.transformers or "ballpark vertical" in group.transformers[0].description.lower()
