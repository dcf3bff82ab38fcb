"""CityJSON and CityJSONSeq files, validated as written."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from eaves.formats import InputError
from eaves.formats.models.cityjson_read import system_of_head
from eaves.geometry.face_table import FaceTable, RoofFaces, fit_roof, roof_point_mask
from eaves.model import ROOF_SURFACE, BuildingModel, Finding, Integers, Points, Values
from eaves.model.checks import as_points, check_type
from eaves.validate.models import ReadPrimitive, Tolerances, check_primitives, make_finding
from eaves.validate.polygons import FINEST_STEP

MISSED_RMSE = 1.0
"""The RMSE (m) of a building without any face under its points."""


@dataclass(frozen=True)
class Fit:
    """Distances (m) of roof points to a model along the normals of the faces.

    Parameters
    ----------
    points : int
        Number of roof points that count.
    missed : float
        Share of the roof points (0 to 1) with no face under or over them.
    median, rmse : float
        Median and root mean square of the distances (m) of the others.
    within_01, within_02, within_05 : float
        Shares (0 to 1) of all points that are within 0.1, 0.2 and 0.5 m of a face.

    Examples
    --------
    >>> from eaves.validate import Fit
    >>> Fit(100, 0.02, 0.03, 0.05, 0.95, 0.97, 0.98).missed
    0.02
    """

    points: int
    missed: float
    median: float
    rmse: float
    within_01: float
    within_02: float
    within_05: float


def fit_to_points(model: BuildingModel, points: Points, lod: str | None = None) -> Fit | None:
    """The fit of a model to the points of its building.

    Parameters
    ----------
    model : BuildingModel
        The building, in local metres.
    points : ndarray (N, 3) of float64
        Points in the same local metres; only roof points inside the footprint count.
    lod : str or None
        The level of detail; None is the model's finest.

    Returns
    -------
    Fit or None
        None when the model has no such level, or no point counts.

    Raises
    ------
    TypeError
        When `model` is no BuildingModel, or `points` no float64 array.
    ValueError
        When `points` has another shape.

    Examples
    --------
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> from eaves.validate import fit_to_points
    >>> truth = nine_roofs_on_a_slope(density=4.0, noise=0.02)
    >>> fit = fit_to_points(truth.buildings[0].model(), truth.cloud.xyz[truth.building == 1])
    >>> bool(fit.median < 0.03)
    True
    """
    check_type(model, BuildingModel, "model", "give the result of reconstruct_building that is no Failure")
    points = as_points(points)
    inside = shapely.contains_xy(model.footprint.polygon, points[:, 0], points[:, 1])
    roof = points[inside & roof_point_mask(points)]
    if len(roof) == 0:
        return None
    distance = np.abs(fit_roof(roof, roof_faces(model, lod or model.lod)).distance)
    hit = np.isfinite(distance)
    if not hit.any():
        return Fit(len(roof), 1.0, float("nan"), MISSED_RMSE, 0.0, 0.0, 0.0)
    reach = np.where(hit, distance, np.inf)
    return Fit(
        len(roof),
        float(1.0 - hit.mean()),
        float(np.median(distance[hit])),
        float(np.sqrt(np.mean(distance[hit] ** 2))),
        *(float((reach < limit).mean()) for limit in (0.1, 0.2, 0.5)),
    )


def roof_faces(model: BuildingModel, lod: str) -> RoofFaces:
    """The roof faces of a model at a level of detail."""
    return RoofFaces.of(FaceTable.of_solids(model.solids.get(lod, ()), ROOF_SURFACE))


OF_BUILDING = ("BuildingPart", "BuildingInstallation")
"""City objects whose solids share no volume with their building's."""

VERSIONS = ("1.0", "1.1", "2.0")

DEPTHS = {
    "GeometryInstance": 1,
    "MultiPoint": 1,
    "MultiLineString": 2,
    "MultiSurface": 3,
    "CompositeSurface": 3,
    "Solid": 4,
    "MultiSolid": 5,
    "CompositeSolid": 5,
}
"""Geometry type → how many lists deep its vertices lie."""

FEATURES_AT_ONCE = 2_000
"""Features of a CityJSONSeq checked together: enough to keep arrays long, few enough to bound memory."""

FARTHEST = 2.0**52
"""Largest coordinate (steps): whole numbers are exact in floating point up to there."""


@dataclass(frozen=True, eq=False)
class Grid:
    """The grid coordinates are written on: place = written · scale + translate (m), in units of `step` m."""

    scale: Values
    translate: Values
    step: float = FINEST_STEP

    def places(self, written: Any) -> Integers:
        """Written vertices as (V, 3) whole numbers of steps; ValueError states what is wrong with them."""
        try:
            if not {type(number) for vertex in written for number in vertex} <= {int, float}:
                raise TypeError  # words and truths, of which numpy makes numbers
            numbers = np.asarray(written, np.float64)
        except (TypeError, ValueError, OverflowError):
            raise ValueError("the vertices are not lists of three numbers") from None
        if numbers.size == 0:
            return np.zeros((0, 3), np.int64)
        if numbers.ndim != 2 or numbers.shape[1] != 3:
            raise ValueError("the vertices are not lists of three numbers")
        if not np.isfinite(numbers).all():
            raise ValueError("a vertex is not finite")
        steps = np.rint(numbers * (self.scale / self.step)) + np.rint(self.translate / self.step)
        if np.abs(steps).max() > FARTHEST:
            raise ValueError("a vertex is beyond any place on Earth")
        return np.asarray(steps, np.int64)


