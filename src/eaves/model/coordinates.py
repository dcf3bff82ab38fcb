"""The coordinate reference system of the data, reduced to what computing needs."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


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


PREFIX = "eaves_"
"""The beginning of the names of these tags in files that hold tags of others, too."""


@dataclass(frozen=True)
class Provenance:
    """The origin that every output states; an empty one states none.

    Parameters
    ----------
    sources : tuple of str
        Names of the point files, in their order; of very many the first.
    count : int
        Number of point files.
    datum : str or None
        Name of the vertical datum, where it is known.
    datum_status : str
        `known`, `unknown`, or `geoid missing`: the datum has a name, but its grid is not on this computer.

    Examples
    --------
    >>> from eaves.model import Provenance
    >>> Provenance(("tile.laz",), 1).sentence
    'points of tile.laz; vertical datum: unknown'
    """

    sources: tuple[str, ...] = ()
    count: int = 0
    datum: str | None = None
    datum_status: str = "unknown"

    @classmethod
    def of(cls, members: Any) -> Provenance:
        """The origin that `members` of a file state; an empty one where they state none."""
        if not isinstance(members, dict) or not members.get("pointSourceCount"):
            return cls()
        datum = members.get("verticalDatum") or {}
        sources = tuple(map(str, members.get("pointSources") or ()))
        status = str(datum.get("status", "unknown"))
        return cls(sources, int(members["pointSourceCount"]), datum.get("name"), status)

    def __bool__(self) -> bool:
        return self.count > 0

    @property
    def members(self) -> dict[str, Any]:
        """For files that hold JSON; nothing when nothing is known."""
        if not self:
            return {}
        about = {"pointSources": list(self.sources), "pointSourceCount": self.count}
        return about | {"verticalDatum": {"status": self.datum_status, "name": self.datum}}

    @property
    def tags(self) -> dict[str, str]:
        """For files that hold tags of text."""
        if not self:
            return {}
        texts = {"point_sources": json.dumps(list(self.sources)), "point_source_count": str(self.count)}
        texts |= {"vertical_datum_status": self.datum_status}
        texts |= {} if self.datum is None else {"vertical_datum": self.datum}
        return {f"{PREFIX}{name}": text for name, text in texts.items()}

    @property
    def sentence(self) -> str:
        """For files that hold a line of text: one line whatever the names are; empty where none is known."""
        if not self:
            return ""
        names = ", ".join("".join(c if c.isprintable() else "_" for c in name) for name in self.sources)
        more = f" and {self.count - len(self.sources)} more" if self.count > len(self.sources) else ""
        datum = "" if self.datum is None else f"{self.datum}, "
        return f"points of {names}{more}; vertical datum: {datum}{self.datum_status}"


NOTHING_KNOWN = Provenance()
