"""The queue of buildings to be looked at, and what a town's edits say of the reasons that put them there."""

from __future__ import annotations

import csv
import json
import re
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely import Polygon

from eaves.flow import Edit, read_edits
from eaves.formats import read_polygons, write_cityjson_seq
from eaves.report import Contents, Sample, describe_run, iter_arrays, iter_data, iter_page


@dataclass(frozen=True)
class Reviewed:
    """A building to be looked at: its id, what may be wrong of it (m²), and why."""

    id: str
    worth_m2: float
    reason: str


def read_queue(folder: Path) -> list[Reviewed]:
    """The buildings of the table `review.csv` of a run, in its order; none where it wrote none."""
    path = folder / "review.csv"
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return [Reviewed(row["id"], float(row["worth_m2"]), row["reason"]) for row in csv.DictReader(file)]


def kinds_of(reason: str) -> list[str]:
    """The single reasons of a building, without their numbers."""
    return [re.sub(r"[\d.,]+ ?%?", "…", part).strip() for part in reason.split("; ") if part]


def summarise(edits: Sequence[Edit]) -> str:
    """Which reasons of the review led to edits, and which did not, a line each."""
    looked: dict[str, tuple[str, bool]] = {}
    for edit in edits:
        if edit.reason:
            _, changed = looked.get(edit.id, ("", False))
            looked[edit.id] = edit.reason, changed or edit.verdict != "right"
    led, count = Counter[str](), Counter[str]()
    for reason, changed in looked.values():
        for kind in dict.fromkeys(kinds_of(reason)):
            count[kind] += 1
            led[kind] += changed
    changed_count = sum(changed for _, changed in looked.values())
    verdicts = Counter(edit.verdict for edit in edits)
    counts = ", ".join(f"{name} {n}" for name, n in verdicts.most_common()) or "none"
    lines = [
        f"{len(edits)} edit{'s' * (len(edits) != 1)}: {counts}",
        f"{len(looked)} buildings of the review were looked at: {changed_count} edited, "
        f"{len(looked) - changed_count} right",
    ]
    lines += [f"  {led[kind]:>4} of {n:>4} edited: {kind}" for kind, n in count.most_common()]
    return "\n".join(lines)


def summarise_folder(folder: Path) -> str:
    """The same of the edits that a run's folder keeps."""
    path = folder / "edits.gpkg"
    system = read_polygons(folder / "footprints.gpkg", "footprints")[3]
    return summarise(read_edits(path, system) if path.exists() else [])


PLACE = files("eaves.edit").joinpath("page")
SCRIPT = "edit.js"
GONE = ("point", "terrain")
"""Arrays of the page that edits leave as they are begin so."""
BARE_M = 0.75
"""A place of a plan farther than this (m) from every point has none: thrice the spacing of a common scan."""
FACE_COLOURS = ("#b9b3a6", "#d8c9a3", "#c58c63", "#8f6a50", "#a5a99c", "#7f8c94", "#9fb0b8", "#cfd6d8")
"""By the direction that a face falls to, an eighth of a turn each; the level ones have the first."""


def page_of(contents: Contents, data: Mapping[str, Any]) -> bytes:
    """The page with the panel of the table, its script and the data of both."""
    page = "".join(iter_page(contents, describe_run(contents.folder), data={"edit": dict(data)}))
    panel, style = (PLACE.joinpath(f"panel.{kind}").read_text("utf-8") for kind in ("html", "css"))
    script = f'<script defer src="{SCRIPT}"></script>'
    for mark, more in (
        ('<section id="stage" aria-label="3D scene">', panel),
        ("script-src ", "'self' "),
        ("<body>", f"<style>{style}</style>{script}"),
    ):
        before, found, after = page.partition(mark)
        assert found, mark
        page = before + found + more + after
    return page.encode()


def script_of(name: str) -> bytes | None:
    """The script of the tools; None for another name."""
    return PLACE.joinpath(SCRIPT).read_bytes() if name == SCRIPT else None


def plan_of(polygon: Any, origin: tuple[float, float]) -> list[list[list[float]]]:
    """The rings of an outline (world metres) on the page, without repeated last corners."""
    rings = [ring for part in shapely.get_parts(polygon) for ring in (part.exterior, *part.interiors)]
    return [np.round(shapely.get_coordinates(ring)[:-1] - origin, 3).tolist() for ring in rings]


