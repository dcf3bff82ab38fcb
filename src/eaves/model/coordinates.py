"""The coordinate reference system of the data, reduced to what computing needs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class CoordinateSystem:
    """A projected reference system: its WKT and code where known, and the length of its units.

    Parameters
    ----------
    wkt : str or None
        Well-known text; None for a plane system without a place on Earth.
    horizontal_unit_m, vertical_unit_m : float
        Metres in one unit along x and y, and along z (> 0).
    code : str or None
        `EPSG:28992` or `EPSG:28992+5709`; None when the system has no registered code.

    Examples
    --------
    >>> from eaves import CoordinateSystem
    >>> CoordinateSystem(horizontal_unit_m=0.3048).unit_m
    (0.3048, 0.3048, 1.0)
    """

    wkt: str | None = None
    horizontal_unit_m: float = 1.0
    vertical_unit_m: float = 1.0
    code: str | None = None

    def __repr__(self) -> str:
        name = self.code or (self.wkt or "no place on Earth").split(",")[0]
        return f"CoordinateSystem({name}, units {self.horizontal_unit_m:g} and {self.vertical_unit_m:g} m)"

    @property
    def unit_m(self) -> tuple[float, float, float]:
        """Metres per unit along x, y, z."""
        return self.horizontal_unit_m, self.horizontal_unit_m, self.vertical_unit_m


def describe_units(units: Mapping[str, str]) -> str:
    """The units of results (`name_units`) in words: `geometry in US survey feet, attributes in metres`; empty
    where all of them are metres."""
    if not set(units.values()) - {"metre"}:
        return ""
    names = {
        what: name.replace("foot", "feet") if "foot" in name else f"{name}s" for what, name in units.items()
    }
    upright = f", its heights in {names['heights']}" if names["heights"] != names["geometry"] else ""
    return f"geometry in {names['geometry']}{upright}, attributes in {names['attributes']}"


LOCAL_METRES = CoordinateSystem()
"""A plane system in metres with no known place on Earth."""
