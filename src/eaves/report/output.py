"""The page as an output of a run."""

from __future__ import annotations

import base64
import html
import json
import zlib
from collections.abc import Iterable, Iterator
from importlib.resources import files
from itertools import chain
from pathlib import Path
from string import Template
from typing import Any
from urllib.parse import quote

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.formats.columns import COLUMNS as MEANINGS
from eaves.formats.whole_files import atomic
from eaves.model import LODS, Integers, Points, Raster, Values
from eaves.model.coordinates import describe_units
from eaves.model.summary import Summary
from eaves.report.contents import (
    BUILDINGS_SHOWN,
    POINTS_SHOWN,
    CityFace,
    CityFaces,
    Contents,
    fit_web_mercator,
    in_pieces,
    local_rings,
    read_contents,
)
from eaves.report.sample import PointSample

COLUMNS = {
    "id": "id",
    "trust": "trust",
    "review_reason": "why to review",
    "area_m2": "area (m²)",
    "measuredHeight": "height (m)",
    "lod": "LoD",
    "roof_type": "roof",
    "score": "score",
    "h_ground": "ground above datum (m)",
    "h_eaves": "eaves above datum (m)",
    "h_ridge": "ridge above datum (m)",
    "roof_face_count": "faces",
    "volume_m3": "volume (m³)",
    "points": "points",
    "rmse_m": "RMSE (m)",
    "failure_code": "failure",
    "failure_reason": "reason",
}
"""Columns of the table, where a run has them."""
CHARTED = ("rmse95_m", "trust_score")
"""Attributes that the page's histograms and its order show beside those of the table."""
KINDS: dict[str, type[np.unsignedinteger[Any]]] = {
    "building": np.uint32,
    "lod": np.uint8,
    "kind": np.uint8,
    "error": np.uint16,
}
"""The attributes of a triangle on the page."""
MILLIMETRES = 1000.0
UNKNOWN_DISTANCE = 32767
UNKNOWN_HEIGHT = 2_000_000_000
"""Stand for NaN, in millimetres."""
DEFLATION = 3
"""Level of the arrays' compression: half the time of zlib's default, for 2 % more bytes."""
DRAPE = 0.15
"""Outlines are drawn this much (m) over the terrain, in pieces no longer than `DRAPE_STEP` (m)."""
DRAPE_STEP = 3.0