def validate_file(path: str | Path, tolerances: Tolerances | None = None) -> list[Finding]:
    """All findings of the solids of a CityJSON or CityJSONSeq file, in the order of its buildings; none means
    valid. Attributes, semantics and appearance are not checked.

    The coordinates are checked as written (whole numbers and transform). The limits are metres also where the
    file's unit is the foot; val3dity's are in the file's unit. Of CityJSONSeq some features are in memory
    at a time.

    Parameters
    ----------
    path : str or Path
        `.city.json` or `.city.jsonl`.
    tolerances : Tolerances or None
        Limits for snapping, planarity and normals; None takes val3dity's defaults.

    Returns
    -------
    list of Finding
        Defects by val3dity's code numbers; a file that is no CityJSON gives finding 901 or 904.

    Raises
    ------
    InputError
        When there is no such file, or it cannot be read.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> models = [building.model(truth.cloud.origin) for building in truth.buildings]
    >>> from eaves.formats import write_cityjson
    >>> write_cityjson("nine.city.json", models)
    9
    >>> eaves.validate_file("nine.city.json")
    []
    """
    findings: list[Finding] = []
    try:
        documents = _documents(Path(path), findings)
        head: Any = next(documents, None)
        grid = _read_head(head, Path(path), findings)
        if grid is None:
            return findings
        findings += _check_templates(head, tolerances)
        batch = [head]
        for document in documents:
            batch.append(document)
            if len(batch) == FEATURES_AT_ONCE:
                findings += _check_batch(batch, grid, tolerances)
                batch = []
        return findings + _check_batch(batch, grid, tolerances)
    except OSError as error:
        raise InputError.about(path, f"cannot be read ({error.strerror})", "check the path") from None
    except (ValueError, RecursionError) as error:
        return [*findings, make_finding(901, "", "file", f"it is not JSON: {error}")]


def _read_head(head: Any, path: Path, findings: list[Finding]) -> Grid | None:
    """The grid of a file by its first object, or None with the reason added to the findings."""
    if not isinstance(head, dict) or head.get("type") != "CityJSON":
        reason = 'it does not start with an object of type "CityJSON"'
        findings.append(make_finding(901, "", "file", reason))
        return None
    if str(head.get("version")) not in VERSIONS:
        reason = f"version is {head.get('version')!r}; known are {', '.join(VERSIONS)}"
        findings.append(make_finding(904, "", "file", reason))
        return None
    try:
        return _grid(head, _unit_m(head, path))
    except ValueError as error:
        findings.append(make_finding(901, "", "file", str(error)))
        return None


def _documents(path: Path, findings: list[Finding]) -> Iterator[Any]:
    """The JSON values of a file: one over all its lines, or one a line; repeated keys go to the findings."""

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        document = dict(pairs)
        if len(document) < len(pairs):
            keys: set[str] = set()
            again = next(key for key, _ in pairs if key in keys or keys.add(key))  # type: ignore[func-returns-value]
            findings.append(make_finding(914, "", "file", f"an object has two members {again!r}"))
        return document

    decoder = json.JSONDecoder(object_pairs_hook=unique)
    with path.open(encoding="utf-8-sig") as file:
        first = file.readline()
        count = len(findings)
        try:
            yield decoder.decode(first)
        except json.JSONDecodeError:
            del findings[count:]  # of the piece that was read
            yield decoder.decode(first + file.read())
        for line in file:
            if line.strip():
                yield decoder.decode(line)


def _unit_m(head: dict[str, Any], path: Path) -> Values:
    """Metres a unit of x, y and z; 1 where the file states no system that is known."""
    try:
        return np.array(system_of_head(head, path).unit_m)
    except InputError:
        return np.ones(3)


def _grid(head: dict[str, Any], unit_m: Values) -> Grid:
    """The grid a document's transform states; coordinates as they stand when it has none."""
    transform = head.get("transform")
    if transform is None:
        return Grid(unit_m, np.zeros(3))
    try:
        scale, translate = (np.asarray(transform[key], np.float64) for key in ("scale", "translate"))
    except (KeyError, TypeError, ValueError, OverflowError):
        raise ValueError("its transform lacks scale or translate") from None
    if scale.shape != (3,) or translate.shape != (3,) or not np.isfinite([scale, translate]).all():
        raise ValueError("scale and translate of its transform are not three finite numbers each")
    if (scale <= 0).any():
        raise ValueError("the scale of its transform is not positive")
    scale, translate = scale * unit_m, translate * unit_m
    step = max(float(scale.min()), FINEST_STEP)
    multiples = np.allclose(scale / step, np.rint(scale / step), rtol=0, atol=1e-9)
    return Grid(scale, translate, step if multiples else FINEST_STEP)