def drawn(contents: Contents, buildings: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """What the page draws of buildings: row, arrays and plan of each that is there, the ids of the others."""
    there = [drawn_building(contents, saved, folder) for saved in buildings.values() if saved is not None]
    return {"changed": there, "gone": [name for name, saved in buildings.items() if saved is None]}


def drawn_building(contents: Contents, saved: Any, folder: Path) -> dict[str, Any]:
    """Row, arrays and plan of a building; its model goes through the same file and functions as those of a
    whole page."""
    row, shape, nothing = saved.row.numbered(0, None), saved.row.polygon, np.zeros((0, 0), np.float32)
    with tempfile.TemporaryDirectory(dir=folder) as place:
        models = Path(place) / "changed.city.jsonl"
        write_cityjson_seq(models, [saved.result.outcome], contents.system)
        some = contents.filled([row], [shape], models, Sample.empty(), nothing, None)
    arrays = iter_arrays(replace(some, terrain=contents.terrain))
    kept = ((name, values) for name, values in arrays if not name.startswith(GONE))
    words: dict[str, Any] = json.loads("".join(iter_data({"row": row}, kept)))
    return {**words, "plan": plan_of(shape, contents.origin)}


def queue_of(
    queue: list[Reviewed], contents: Contents, outlines: Mapping[str, Polygon], looked: Mapping[str, Any]
) -> Iterator[dict[str, Any]]:
    """The queue as the page shows it: with the lines that mark the reason, and the verdict of a person."""
    origin = np.array(contents.origin)
    points = shapely.STRtree(shapely.points(contents.points.xyz[:, :2]))
    for entry in queue:
        edit, outline = looked.get(entry.id), outlines.get(entry.id)
        marks = []
        if outline is not None:
            local = shapely.transform(outline, lambda xy: xy - origin)
            near = [shapely.transform(outlines[name], lambda xy: xy - origin) for name in outlines]
            marks = list(marks_of(entry.reason, local, points, near))
        yield {
            "id": entry.id,
            "worth_m2": entry.worth_m2,
            "reason": entry.reason,
            "marks": marks,
            "reviewed": None if edit is None else {"date": edit.reviewed, "verdict": edit.verdict},
        }


def marks_of(
    reason: str, plan: Polygon, points: shapely.STRtree, others: list[Polygon]
) -> Iterator[list[list[float]]]:
    """The lines [x, y] that show where a reason is: around the part of the plan without points, along the
    party walls, else the edges beside which nothing was seen, or the whole outline."""
    marked: Any = plan.boundary
    if "no points" in reason or "not supported" in reason:
        inside = points.geometries.take(points.query(plan, predicate="intersects"))
        bare = shapely.difference(plan, shapely.union_all(shapely.buffer(inside, BARE_M, quad_segs=2)))
        marked = bare.boundary if bare.area > BARE_M**2 else marked
    elif "party wall" in reason:
        near = [one for one in others if one.distance(plan) <= BARE_M and not one.equals(plan)]
        shared = shapely.intersection(plan.boundary, shapely.buffer(shapely.union_all(near), 0.1))
        marked = shared if shared.length > BARE_M else marked
    elif "seen beside" in reason:
        band = shapely.difference(shapely.buffer(plan, 2.0), plan)
        beside = points.geometries.take(points.query(band, predicate="intersects"))
        blank = shapely.difference(plan.boundary, shapely.union_all(shapely.buffer(beside, 2.0, quad_segs=2)))
        marked = blank if blank.length > BARE_M else marked
    for line in shapely.get_parts(shapely.line_merge(marked) if marked.geom_type != "LineString" else marked):
        yield np.round(shapely.get_coordinates(line), 2).tolist()


def picture_of(saved: Any) -> str:
    """A roof from above as SVG: its faces in the colours of their directions; empty without a model."""
    if saved is None or not saved.row.faces:
        return ""
    west, south, east, north = saved.row.polygon.bounds
    faces = []
    for polygon, figures in saved.row.faces:
        turn = figures.get("azimuth_deg")
        colour = FACE_COLOURS[
            0 if turn is None or figures["slope_deg"] < 5.0 else 1 + int(turn / 360.0 * 7) % 7
        ]
        ring = shapely.get_coordinates(polygon.exterior)
        places = " ".join(f"{x - west:.2f},{north - y:.2f}" for x, y in ring)
        faces.append(f'<polygon points="{places}" fill="{colour}"/>')
    box = f"-1 -1 {east - west + 2:.1f} {north - south + 2:.1f}"
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{box}" '
        f'stroke="#222" stroke-width="0.15">{"".join(faces)}</svg>'
    )
