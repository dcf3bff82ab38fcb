"""What a person looks at first: the buildings of low trust, and the places of doubt, each once."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import shapely

from eaves.detect.stage import HOUSE_M2, OBJECT
from eaves.figures.rows import BuildingRow
from eaves.figures.trust import MANUAL, has_defect, judge, lacks_model
from eaves.formats.vectors.geopackage import Row
from eaves.formats.whole_files import atomic
from eaves.model import Block, CoordinateSystem, Doubt
from eaves.run.world_squares import WIDE_SQUARE

REVIEW, HOUSES = "review.csv", "primitives.csv"
COLUMNS = ("rank", "id", "trust", "worth_m2", "reason", "link", "x", "y")
"""Of review.csv; x and y are a place inside the building, in the units of the reference system."""

LEAST_WORTH_M2 = 30.0
"""Buildings of which less is wrong, in the mean, are left out: a garage."""
LEAST_SIDE = 1.0
"""Side (m) of the square that shows a doubt of less area: it must be seen on a map."""
LAYER = "the layer doubts of footprints.gpkg"
LEAST_FACE_M2 = 10.0
"""A smaller face in doubt (m² in plan) is in the layer `roof_planes`, where `weak` says why."""


def review_rows(buildings: Iterable[BuildingRow]) -> list[Row]:
    """The buildings of low trust, or with a defect that lowers it by itself, by the area that is likely
    wrong; of a map's polygons all that have no model.
    """
    rows = []
    for building in buildings:
        trust, badness, reason = judge(building.values)
        worth = badness * building.values["area_m2"]
        weak = trust == "low" or (trust != MANUAL and has_defect(building.values))
        if lacks_model(building.values) or (weak and worth >= LEAST_WORTH_M2):
            attributes = {
                "id": building.values["id"],
                "trust": trust,
                "worth_m2": round(worth, 1),
                "reason": reason,
                "link": f"report.html#building={quote(building.values['id'])}",
            }
            rows.append(Row(building.polygon, attributes))
    ordered = sorted(rows, key=lambda row: (-row.attributes["worth_m2"], row.attributes["id"]))
    return [Row(row.geometry, {**row.attributes, "rank": rank}) for rank, row in enumerate(ordered, 1)]


def write_review(path: Path, rows: Sequence[Row], system: CoordinateSystem) -> Path:
    """Write the rows of the layer `review` (world metres) as a table, also where there are none; its path."""
    records, unit = [], system.horizontal_unit_m
    for row in rows:
        place = {}
        if row.geometry is not None and not row.geometry.is_empty:
            point = row.geometry.representative_point()
            place = {"x": round(point.x / unit, 2), "y": round(point.y / unit, 2)}
        records.append({**row.attributes, **place})
    return write_table(path, records, COLUMNS)


def write_table(path: Path, records: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> Path:
    """Write those columns of records as a table, also where there are none; its path."""
    with atomic(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(records)
    return path


def distinct_doubts(doubts: Iterable[Doubt], side: float) -> list[Doubt]:
    """The doubts (world metres), each once, the largest first.

    What goes on beyond the surroundings that its block sees has another middle in each block, and so may be
    doubted in several: of those that overlap the largest stays. `side` is that of the blocks.
    """
    ordered = sorted(
        set(doubts), key=lambda doubt: (-doubt.area_m2, doubt.x, doubt.y, doubt.stage, doubt.reason)
    )
    return without_repeated(ordered, side)


def kind_of(doubt: Doubt) -> str:
    """What a doubt is about, without its numbers."""
    return doubt.reason.split(":")[0]


def objects_remark(doubts: Iterable[Doubt], buildings: int, unit: float, where: str) -> str | None:
    """The line on a scan in which more objects of the size of a house are no buildings than are; None where
    they are fewer. `unit` (m) is that of the system, `where` names what to open."""
    objects = [doubt for doubt in doubts if kind_of(doubt) == OBJECT]
    if len(objects) <= buildings:
        return None
    largest = max(objects, key=lambda doubt: doubt.area_m2)
    return (
        f"{len(objects):,} objects of {HOUSE_M2[0]:g} to {HOUSE_M2[1]:g} m² rise as high as houses and are "
        f"no buildings, {buildings:,} are; of the largest, at {largest.x / unit:.1f}, "
        f"{largest.y / unit:.1f}, {largest.reason.partition(': ')[2]}; all are doubts"
        f"{where and ' in ' + where}; if they are houses, --set detect.max_residual=0.5 takes rougher roofs"
    )


def doubt_row(doubt: Doubt) -> Row:
    """The row of a doubt: the square of its area about its middle."""
    columns = {"stage": doubt.stage, "reason": doubt.reason, "area_m2": doubt.area_m2}
    return Row(square_of(doubt), columns)


def face_doubts(rows: Iterable[BuildingRow]) -> Iterator[Doubt]:
    """Doubts (world metres) about the larger roof faces that their points do not support."""
    for row in rows:
        for polygon, face in row.faces:
            plan = face.get("projected_m2") or 0.0
            weak = face.get("weak")
            if weak is None or plan < LEAST_FACE_M2:
                continue
            kind = "a hole where a roof should be" if face.get("no_data") else "a face whose points scatter"
            middle = shapely.force_2d(polygon).representative_point()
            yield Doubt(round(middle.x, 2), round(middle.y, 2), float(plan), f"{kind}: {weak}", "roof")


def without_repeated(doubts: Sequence[Doubt], side: float) -> list[Doubt]:
    """The doubts, sorted by size, without those of which a neighbouring block has a larger one of the same
    kind that overlaps."""
    if not doubts:
        return []
    squares = [square_of(doubt) for doubt in doubts]
    larger, smaller = shapely.STRtree(squares).query(squares, predicate="intersects")
    keys = [(doubt.stage, kind_of(doubt)) for doubt in doubts]
    homes = [Block.at(doubt.x, doubt.y, WIDE_SQUARE if doubt.stage == "ground" else side) for doubt in doubts]
    dropped = np.zeros(len(doubts), bool)
    for k, n in zip(larger.tolist(), smaller.tolist(), strict=True):
        dropped[n] |= k < n and keys[k] == keys[n] and homes[k] != homes[n]
    return [doubt for doubt, gone in zip(doubts, dropped, strict=True) if not gone]


def square_of(doubt: Doubt) -> shapely.Polygon:
    """The square of a doubt's area about its middle."""
    half = 0.5 * max(LEAST_SIDE, math.sqrt(doubt.area_m2))
    return shapely.box(doubt.x - half, doubt.y - half, doubt.x + half, doubt.y + half)


def describe_doubts(doubts: Sequence[Doubt], unit: float, where: str) -> dict[str, Any]:
    """What run.json says of the doubts, sorted by size: how many, and of each kind how many, their area and
    the largest, its place in the reference system's unit, of so many metres; `where` names what to open.
    """
    groups = dict[tuple[str, str], list[Doubt]]()
    for doubt in doubts:
        groups.setdefault((doubt.stage, kind_of(doubt)), []).append(doubt)
    kinds = []
    for (stage, _), places in groups.items():
        x, y = (round(round(value, 2) / unit, 2) for value in (places[0].x, places[0].y))
        area = round(sum(doubt.area_m2 for doubt in places), 1)
        kinds.append(
            {
                "stage": stage,
                "count": len(places),
                "area_m2": area,
                "reason": places[0].reason,
                "x": x,
                "y": y,
            }
        )
    return {"count": len(doubts), "see": where, "kinds": sorted(kinds, key=lambda one: -one["area_m2"])}
