"""The edits of a user: a polygon with a verdict each, from an edited layer or a file of edits."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import shapely
from shapely import MultiPolygon, Polygon

from eaves.buildings.edited import Order
from eaves.formats import InputError, read_polygons
from eaves.formats.vectors.geopackage import Row, write_polygons
from eaves.geometry.overlaps import HALF
from eaves.geometry.rings import as_polygon
from eaves.model import CoordinateSystem

NO_BUILDING, IS_BUILDING, FLAT_ROOF, FOOTPRINT, PARTY_WALLS = (
    "no building",
    "is a building",
    "flat roof",
    "footprint",
    "party walls",
)
VERDICTS = (NO_BUILDING, IS_BUILDING, FLAT_ROOF, FOOTPRINT, PARTY_WALLS)

DIFFERENT_M2 = 0.05
"""An outline was edited when it differs by more than this (m²): drivers round coordinates."""


@dataclass(frozen=True, eq=False)
class Edit:
    """One verdict.

    `id` names the building it is of; for a building that was not found it is empty, or the new building's.
    `polygon` (world metres) is the outline to use, one of the houses between party walls, or the place.
    """

    verdict: str
    polygon: Polygon | MultiPolygon
    id: str = ""
    source: str = ""

    @property
    def row(self) -> Row:
        """As the file of edits has it."""
        return Row(self.polygon, {"verdict": self.verdict, "id": self.id or None, "source": self.source})


def read_edits(
    path: Path, system: CoordinateSystem, outlines: Mapping[str, Polygon] | None = None
) -> list[Edit]:
    """The edits of a file: polygons with a field `verdict`, and `id` where they are of a known building.

    A CSV file, as the page of a run saves it, has these two fields alone; `outlines` (id → world metres) are
    the run's buildings, whose outlines it means.

    Raises
    ------
    InputError
        When the file cannot be read, has no such field, or a verdict or an id that is not known.
    """
    polygons: Sequence[Polygon | MultiPolygon]
    if path.suffix.lower() == ".csv":
        polygons, rows = read_verdict_table(path, outlines or {})
    else:
        polygons, _, rows, _ = read_polygons(path, target=system)
    if rows and "verdict" not in rows[0]:
        raise InputError.about(path, "has no field 'verdict'", f"add it, with one of: {', '.join(VERDICTS)}")
    return [
        Edit(verdict, polygon, name, str(row.get("source") or path.name))
        for verdict, polygon, name, row in features_of(path, polygons, rows, VERDICTS)
    ]


def features_of(
    path: Path,
    polygons: Sequence[Polygon | MultiPolygon],
    rows: Sequence[Mapping[str, Any]],
    verdicts: Sequence[str],
) -> Iterator[tuple[str, Polygon, str, Mapping[str, Any]]]:
    """The verdict, one of `verdicts`, the repaired polygon, the id and the row of each feature of a file.

    Raises
    ------
    InputError
        When a verdict is none of those, or a polygon has no area.
    """
    for number, (polygon, row) in enumerate(zip(polygons, rows, strict=True), 1):
        verdict, whole = str(row.get("verdict") or "").strip().lower(), as_polygon(polygon)
        if verdict not in verdicts:
            rule = f"feature {number} has the verdict '{row['verdict']}'"
            raise InputError.about(path, rule, f"use one of: {', '.join(VERDICTS)}")
        if whole is None:
            raise InputError.about(path, f"feature {number} has no area", "fix or delete it")
        yield verdict, whole, str(row.get("id") or ""), row


def read_verdict_table(
    path: Path, outlines: Mapping[str, Polygon]
) -> tuple[list[Polygon], list[dict[str, Any]]]:
    """The outlines and the rows of a table of ids and verdicts.

    Raises
    ------
    InputError
        When it cannot be read, or names a building that is not there.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows: list[dict[str, Any]] = list(csv.DictReader(file))
    except FileNotFoundError:
        raise InputError.about(path, "does not exist", "check the path") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError.about(path, f"is no table ({error})", "save it as CSV in UTF-8") from None
    polygons = []
    for number, row in enumerate(rows, 1):
        name = str(row.get("id") or "")
        if name not in outlines:
            raise InputError.about(
                path, f"row {number} names the building '{name}', which the run has not", "use the run's ids"
            )
        polygons.append(outlines[name])
    return polygons, rows


def write_edits(path: Path, edits: Iterable[Edit], system: CoordinateSystem) -> None:
    """Write edits in their order."""
    write_polygons(path, [edit.row for edit in edits], system, "edits")


