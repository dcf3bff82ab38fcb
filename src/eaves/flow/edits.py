"""The edits of a user: a polygon with a verdict each, from an edited layer or a file of edits."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any

import shapely
from shapely import MultiPolygon, Polygon

from eaves.buildings.edited import COARSER, FINER, FLAT, GABLE, HIP, Order, OrderedPart, StatedRoof
from eaves.formats import InputError, read_polygons
from eaves.formats.vectors.geopackage import Row, write_polygons
from eaves.geometry.rings import COORDINATE_STEP, HALF, as_polygon
from eaves.methods import resolve_method
from eaves.model import CoordinateSystem
from eaves.reconstruct import Reconstructor
from eaves.reconstruct.toolkit.stated_faces import StatedFace as StatedFace
from eaves.run.keys import code_of_methods

NO_BUILDING, IS_BUILDING, FLAT_ROOF, FOOTPRINT, PARTY_WALLS = (
    "no building",
    "is a building",
    "flat roof",
    "footprint",
    "party walls",
)
RIGHT, BASE_HEIGHT, EAVES_HEIGHT, ROOF_FACE = "right", "base height", "eaves height", "roof face"
SHAPES = {
    FLAT_ROOF: FLAT,
    "coarser roof": COARSER,
    "finer roof": FINER,
    "gable roof": GABLE,
    "hip roof": HIP,
    "roof of points": "",
}
"""The shape of a roof that a verdict states."""
OUTLINES, HEIGHTS = (IS_BUILDING, FOOTPRINT, PARTY_WALLS), (BASE_HEIGHT, EAVES_HEIGHT)
VERDICTS = (NO_BUILDING, *OUTLINES, *SHAPES, *HEIGHTS, ROOF_FACE, RIGHT)

DIFFERENT_M2 = 0.05
"""An outline was edited when it differs by more than this (m²): drivers round coordinates."""


@dataclass(frozen=True, eq=False)
class Edit:
    """One verdict.

    `id` names the building it is of; for a building that was not found it is empty, or the new building's.
    `polygon` (world metres) is the outline to use, one of the houses between party walls, a face of the roof,
    or the place. `value` is the height (m) that a verdict states, `plane` that of a face, as `StatedFace` has
    it; None for the plane of the points in the face. An edit made at the operator's table has the number of
    its action, the day, and the reason for which the building was to be reviewed.
    """

    verdict: str
    polygon: Polygon | MultiPolygon
    id: str = ""
    source: str = ""
    value: float | None = None
    action: int = 0
    reviewed: str = ""
    reason: str = ""
    plane: tuple[float, float, float] | None = None

    @property
    def row(self) -> Row:
        """As the file of edits has it."""
        more: dict[str, Any] = {"value": self.value, "action": self.action or None}
        more |= {"reviewed": self.reviewed or None, "reason": self.reason or None}
        more["plane"] = None if self.plane is None else " ".join(map(repr, self.plane))
        columns = {"verdict": self.verdict, "id": self.id or None, "source": self.source}
        return Row(self.polygon, columns | {name: value for name, value in more.items() if value is not None})


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
        Edit(
            verdict,
            polygon,
            name,
            str(row.get("source") or path.name),
            height_of(path, verdict, row),
            int(row.get("action") or 0),
            str(row.get("reviewed") or ""),
            str(row.get("reason") or ""),
            plane_of(path, verdict, row),
        )
        for verdict, polygon, name, row in features_of(path, polygons, rows, VERDICTS)
    ]


def height_of(path: Path, verdict: str, row: Mapping[str, Any]) -> float | None:
    """The height (m) that a verdict of a file states; None for the others.

    Raises
    ------
    InputError
        When it states none.
    """
    if verdict not in HEIGHTS:
        return None
    try:
        height = float(row.get("value") or "")
    except (TypeError, ValueError):
        height = math.nan
    if not math.isfinite(height):
        raise InputError.about(path, f"'{verdict}' has no number", "give the height (m) in the field 'value'")
    return height


def plane_of(path: Path, verdict: str, row: Mapping[str, Any]) -> tuple[float, float, float] | None:
    """The plane that a verdict of a file states for a face; None for that of the points in it.

    Raises
    ------
    InputError
        When it is no plane.
    """
    words = str(row.get("plane") or "").split()
    if verdict != ROOF_FACE or not words:
        return None
    try:
        a, b, height = map(float, words)
    except ValueError:
        a = b = height = math.nan
    if not math.isfinite(a + b + height):
        rule = "is a rise (m/m) to the east, one to the north, and a height (m) at the face's centroid"
        raise InputError.about(path, f"the plane '{row['plane']}' is none", f"it {rule}")
    return a, b, height


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
        verdict, whole = str(row.get("verdict") or "").strip().lower(), repaired(polygon)
        if verdict not in verdicts:
            rule = f"feature {number} has the verdict '{row['verdict']}'"
            raise InputError.about(path, rule, f"use one of: {', '.join(VERDICTS)}")
        if whole is None:
            raise InputError.about(path, f"feature {number} has no area", "fix or delete it")
        yield verdict, whole, str(row.get("id") or ""), row


def repaired(shape: Polygon | MultiPolygon) -> Polygon | None:
    """The polygon of a feature; itself where it is sound and on the grid, as one that was read before is."""
    rounded = shapely.set_precision(shape, COORDINATE_STEP, mode="pointwise")
    if isinstance(shape, Polygon) and shape.is_valid and rounded.equals_exact(shape, 0.0):
        return shape
    return as_polygon(shape)


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
        name = divided(edit.id, {**outlines, **fresh})
        if name in fresh:
            fresh[name].append(edit)
            continue
        name = name or located(edit, names, outlines, tree)
        if name:
            if edit.id and divided(edit.id, outlines) != name:
                conflicts.append(
                    f"{edit.verdict} of '{edit.id}', which no longer exists: applied to {name} at its place"
                )
            own.setdefault(name, []).append(edit)
        elif edit.verdict == IS_BUILDING:
            place = edit.polygon.representative_point()
            fresh.setdefault(edit.id or f"e{place.x:.0f}_{place.y:.0f}", []).append(edit)
        else:
            conflicts.append(
                f"{edit.verdict} of '{edit.id}': there is no such building at its place; left out"
            )
    orders = [settled(name, some, outlines[name], conflicts) for name, some in own.items()]
    orders += [settled(name, some, some[0].polygon, conflicts) for name, some in fresh.items()]
    return orders, conflicts


def divided(name: str, known: Mapping[str, object]) -> str:
    """The building that an id is of, itself or one of its parts (`a-2`, `a-2-3`), among those known; empty
    where it is of none."""
    while name not in known:
        name, dash, number = name.rpartition("-")
        if not dash or not number.isdigit():
            return ""
    return name


def located(edit: Edit, names: Sequence[str], outlines: dict[str, Polygon], tree: shapely.STRtree) -> str:
    """The building at the place of an edit that names none; empty where there is none."""
    best, most = "", 0.0
    for k in tree.query(edit.polygon, predicate="intersects"):
        shared = shapely.intersection(outlines[names[k]], edit.polygon).area
        if shared > most and shared >= HALF * min(edit.polygon.area, outlines[names[k]].area):
            best, most = names[k], float(shared)
    return best


@dataclass
class Draft:
    """A part of a building as its edits have left it: its outline, its roof, and the edits that hold."""

    outline: Polygon
    shape: str = ""
    base: float | None = None
    changes: tuple[StatedFace | float, ...] = ()
    used: list[Edit] = field(default_factory=list)
    gone: bool = False

    def take(self, name: str, edit: Edit, conflicts: list[str]) -> None:
        """Take up an edit; the later one holds."""
        verdict, last = edit.verdict, self.used[-1].verdict if self.used else ""
        if (verdict == NO_BUILDING) != self.gone and self.used and (self.gone or last != RIGHT):
            conflicts += [f"{name}: '{verdict}' after '{last}': the later one holds"] * (not edit.action)
            self.used = []
        drawn = any(one.verdict in (FOOTPRINT, PARTY_WALLS) for one in self.used)
        if verdict in (IS_BUILDING, FOOTPRINT) and drawn and not edit.action:
            conflicts.append(f"{name}: a second outline: the later one holds")
        self.gone = verdict == NO_BUILDING
        self.used.append(edit)
        if verdict in OUTLINES:
            self.outline = edit.polygon
        elif verdict in SHAPES:  # all of the roof is another; its eaves stay where they are stated
            self.shape = SHAPES[verdict]
            self.changes = tuple(one for one in self.changes if isinstance(one, float))[-1:]
        elif verdict == ROOF_FACE:
            self.changes += (StatedFace(edit.polygon, edit.plane),)
        elif verdict == EAVES_HEIGHT and edit.value is not None:
            self.changes += (edit.value,)
        elif verdict == BASE_HEIGHT:
            self.base = edit.value

    @property
    def attributes(self) -> dict[str, str]:
        """What the building says of its edits."""
        words = {"edit": [edit.verdict for edit in self.used]}
        words["edit_source"] = [edit.source for edit in self.used]
        words["reviewed"] = [edit.reviewed for edit in self.used if edit.reviewed][-1:]
        return {name: ", ".join(dict.fromkeys(some)) for name, some in words.items() if some}

    @property
    def roof(self) -> StatedRoof:
        """What they state of the roof."""
        method, code = method_of(self.shape)
        return StatedRoof(self.base, self.shape, self.changes, method, code)


def method_of(shape: str) -> tuple[Reconstructor | None, tuple[str, ...]]:
    """The method that makes roofs of a shape, with the digests of its code; None for that of the run."""
    if shape not in (GABLE, HIP):
        return None, ()
    houses = {"only": shape, "empty_share": 1.0, "unexplained_share": 1.0}
    method = resolve_method("reconstruct", {"method": "maas_vosselman", "houses": houses})
    assert isinstance(method, Reconstructor)
    return method, tuple(code_of_methods(method))


def settled(name: str, edits: Sequence[Edit], outline: Polygon, conflicts: list[str]) -> Order:
    """The outcome of the edits of one building: of each of its parts the latest outline and roof, and the
    latest word on whether it is one."""
    parts = {name: Draft(outline)}
    division: tuple[str, int] | None = None
    for edit in edits:
        if edit.id not in parts and divided(edit.id, {name: 0}):
            conflicts.append(f"{edit.verdict} of '{edit.id}': it is no part of {name} now; left out")
            continue
        first = next(one for one in (edit.id, name, *parts) if one in parts)
        targets = [first] if len(parts) == 1 or first != name else meant(edit, parts)
        if edit.verdict == PARTY_WALLS and division == (first, edit.action):
            fresh = next(free for n in count(2) if (free := f"{first}-{n}") not in parts)
            near = parts[first]
            parts[fresh] = Draft(edit.polygon, near.shape, near.base, near.changes, [edit])
        elif edit.verdict in OUTLINES:
            for other in [*targets, *meant(edit, parts)]:
                if other != first:
                    parts.pop(other, None)
            parts[first].take(first, edit, conflicts)
        else:
            for target in targets:
                parts[target].take(target, edit, conflicts)
        if edit.verdict in OUTLINES:
            division = (first, edit.action) if edit.verdict == PARTY_WALLS else None
    left = {key: part for key, part in parts.items() if not part.gone}
    ordered = tuple(OrderedPart(key, part.outline, part.roof, part.attributes) for key, part in left.items())
    stays = all(edit.verdict == RIGHT for part in parts.values() for edit in part.used) and len(parts) == 1
    return Order(name, ordered, next(iter(parts.values())).attributes, stays)


def meant(edit: Edit, parts: Mapping[str, Draft]) -> list[str]:
    """The parts of a building that the place of an edit covers by half; the one that it names where it covers
    none."""
    covered = [
        name
        for name, part in parts.items()
        if shapely.intersection(part.outline, edit.polygon).area >= HALF * part.outline.area
    ]
    return covered or [name for name in parts if name == edit.id]
