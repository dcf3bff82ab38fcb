"""The origin of results: the files of the points, and what their heights are measured from."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

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
