"""The buildings to look at first."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from urllib.parse import quote

from eaves.figures.rows import BuildingRow
from eaves.figures.trust import judge
from eaves.formats.atomic import atomic
from eaves.formats.vectors.geopackage import Row
from eaves.model import CoordinateSystem

REVIEW = "review.csv"
COLUMNS = ("rank", "id", "trust", "badness", "reason", "link", "x", "y")
"""Of review.csv; x and y are a place inside the building, in the units of the reference system."""


def review_rows(buildings: Iterable[BuildingRow]) -> list[Row]:
    """The buildings that are not of high trust, worst first."""
    found = []
    for building in buildings:
        trust, badness, reason = judge(building.values)
        if trust != "high":
            words = {
                "id": building.values["id"],
                "trust": trust,
                "badness": round(badness, 3),
                "reason": reason,
                "link": f"report.html#building={quote(building.values['id'])}",
            }
            found.append(Row(building.polygon, words))
    found.sort(key=lambda row: (-row.attributes["badness"], row.attributes["id"]))
    return [Row(row.geometry, {"rank": rank, **row.attributes}) for rank, row in enumerate(found, 1)]


def write_review(path: Path, rows: Sequence[Row], system: CoordinateSystem) -> Path:
    """Write the rows of the layer `review` (world metres) as a table, also where there are none; its path."""
    with atomic(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, extrasaction="ignore")
        writer.writeheader()
        for row in rows:
            place = {}
            if row.geometry is not None and not row.geometry.is_empty:
                point = row.geometry.representative_point()
                unit = system.horizontal_unit_m
                place = {"x": round(point.x / unit, 2), "y": round(point.y / unit, 2)}
            writer.writerow({**row.attributes, **place})
    return path
