"""Building models as CityJSON 2.0 and CityJSONSeq 2.0, written (cityjson_read.py reads them back).

A Building has LoD 0, its footprint as one MultiSurface at the lowest height of its solids (for a failure
at `h_ground`), and one Solid for every LoD it reached, with GroundSurface, WallSurface and RoofSurface.
An LoD of several solids becomes BuildingParts `<id>-1`, `<id>-2`, …, children of the Building, each with
its solid.

`model.attributes` are the Building's attributes; its entry `surfaces`, a sequence aligned with
`model.planes` of attribute mappings (slope, azimuth, …), goes to the RoofSurfaces of those planes
instead. Attributes are in metres; coordinates in the coordinate system's units, in steps of 0.001 of the
unit or finer (never over 1 mm).
"""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import date, datetime
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np
from shapely import Polygon

from eaves.formats.crs import name_units
from eaves.formats.format import Format
from eaves.formats.whole_files import atomic
from eaves.model import (
    LOCAL_METRES,
    NOTHING_KNOWN,
    ROOF_SURFACE,
    WALL_SURFACE,
    BuildingModel,
    CoordinateSystem,
    Failure,
    Footprint,
    Installation,
    Provenance,
    Solid,
    Values,
)
from eaves.model.coordinates import describe_units

log = logging.getLogger("eaves")

VERSION = "2.0"
STEP_M = 0.001
"""Largest step of written coordinates (m): the transform's scale is the power of ten at or under it."""
CRS_URL = "https://www.opengis.net/def/crs/EPSG/0/"
WKT_MEMBER = "coordinateSystemWkt"
"""Member of the metadata with the WKT of a system that no URL identifies (no code, separate heights)."""
WALLS = "overhangs"
"""The entry that holds those of the walls of LoD 2.3."""
SURFACES = "surfaces"
"""The entry of `BuildingModel.attributes` that holds the attributes of the roof planes."""

Json = dict[str, Any]
Result = BuildingModel | Failure


