"""The buildings to look at first."""

from __future__ import annotations

from collections.abc import Iterable

from eaves.formats.geopackage import Row
from eaves.run.rows import BuildingRow
from eaves.run.trust import judge


def review_rows(buildings: Iterable[BuildingRow]) -> list[Row]:
    """The buildings that are not of high trust, worst first."""
    found = []
    for building in buildings:
        trust, badness, reason = judge(building.values)
        if trust != "high":
            told = {
                "id": building.values["id"],
                "trust": trust,
                "badness": round(badness, 3),
                "reason": reason,
            }
            found.append(Row(building.polygon, told))
    found.sort(key=lambda row: (-row.attributes["badness"], row.attributes["id"]))
    return [Row(row.geometry, {"rank": rank, **row.attributes}) for rank, row in enumerate(found, 1)]