PLAIN = Grid(np.ones(3), np.zeros(3))
"""Coordinates in metres, not transformed; they are taken to a hundredth of a millimetre."""


def _check_batch(documents: Iterable[Any], grid: Grid, tolerances: Tolerances | None) -> list[Finding]:
    """Findings of some documents that share a transform."""
    findings: list[Finding] = []
    primitives: list[ReadPrimitive] = []
    vertices: list[Integers] = []
    count = 0
    for document in documents:
        if not isinstance(document, dict) or not isinstance(document.get("CityObjects"), dict):
            findings.append(make_finding(901, "", "file", "a feature is not an object with CityObjects"))
            continue
        try:
            places = grid.places(document.get("vertices", []))
        except ValueError as error:
            findings.append(make_finding(901, str(document.get("id", "")), "vertices", str(error)))
            continue
        for name, item in document["CityObjects"].items():
            for entry in _object_primitives(
                name, item, len(places), count, family_of(name, document["CityObjects"])
            ):
                if isinstance(entry, Finding):
                    findings.append(entry)
                else:
                    primitives.append(entry)
        vertices.append(places)
        count += len(places)
    if not primitives:
        return findings
    return findings + check_primitives(primitives, np.concatenate(vertices), grid.step, tolerances)


def _check_templates(head: dict[str, Any], tolerances: Tolerances | None) -> list[Finding]:
    """Findings of the geometry templates of a document, each checked once."""
    templates = head.get("geometry-templates")
    if templates is None:
        return []
    if not isinstance(templates, dict) or not isinstance(templates.get("templates", []), list):
        return [make_finding(901, "", "geometry-templates", "it is not an object with a list of templates")]
    try:
        places = PLAIN.places(templates.get("vertices-templates", []))
    except ValueError as error:
        return [make_finding(901, "", "geometry-templates", str(error))]
    item = {"geometry": templates.get("templates", [])}
    entries = list(_object_primitives("geometry-templates", item, len(places), 0))
    findings = [entry for entry in entries if isinstance(entry, Finding)]
    primitives = [entry for entry in entries if isinstance(entry, ReadPrimitive)]
    alone = [ReadPrimitive(p.building, f"{k}", p.lod, p.type, p.solids) for k, p in enumerate(primitives)]
    return findings + check_primitives(alone, places, PLAIN.step, tolerances)


def family_of(name: str, objects: dict[str, Any]) -> str:
    """The building that a city object is a part of, or stands on; else the object itself."""
    for _ in objects:
        item = objects.get(name)
        parents = item.get("parents") if isinstance(item, dict) and item.get("type") in OF_BUILDING else None
        if not isinstance(parents, list) or not parents:
            break
        name = str(parents[0])
    return name


def _object_primitives(
    name: str, item: Any, vertex_count: int, first_vertex: int, family: str = ""
) -> Iterator[ReadPrimitive | Finding]:
    """Surfaces and solids of a city object, vertices raised by `first_vertex`; 901 for those ill-formed."""
    if not isinstance(item, dict) or not isinstance(item.get("geometry", []), list):
        yield make_finding(901, name, "object", "it is not an object with a list of geometries")
        return
    for number, geometry in enumerate(item.get("geometry", [])):
        where = f"geometry {number}"
        kind = geometry.get("type") if isinstance(geometry, dict) else None
        if not isinstance(kind, str) or kind not in DEPTHS:
            yield make_finding(901, name, where, f"it is no geometry of CityJSON: its type is {kind!r}")
            continue
        depth, boundaries = DEPTHS[kind], geometry.get("boundaries", [])
        if not _is_nested(boundaries, depth - 1, vertex_count):
            detail = f"its boundaries are no {kind} of existing vertices"
            yield make_finding(901, name, where, detail)
        elif depth > 2:
            shells = _raise(boundaries, first_vertex)
            solids = [[shells]] if depth == 3 else [shells] if depth == 4 else shells
            yield ReadPrimitive(name, family, str(geometry.get("lod", "")), kind, solids)


def _is_nested(value: Any, depth: int, vertex_count: int) -> bool:
    """True if a value is lists `depth` deep of lists of vertex numbers that exist."""
    if not isinstance(value, list):
        return False
    if depth == 0:
        return all(type(number) is int and 0 <= number < vertex_count for number in value)
    return all(_is_nested(item, depth - 1, vertex_count) for item in value)


def _raise(value: Any, first: int) -> Any:
    """Nested lists of numbers, each raised by `first`."""
    if first == 0:
        return value
    return [_raise(item, first) if isinstance(item, list) else item + first for item in value]