def edits_of_layer(path: Path, system: CoordinateSystem, before: dict[str, Polygon]) -> list[Edit]:
    """The changes of a user in the layer `footprints` of a run: outlines, features added and deleted, several
    features of one id (party walls), and a field `verdict`.

    Parameters
    ----------
    path
        The run's GeoPackage.
    system
        The run's reference system.
    before
        Id → outline (world metres), as the run wrote them.
    """
    polygons, _, rows, _ = read_polygons(path, "footprints", target=system)
    there: dict[str, list[Polygon]] = {}
    edits: list[Edit] = []
    for verdict, whole, name, _ in features_of(path, polygons, rows, ("", *VERDICTS)):
        if name in before:
            there.setdefault(name, []).append(whole)
        if verdict or name not in before:
            edits.append(Edit(verdict if name in before else IS_BUILDING, whole, name, path.name))
    for name, outline in before.items():
        parts = there.get(name, [])
        if not parts:
            edits.append(Edit(NO_BUILDING, outline, name, path.name))
        elif len(parts) > 1:
            edits += [Edit(PARTY_WALLS, part, name, path.name) for part in parts]
        elif shapely.symmetric_difference(parts[0], outline).area > DIFFERENT_M2:
            edits.append(Edit(FOOTPRINT, parts[0], name, path.name))
    return edits


def settle(edits: Sequence[Edit], outlines: dict[str, Polygon]) -> tuple[list[Order], list[str]]:
    """The orders that follow from all edits of a run, and the conflicts among them, in words.

    Later edits go before earlier ones of the same building. `outlines` are the buildings that the run found
    (world metres), by id.
    """
    conflicts: list[str] = []
    names = list(outlines)
    tree = shapely.STRtree([outlines[name] for name in names])
    own: dict[str, list[Edit]] = {}
    fresh: dict[str, list[Edit]] = {}
    for edit in edits:
        name = edit.id if edit.id in outlines else located(edit, names, outlines, tree)
        if name:
            if edit.id and edit.id != name:
                conflicts.append(
                    f"{edit.verdict} of '{edit.id}', which no longer exists: applied to {name} at its place"
                )
            own.setdefault(name, []).append(edit)
        elif edit.verdict == IS_BUILDING or (edit.id and edit.id in fresh):
            place = edit.polygon.representative_point()
            fresh.setdefault(edit.id or f"e{place.x:.0f}_{place.y:.0f}", []).append(edit)
        else:
            conflicts.append(
                f"{edit.verdict} of '{edit.id}': there is no such building at its place; left out"
            )
    orders = [settled(name, some, outlines[name], conflicts) for name, some in own.items()]
    orders += [settled(name, some, some[0].polygon, conflicts) for name, some in fresh.items()]
    return orders, conflicts


def located(edit: Edit, names: Sequence[str], outlines: dict[str, Polygon], tree: shapely.STRtree) -> str:
    """The building at the place of an edit that names none; empty where there is none."""
    best, most = "", 0.0
    for k in tree.query(edit.polygon, predicate="intersects"):
        shared = shapely.intersection(outlines[names[k]], edit.polygon).area
        if shared > most and shared >= HALF * min(edit.polygon.area, outlines[names[k]].area):
            best, most = names[k], float(shared)
    return best


def settled(name: str, edits: Sequence[Edit], outline: Polygon, conflicts: list[str]) -> Order:
    """The outcome of the edits of one building: the latest outline and the latest word on whether it is
    one."""
    outlines: tuple[Polygon, ...] = (outline,)
    flat, gone = False, False
    used: list[Edit] = []
    last = ""
    for edit in edits:
        verdict = edit.verdict
        if gone and verdict != NO_BUILDING:
            conflicts.append(f"{name}: '{verdict}' after '{NO_BUILDING}': the later one holds")
            used = []
        if verdict == NO_BUILDING and used:
            conflicts.append(f"{name}: '{NO_BUILDING}' after '{used[-1].verdict}': the later one holds")
            used = []
        gone, flat = verdict == NO_BUILDING, flat or verdict == FLAT_ROOF
        used.append(edit)
        if verdict == PARTY_WALLS and last == PARTY_WALLS:
            outlines = (*outlines, edit.polygon)
        elif verdict not in (NO_BUILDING, FLAT_ROOF):
            if verdict != PARTY_WALLS and last in (FOOTPRINT, PARTY_WALLS):
                conflicts.append(f"{name}: a second outline: the later one holds")
            outlines = (edit.polygon,)
        last = verdict if verdict != FLAT_ROOF else last
    attributes = {"edit": dict.fromkeys(edit.verdict for edit in used)}
    attributes["edit_source"] = dict.fromkeys(edit.source for edit in used)
    words = {name: ", ".join(some) for name, some in attributes.items()}
    return Order(name, () if gone else outlines, flat, words)