def write_cityjson_seq(
    path: str | Path,
    models: Iterable[Result | str],
    system: CoordinateSystem = LOCAL_METRES,
    title: str = "",
    provenance: Provenance = NOTHING_KNOWN,
    translate: Sequence[float] | None = None,
) -> int:
    """Write one line of metadata and one line a building.

    Models are taken one by one, so any number of them can stream through. A Failure that has its footprint is
    written too, with LoD 0 and the attributes `failure_code` and `failure_reason`.

    Parameters
    ----------
    path : str or Path
        The file (`.city.jsonl`); it appears when it is whole.
    models : iterable of BuildingModel, Failure or str
        Buildings in metres about their footprint's origin, or their lines, written with the same system and
        `translate` before.
    system : CoordinateSystem
        Coordinate system the coordinates are written in.
    title : str
        Title in the metadata, if any.
    provenance : Provenance
        Data the models are made from, recorded in the file.
    translate : sequence of float, or None
        Origin of all coordinates (x, y, z in the system's units); None for the corner of the first
        building's block. A file that follows another keeps its lines by keeping this.

    Returns
    -------
    int
        The number of buildings.

    Raises
    ------
    InputError
        When the folder cannot be written.

    Examples
    --------
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> models = [building.model(truth.cloud.origin) for building in truth.buildings]
    >>> from eaves.formats import write_cityjson_seq
    >>> write_cityjson_seq("nine.city.jsonl", models)
    9
    """
    count = 0
    with atomic(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        known = (model for model in models if isinstance(model, str) or model.footprint is not None)
        first = list(islice(known, 1))
        near = next((model.footprint for model in first if not isinstance(model, str)), None)
        vertices = _Vertices(system, near, translate)
        head = _frame(vertices, system, title, provenance)
        file.write(_line(head | {"CityObjects": {}, "vertices": []}))
        for count, model in enumerate(chain(first, known), 1):
            if isinstance(model, str):
                file.write(model)
                continue
            vertices.clear()
            objects = _city_objects(model, vertices, f"building-{count}")
            feature = {"type": "CityJSONFeature", "id": next(iter(objects))}
            file.write(_line(feature | {"CityObjects": objects, "vertices": vertices.integers}))
    return count


def write_cityjson(
    path: str | Path,
    models: Iterable[Result],
    system: CoordinateSystem = LOCAL_METRES,
    title: str = "",
    provenance: Provenance = NOTHING_KNOWN,
) -> int:
    """Write all buildings as one CityJSON object.

    Parameters
    ----------
    path : str or Path
        The file (`.city.json`); it appears when it is whole.
    models : iterable of BuildingModel or Failure
        Buildings in metres about their footprint's origin; a Failure that has its footprint is written with
        LoD 0.
    system : CoordinateSystem
        Coordinate system the coordinates are written in.
    title : str
        Title in the metadata, if any.
    provenance : Provenance
        Data the models are made from, recorded in the file.

    Returns
    -------
    int
        The number of buildings.

    Raises
    ------
    InputError
        When the folder cannot be written.

    Examples
    --------
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> models = [building.model(truth.cloud.origin) for building in truth.buildings]
    >>> from eaves.formats import write_cityjson
    >>> write_cityjson("nine.city.json", models, title="nine roofs")
    9
    """
    city = as_cityjson(models, system, title, provenance)
    with atomic(path) as temporary:
        temporary.write_text(_line(city), encoding="utf-8", newline="\n")
    return sum(not one.get("parents") for one in city["CityObjects"].values())


def as_cityjson(
    models: Iterable[Result],
    system: CoordinateSystem = LOCAL_METRES,
    title: str = "",
    provenance: Provenance = NOTHING_KNOWN,
) -> Json:
    """All buildings as one CityJSON object; the arguments are those of `write_cityjson`."""
    writer, count = _Vertices(system), 0
    objects: dict[str, Json] = {}
    for model in models:
        if model.footprint is None:
            continue
        if count == 0:
            writer = _Vertices(system, model.footprint)
        count += 1
        _add_objects(objects, _city_objects(model, writer, f"building-{count}"))
    frame = _frame(writer, system, title, provenance)
    if writer.integers:
        corners = np.array(writer.integers) * writer.scale + writer.translate
        extent = {"geographicalExtent": [*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist()]}
        frame["metadata"] = extent | frame.get("metadata", {})
    return frame | {"CityObjects": objects, "vertices": writer.integers}


def reference_system(system: CoordinateSystem) -> str | None:
    """The OGC URL of the system: of the compound code where registered, else of its horizontal part, else
    None."""
    if system.code is None:
        return None
    return CRS_URL + system.code.removeprefix("EPSG:").split("+")[0]


def clean(value: Any) -> Any:
    """A value as JSON can hold it: NaN and infinity become null, numpy's types Python's, dates text."""
    if value is None or isinstance(value, (str, int)):  # most values are; a union is half as fast
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): clean(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return clean(value.tolist())
    if isinstance(value, list | tuple | set | frozenset):
        return [clean(item) for item in (sorted(value) if isinstance(value, set | frozenset) else value)]
    return value.isoformat() if isinstance(value, date | datetime) else str(value)


def attributes_of(result: Result) -> Json:
    """The attributes written for a building: its footprint's, overruled by its own; why it failed."""
    footprint = result.footprint
    attributes: Json = {} if footprint is None else {"score": footprint.score, **footprint.attributes}
    if isinstance(result, BuildingModel):
        attributes |= {
            name: value for name, value in result.attributes.items() if name not in (SURFACES, WALLS)
        }
    else:
        attributes |= {"failure_code": result.code, "failure_reason": result.reason}
    return attributes


def installation_figures(one: Installation) -> Json:
    """The attributes written for an installation beside its function."""
    area = round(float(one.polygon.area), 2)
    return {"height_m": round(float(one.height), 2), "points": one.points, "area_m2": area}


class _Vertices:
    """The vertex list of one feature, or of one file: coordinates to whole steps, each once."""

    def __init__(
        self,
        system: CoordinateSystem,
        near: Footprint | None = None,
        translate: Sequence[float] | None = None,
    ) -> None:
        self.unit = np.array(system.unit_m)
        self.scale = 10.0 ** np.floor(np.log10(STEP_M / self.unit) + 1e-9)
        start = near.origin if near is not None else (0.0, 0.0)
        if near is not None and system.wkt is not None and not any(start):
            log.warning("models stand about 0, 0 of %s: give `trace_outline` their origin", system.code)
        self.translate = np.floor(np.array([*start, 0.0]) / self.unit)
        if translate is not None:
            self.translate = np.array(translate, np.float64)
        self.integers: list[list[int]] = []
        self._number: dict[tuple[int, ...], int] = {}

    def clear(self) -> None:
        """Leave the vertices out, and keep the frame."""
        self.integers.clear()
        self._number.clear()

    def add(self, xyz: Values, origin: tuple[float, float]) -> list[int]:
        """Numbers of vertices (N, 3) given in metres about `origin`."""
        steps = np.round(((xyz + np.array([*origin, 0.0])) / self.unit - self.translate) / self.scale).astype(
            np.int64
        )
        numbers = []
        for vertex in map(tuple, steps.tolist()):
            number = self._number.setdefault(vertex, len(self.integers))
            if number == len(self.integers):
                self.integers.append(list(vertex))
            numbers.append(number)
        return numbers


def _frame(vertices: _Vertices, system: CoordinateSystem, title: str, provenance: Provenance) -> Json:
    metadata: Json = {"title": title} if title else {}
    url = reference_system(system)
    if url is not None:
        metadata["referenceSystem"] = url
    heights_are_said = system.horizontal_unit_m == system.vertical_unit_m or " + height" not in (
        system.wkt or ""
    )
    if system.wkt is not None and (system.code is None or "+" in system.code or not heights_are_said):
        metadata[WKT_MEMBER] = system.wkt
    units = name_units(system)
    metadata |= provenance.members | ({"units": units} if describe_units(units) else {})
    frame: Json = {"type": "CityJSON", "version": VERSION}
    frame["transform"] = {"scale": vertices.scale.tolist(), "translate": vertices.translate.tolist()}
    return frame | ({"metadata": metadata} if metadata else {})


def _city_objects(result: Result, vertices: _Vertices, name: str) -> dict[str, Json]:
    """The Building and its parts, the Building first."""
    footprint = result.footprint
    assert footprint is not None
    identifier = footprint.id or name
    solids = result.solids if isinstance(result, BuildingModel) else {}
    attributes = attributes_of(result)
    bottoms = [solid.vertices[:, 2].min() for parts in solids.values() for solid in parts]
    base = min(bottoms) if bottoms else float(attributes.get("h_ground") or 0.0)
    empty = footprint.polygon.is_empty
    geometries = [] if empty else [_footprint_surface(footprint, base, vertices)]
    parts: dict[str, Json] = {}
    for lod in sorted(solids):
        written = [
            _solid(solid, lod, result, footprint.origin, vertices)  # type: ignore[arg-type]
            for solid in solids[lod]
        ]
        if len(written) == 1:
            geometries += written
        else:
            for number, geometry in enumerate(written, 1):
                part = parts.setdefault(
                    f"{identifier}-{number}",
                    {"type": "BuildingPart", "parents": [identifier], "geometry": []},
                )
                part["geometry"].append(geometry)
    if isinstance(result, BuildingModel):
        for number, one in enumerate(result.installations, 1):
            shape = BuildingModel(footprint, {})
            parts[f"{identifier}-i{number}"] = {
                "type": "BuildingInstallation",
                "parents": [identifier],
                "attributes": clean({"function": one.kind, **installation_figures(one)}),
                "geometry": [
                    _solid(one.solid, max(solids, default="2.2"), shape, footprint.origin, vertices)
                ],
            }
    building: Json = {"type": "Building", "attributes": clean(attributes)}
    building |= {"children": list(parts)} if parts else {}
    return {identifier: building | {"geometry": geometries}} | parts


def _add_objects(objects: dict[str, Json], new: dict[str, Json]) -> None:
    """Add the objects of one building. Where a part has the id of a building, the part gets another one."""
    for name in list(new):
        while name in objects:
            holder = objects if "parents" in objects[name] else new
            if "parents" not in holder[name]:
                raise ValueError(f"two buildings have the id {name!r}")
            _rename_part(holder, name, {*objects, *new})
            if holder is new:
                break
    objects.update(new)


def _rename_part(objects: dict[str, Json], name: str, taken: set[str]) -> None:
    """Give a part of a building an id that no object has."""
    number = 2
    while (other := f"{name}~{number}") in taken:
        number += 1
    part = objects.pop(name)
    objects[other] = part
    for parent in part["parents"]:
        children = objects[parent]["children"]
        children[children.index(name)] = other


def _footprint_surface(footprint: Footprint, base: float, vertices: _Vertices) -> Json:
    rings = [_spaced(ring) for ring in _polygon_rings(footprint.polygon)]
    numbers = [
        vertices.add(np.column_stack([ring, np.full(len(ring), base)]), footprint.origin) for ring in rings
    ]
    boundary = _distinct(numbers)
    return {"type": "MultiSurface", "lod": "0", "boundaries": [boundary] if boundary else []}


def _spaced(ring: Values) -> Values:
    """A ring (M, 2) without points that would be one with the point before them: validators snap at a step,
    and rounding moves each point by up to a half."""
    if (np.hypot(*(ring - np.roll(ring, 1, axis=0)).T) > 2 * STEP_M).all():
        return ring
    kept = [ring[0]]
    for point in ring[1:]:
        if np.hypot(*(point - kept[-1])) > 2 * STEP_M:
            kept.append(point)
    while len(kept) > 1 and np.hypot(*(kept[-1] - kept[0])) <= 2 * STEP_M:
        kept.pop()
    return np.array(kept)


def _polygon_rings(polygon: Polygon) -> Iterator[Values]:
    """Rings (M, 2) without repeated point, counter-clockwise outside, clockwise holes."""
    if polygon.is_empty:
        return
    for ring, wanted in ((polygon.exterior, True), *((hole, False) for hole in polygon.interiors)):
        points = np.asarray(ring.coords)[:-1, :2]
        yield points if ring.is_ccw == wanted else points[::-1]


def _solid(
    solid: Solid, lod: str, model: BuildingModel, origin: tuple[float, float], vertices: _Vertices
) -> Json:
    numbers = np.array(vertices.add(solid.vertices, origin), np.int64)[solid.corners].tolist()
    ends = solid.ring_sizes.cumsum().tolist()
    rings = (numbers[start:end] for start, end in zip([0, *ends], ends, strict=False))
    faces = zip(solid.ring_counts.tolist(), solid.surfaces.tolist(), solid.planes.tolist(), strict=True)
    given: Sequence[Mapping[str, Any]] = model.attributes.get(SURFACES, ())
    walls: Sequence[Mapping[str, Any]] = model.attributes.get(WALLS, ())
    surfaces: list[Json] = []
    number_of: dict[tuple[str, int], int] = {}
    shell, values = [], []
    for count, surface, plane in faces:
        boundary = _distinct(list(islice(rings, count)))
        if not boundary:
            continue
        key = (surface, plane)
        if key not in number_of:
            number_of[key] = len(surfaces)
            about: Json = {"type": surface}
            details = {ROOF_SURFACE: given, WALL_SURFACE: walls}.get(surface, ())
            if 0 <= plane < len(details):
                about |= clean(details[plane])
            surfaces.append(about)
        shell.append(boundary)
        values.append(number_of[key])
    semantics = {"surfaces": surfaces, "values": [values]}
    return {"type": "Solid", "lod": lod, "boundaries": [shell], "semantics": semantics}


def _distinct(rings: list[list[int]]) -> list[list[int]]:
    """Rings without repeated neighbours; a hole that shrank to nothing goes, a face whose outer ring did
    is empty."""
    outer, *_ = kept = [
        ring
        if len(set(ring)) == len(ring)
        else [vertex for position, vertex in enumerate(ring) if vertex != ring[position - 1]]
        for ring in rings
    ] or [[]]
    return [ring for ring in kept if len(set(ring)) >= 3] if len(set(outer)) >= 3 else []


def _line(value: Json) -> str:
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False) + "\n"


FORMAT = Format({"models": ("buildings.city.json", write_cityjson)})