def write_page(contents: Contents, text: str) -> Path:
    """Write report.html into the folder of `contents`; `text` is the summary of the run."""
    path = contents.folder / "report.html"
    with atomic(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        file.writelines(iter_page(contents, text))
    return path


def iter_page(
    contents: Contents,
    text: str,
    words: dict[str, str] | None = None,
    data: dict[str, Any] | None = None,
    arrays: Iterable[tuple[str, NDArray[Any]]] | None = None,
    lods: Iterable[int] | None = None,
    extension: str = "",
) -> Iterator[str]:
    """The page piece by piece: all of it is several times as large as its largest array.

    `words` of the page, its `data`, its `arrays` and the levels of detail replace those of the contents;
    `extension` is script that brings tools (`page/src/tools.js`).
    """
    folder = files("eaves.report").joinpath("page")
    parts = {name: folder.joinpath(name).read_text("utf-8") for name in ("page.html", "style.css", "page.js")}
    lines = [line for line in text.split("\n") if ": trust high " in line] or text.split("\n")
    names = [Path(entry["path"]).name for entry in contents.run.get("inputs", ())]
    title = f"{names[0]}{f' and {len(names) - 1} more' if len(names) > 1 else ''}: " if names else ""
    shown, total = len(contents.rows), contents.buildings
    levels = {0, *contents.faces.lod.tolist()} if lods is None else set(lods)
    before, after = parts["page.html"].split("$data")
    said = dict(
        title=f"{title}buildings by eaves",
        headline=lines[0],
        shown=say_shown(contents),
        heading=f"{total:,} buildings" + (f", {shown:,} of them drawn" if shown < total else ""),
    ) | (words or {})
    filled = {name: html.escape(value) for name, value in said.items()} | dict(
        style=parts["style.css"],
        script=parts["page.js"],
        extension=extension,
        lods="".join(f"<option>{LODS[number]}</option>" for number in sorted(levels, reverse=True)),
        summary=html.escape(text),
        files=" · ".join(f"<a href='{name}'>{name}</a>" for name in linked_files(contents.folder)),
        run=html.escape(json.dumps(contents.run, indent=1, default=str)),
    )
    yield Template(before).substitute(filled)
    yield from iter_data(
        page_data(contents) | (data or {}), iter_arrays(contents) if arrays is None else arrays
    )
    yield Template(after).substitute(filled)


def linked_files(folder: Path) -> list[str]:
    """The names of the files beside the page that it links to."""
    kinds = (".gpkg", ".csv", ".qgz", ".jsonl", ".tif", ".laz", ".json")
    names = sorted(path.name for path in folder.iterdir() if path.suffix in kinds)
    return [quote(name) for name in names]


def iter_data(data: dict[str, Any], arrays: Iterable[tuple[str, NDArray[Any]]]) -> Iterator[str]:
    """The data of the script as JSON, array by array."""
    yield as_json(data).removesuffix("}") + ',"arrays":{'
    for number, (name, values) in enumerate(arrays):
        yield "," * (number > 0) + f"{as_json(name)}:{as_json(packed_array(values))}"
    yield "}}"


def as_json(value: Any) -> str:
    """JSON that no browser takes for the end of the script."""
    return json.dumps(value, separators=(",", ":")).replace("<", "\\u003c")


def say_shown(contents: Contents, which: str = "those nearest to the middle") -> str:
    """Line that says how much of the run is drawn, and `which` of its buildings where not all are."""
    sample, rows = contents.points, len(contents.rows)
    parts = [f"all {len(sample):,} points drawn"]
    if len(sample) < sample.total:
        shown = int(np.count_nonzero(sample.building))
        parts = [
            f"{len(sample):,} of {sample.total:,} points drawn (thinned for the page)",
            f"on buildings {shown:,} of {sample.on_buildings:,}",
        ]
    parts.append(
        f"{rows:,} of {contents.buildings:,} buildings, {which}"
        if rows < contents.buildings
        else f"all {rows:,} buildings"
    )
    units = describe_units(contents.run.get("units", {}))
    parts += [f"all lengths here in metres; in the files {units}"] if units else []
    source = contents.run.get("footprint_source")
    parts += [f"footprints: {source['attribution']}"] if source else []
    parts += [f"aerial image: {contents.basemap.name}"] if contents.basemap else []
    return "; ".join(parts)


def page_data(contents: Contents, titles: dict[str, str] = COLUMNS) -> dict[str, Any]:
    """The data of the script besides the arrays: rows and names; `titles` are of the table's columns."""
    rows = [*contents.rows, *contents.others]
    filled = [name for name in titles if any(row.get(name) is not None for row in rows)]
    numbers = {name for name in filled if any(isinstance(row.get(name), int | float) for row in rows)}
    return {
        "rows": contents.rows,
        "others": pack_rows(contents.others, [*filled, *CHARTED]),
        "columns": [{"name": name, "title": titles[name], "number": name in numbers} for name in filled],
        "meanings": {name: [about.label, about.meaning] for name, about in MEANINGS.items()},
        "lods": LODS,
        "base": contents.base,
        "modelled": len(contents.faces) > 0,
        "origin": [*contents.origin, contents.base],
        "unit": contents.system.horizontal_unit_m,
        "basemap": contents.basemap.address if contents.basemap else None,
        "world": fit_web_mercator(
            contents.system,
            contents.origin,
            max(1.0, abs(contents.terrain.west), abs(contents.terrain.north)),
        ),
        "terrain": describe_terrain(contents.terrain),
    }


def describe_terrain(terrain: Raster) -> dict[str, float]:
    """The grid of a terrain as the page takes it."""
    rows, columns = terrain.shape
    place = {"cell": terrain.cell, "west": terrain.west, "north": terrain.north}
    return {"rows": rows, "columns": columns, **place}


def iter_arrays(contents: Contents) -> Iterator[tuple[str, NDArray[Any]]]:
    """Points, triangles, edges, outlines and terrain; buildings count from 1, 0 is none."""
    yield from page_points(contents)
    yield from triangle_arrays(contents)
    table = contents.faces.table
    corners = as_millimetres(table.corners)
    yield "edge_xyz", np.stack([corners, corners[table.following]], axis=1)
    yield "edge_building", (contents.faces.building[table.face_of_corner] + 1).astype(np.uint32)
    yield "edge_lod", contents.faces.lod[table.face_of_corner].astype(np.uint8)
    outlines, outline_row = draped_outlines(contents)
    yield "outline_xyz", as_millimetres(outlines)
    yield "outline_building", outline_row.astype(np.uint32)
    yield "terrain", terrain_array(contents.terrain.values)


def terrain_array(heights: NDArray[Any]) -> NDArray[np.int32]:
    """Heights (m) of the terrain's cells as the page takes them."""
    return np.round(np.nan_to_num(heights * MILLIMETRES, nan=UNKNOWN_HEIGHT)).astype(np.int32)


def page_points(contents: Contents) -> Iterator[tuple[str, NDArray[Any]]]:
    """The arrays (N,) of the points."""
    points = contents.points
    numbers = {int(row["number"]): place for place, row in enumerate(contents.rows, 1) if row.get("number")}
    row_of = np.zeros(max([*numbers, int(points.building.max(initial=0))], default=0) + 1, np.uint32)
    row_of[list(numbers)] = list(numbers.values())
    distance = np.clip(np.nan_to_num(contents.distance * MILLIMETRES, nan=1e9), -32767, UNKNOWN_DISTANCE)
    yield "point_xyz", as_millimetres(points.xyz)
    yield "point_class", points.classification
    yield "point_building", row_of[points.building]
    yield "point_plane", np.where(points.plane > 0, points.plane % 255 + 1, 0).astype(np.uint8)
    yield "point_distance", np.round(distance).astype(np.int16)


def triangle_arrays(contents: Contents) -> Iterator[tuple[str, NDArray[Any]]]:
    """The arrays (T,) of the triangles: those of the models, then those of the footprints, lying flat."""
    rings = enumerate(flat_footprints(contents))
    flat = CityFaces.of(CityFace(upright, number, 0, 0) for number, upright in rings)
    corners = [np.zeros((0, 3, 3), np.int32)]
    figures: dict[str, list[NDArray[Any]]] = {name: [] for name in KINDS}
    for piece in chain(in_pieces(contents.faces), in_pieces(flat)):
        corner, face = piece.table.triangles()
        corners.append(as_millimetres(piece.table.corners[corner]))
        for name, values in figures.items():
            values.append(getattr(piece, name)[face].astype(KINDS[name]))
    triangles = np.concatenate(corners)
    corners.clear()
    yield "triangle_xyz", triangles
    yield "triangle_building", np.concatenate([np.zeros(0, np.uint32), *figures["building"]]) + np.uint32(1)
    for name in ("lod", "kind", "error"):
        yield f"triangle_{name}", np.concatenate([np.zeros(0, KINDS[name]), *figures[name]])


def as_millimetres(xyz: Points) -> NDArray[np.int32]:
    """Coordinates as whole millimetres."""
    scaled = np.clip(xyz * MILLIMETRES, -UNKNOWN_HEIGHT, UNKNOWN_HEIGHT)
    return np.asarray(np.rint(scaled, out=scaled), np.int32)


def packed_array(values: NDArray[Any]) -> dict[str, str]:
    """Base64 of the deflated bytes, those of one significance together."""
    flat = np.ascontiguousarray(values).reshape(-1)
    stored = flat.astype(flat.dtype.newbyteorder("<"), copy=False)
    planes = stored.view(np.uint8).reshape(len(flat), flat.itemsize).T
    packed = zlib.compress(np.ascontiguousarray(planes).data, DEFLATION)
    return {"type": flat.dtype.name, "data": base64.b64encode(packed).decode("ascii")}


def pack_rows(rows: list[dict[str, Any]], names: list[str]) -> dict[str, Any]:
    """The named attributes of rows, a list each, as base64 of deflated JSON."""
    columns = [[row.get(name) for row in rows] for name in names]
    text = json.dumps(columns, separators=(",", ":"), default=str).encode("utf-8")
    return {"names": names, "data": base64.b64encode(zlib.compress(text, DEFLATION)).decode("ascii")}


def terrain_heights(contents: Contents, xy: Points) -> Values:
    """Heights (N,) of the drawn terrain at places (N, 2); 0 where it is not known."""
    if not contents.terrain.values.size:
        return np.zeros(len(xy))
    return np.asarray(np.nan_to_num(contents.terrain.at(xy), nan=0.0))


def flat_footprints(contents: Contents) -> list[tuple[Points, ...]]:
    """The rings of every footprint, level, at the highest terrain under its corners."""
    flat = []
    for shape in contents.polygons:
        rings = local_rings(shapely.get_parts(shape)[0])
        height = float(terrain_heights(contents, rings[0]).max(initial=-np.inf)) + DRAPE
        flat.append(tuple(np.column_stack([ring, np.full(len(ring), height)]) for ring in rings))
    return flat


def draped_outlines(contents: Contents) -> tuple[Points, Integers]:
    """The outlines on the terrain in short pieces, (E, 2, 3), and the row (from 1) of each."""
    pieces, owner = [np.zeros((0, 2, 3))], [np.zeros(0, np.int64)]
    for number, shape in enumerate(contents.polygons, 1):
        for ring in local_rings(shapely.segmentize(shape, DRAPE_STEP)):
            upright = np.column_stack([ring, terrain_heights(contents, ring) + DRAPE])
            pieces.append(np.stack([upright, np.roll(upright, -1, axis=0)], axis=1))
            owner.append(np.full(len(ring), number))
    return np.concatenate(pieces), np.concatenate(owner)


class Page:
    """The page of a run (`LateOutput`), which draws a sample of the points as they are written."""

    def __init__(self) -> None:
        self.sink = PointSample(POINTS_SHOWN, BUILDINGS_SHOWN)

    def write(self, summary: Summary) -> Path:
        """Write the page of what a run wrote; its path."""
        return write_page(read_contents(summary.folder, received=self.sink), summary.as_text())
