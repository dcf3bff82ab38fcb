"""The buildings to look at first."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from urllib.parse import quote

from eaves.figures.rows import BuildingRow
from eaves.figures.trust import has_defect, judge, lacks_model
from eaves.formats.atomic import atomic
from eaves.formats.vectors.geopackage import Row
from eaves.model import CoordinateSystem

REVIEW = "review.csv"
COLUMNS = ("rank", "id", "trust", "worth_m2", "reason", "link", "x", "y")
"""Of review.csv; x and y are a place inside the building, in the units of the reference system."""

LEAST_WORTH_M2 = 30.0
"""Buildings of which less is wrong, in the mean, are left out: a garage."""


def review_rows(buildings: Iterable[BuildingRow]) -> list[Row]:
    """The buildings of low trust, or with a defect that lowers it by itself, by the area that is likely
    wrong; of a map's polygons all that have no model.
    """
    rows = []
    for building in buildings:
        trust, badness, reason = judge(building.values)
        worth = badness * building.values["area_m2"]
        weak = trust == "low" or has_defect(building.values)
        if lacks_model(building.values) or (weak and worth >= LEAST_WORTH_M2):
            words = {
                "id": building.values["id"],
                "trust": trust,
                "worth_m2": round(worth, 1),
                "reason": reason,
                "link": f"report.html#building={quote(building.values['id'])}",
            }
            rows.append(Row(building.polygon, words))
    return ranked(rows)


def ranked(rows: Iterable[Row]) -> list[Row]:
    """The rows, the most worth first, with their ranks."""
    ordered = sorted(rows, key=lambda row: (-row.attributes["worth_m2"], row.attributes["id"]))
    return [Row(row.geometry, {**row.attributes, "rank": rank}) for rank, row in enumerate(ordered, 1)]


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
