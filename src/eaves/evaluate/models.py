"""Building models against roof points: distances, faces, levels of detail, validity, volumes.

The definitions are those of `geometry.roof_fit`: roof points are building points inside a footprint that no
other hides from above, each is compared with the highest roof face at its place; distances count along the
face's normal.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from eaves.evaluate.footprint_scores import mean_of, pair_by_overlap
from eaves.evaluate.matching import ratio, root_mean_square
from eaves.formats import CityObject, has_corners, read_cityjson
from eaves.geometry import FaceTable, RoofFaces, fit_roof, polygon_parts, roof_point_mask
from eaves.model import GROUND_SURFACE, LOCAL_METRES, ROOF_SURFACE, CoordinateSystem, Finding, Points, Values
from eaves.model.checks import as_points

FLATTEST = 0.02
"""Upward share of a normal over which a face without a known surface type counts as a roof."""

Rings = list[Points]


@dataclass(frozen=True, eq=False)
class CityBuilding:
    """One building with its parts at one level of detail, in world metres.

    `roofs` and `faces` are the roof faces and all faces; `lod` is the level ("" when there
    is no model); `lods` are all levels the file has of it.
    """

    id: str
    lod: str
    lods: tuple[str, ...]
    roofs: FaceTable
    faces: FaceTable
    footprint: Polygon | MultiPolygon
    system: CoordinateSystem = LOCAL_METRES

    @property
    def volume(self) -> float:
        """Volume (m³) the faces enclose, by the divergence theorem."""
        return self.faces.volume

    @property
    def height(self) -> float:
        """Highest minus lowest vertex (m)."""
        return float(np.ptp(self.faces.corners[:, 2])) if self.faces else 0.0


def read_buildings(path: str | Path, lod: str | None = None) -> list[CityBuilding]:
    """The buildings of a file, each at one level of detail (None: its finest); parts join their building."""
    objects = read_cityjson(path)
    members: dict[str, list[CityObject]] = defaultdict(list)
    for item in objects.values():
        if item.type in ("Building", "BuildingPart"):
            members[item.parents[0] if item.parents else item.id].append(item)
    return [_city_building(name, items, lod) for name, items in members.items()]


def roofs_of(buildings: Sequence[CityBuilding], origin: tuple[float, float]) -> RoofFaces:
    """The roof faces of buildings about an origin; `owner` is the number of the building."""
    table = FaceTable.join([item.roofs for item in buildings]).moved(-np.array([*origin, 0.0]))
    return RoofFaces.of(table, np.repeat(np.arange(len(buildings)), [len(item.roofs) for item in buildings]))


def _city_building(name: str, items: list[CityObject], lod: str | None) -> CityBuilding:
    geometries = [(item, geometry) for item in items for geometry in item.geometries]
    lods = tuple(sorted({geometry.lod for _, geometry in geometries}))
    finest = lod if lod is not None else max((level for level in lods if level >= "1"), default="")
    faces: list[Rings] = []
    is_roof: list[bool] = []
    ground: list[Polygon] = []
    for item, geometry in geometries:
        for face in geometry.faces:
            if not has_corners(face):
                continue
            rings = [item.vertices[list(ring)] for ring in face.rings]
            if geometry.lod == finest:
                faces.append(rings)
                is_roof.append(face.surface == ROOF_SURFACE or (not face.surface and _faces_up(rings)))
            if geometry.lod == "0" or (face.surface == GROUND_SURFACE and geometry.lod == finest):
                ground.append(_shadow(rings))
    plan = ground or [_shadow(rings) for rings, up in zip(faces, is_roof, strict=True) if up]
    footprint = shapely.union_all([shapely.make_valid(shape) for shape in plan], grid_size=0.001)
    if footprint.geom_type not in ("Polygon", "MultiPolygon"):  # damaged faces have lines for a shadow
        footprint = MultiPolygon(polygon_parts(footprint))
    table = FaceTable.of(faces)
    roofs = table.take(np.array(is_roof, bool))
    return CityBuilding(name, finest if faces else "", lods, roofs, table, footprint, items[0].system)


def _shadow(rings: Rings) -> Polygon:
    return Polygon(rings[0][:, :2], [ring[:, :2] for ring in rings[1:]])


def _faces_up(rings: Rings) -> bool:
    return bool(FaceTable.of([rings]).normals[0, 2] > FLATTEST)


WITHIN = (0.1, 0.2, 0.5)
"""Distances (m) within which the share of roof points is reported."""

MISSED_RMSE = 1.0
"""The RMSE (m) of a building without any face under its points, in the mean."""

MOST_SPOTS = 20_000_000
"""Of the grid over a roof face, 5 km² with its usual step: more is damage, and does not fit the memory."""

TRIMMED = 95.0
"""Percentage of a building's nearest points of which the trimmed RMSE is taken."""


@dataclass(frozen=True)
class ModelRow:
    """One footprint: its roof points, how many have no face, their distances (m); its model, if any."""

    footprint: str
    points: int
    missed: float
    rmse_m: float
    rmse95_m: float | None
    rmse_vertical_m: float | None
    model: str | None = None
    lod: str = ""
    faces: int = 0
    volume_m3: float | None = None
    volume_error_m3: float | None = None
    height_error_m: float | None = None


@dataclass(frozen=True, eq=False)
class ModelScore:
    """Scores of models: distances (m) of roof points to their faces, sizes, levels and validity.

    Parameters
    ----------
    buildings, roof_points : int
        Numbers of footprints with points, and of roof points.
    missed : float
        Share of the roof points (0 to 1) with no face under or over them.
    median_m, median_vertical_m : float
        Median distance (m) along the normal, and vertically.
    rmse_mean_m, rmse_median_m : float
        Mean and median (m) of the buildings' RMSE.
    rmse95_mean_m, rmse95_median_m : float
        The same over the nearest 95 % of each building's points.
    within : dict of float to float
        Distance (m) → share of the roof points within it.
    models : int
        Models with a face.
    faces_per_building : float
        Mean number of faces of a model.
    roof_faces, without_model : int
        Number of roof faces, and of buildings without any face.
    lods : dict of str to int
        Level of detail → models.
    findings : dict of int to int
        Code → findings of `validate_file`.
    invalid : int
        Buildings with a finding.
    volume_error : float
        Mean of |volume − reference| / reference over buildings that have both.
    height_error_m : float
        Mean of |height − reference| (m) over buildings that have both.
    rows : tuple of ModelRow
        One a footprint.

    Examples
    --------
    >>> import numpy as np
    >>> from eaves.evaluate import evaluate_models
    >>> evaluate_models([], np.zeros((0, 3)), {}).models
    0
    """

    buildings: int
    roof_points: int
    missed: float
    median_m: float
    median_vertical_m: float
    rmse_mean_m: float
    rmse_median_m: float
    rmse95_mean_m: float
    rmse95_median_m: float
    within: dict[float, float]
    models: int
    faces_per_building: float
    roof_faces: int
    without_model: int
    lods: dict[str, int]
    findings: dict[int, int] = field(default_factory=dict)
    invalid: int = 0
    volume_error: float = float("nan")
    height_error_m: float = float("nan")
    rows: tuple[ModelRow, ...] = ()


def evaluate_models(
    models: Sequence[CityBuilding],
    points: Points,
    footprints: Mapping[str, Polygon | MultiPolygon],
    findings: Sequence[Finding] = (),
    reference: Sequence[CityBuilding] = (),
    masked: bool = True,
) -> ModelScore:
    """Scores of models against building points, by footprint; all in world metres.

    Parameters
    ----------
    models : sequence of CityBuilding
        The models (`eaves.evaluate.models.read_buildings`).
    points : ndarray (N, 3) of float64
        Building points.
    footprints : mapping of str to Polygon or MultiPolygon
        Id → outline; points outside all of them do not count.
    findings : sequence of Finding
        The findings of `validate_file` on the models' file.
    reference : sequence of CityBuilding
        Reference models, for the errors of volume and height; they are matched by footprint.
    masked : bool
        True if hidden points are left out first; not when the points were laid on reference roofs.

    Returns
    -------
    ModelScore
        Measures with nothing to divide by are NaN.

    Raises
    ------
    TypeError
        When `points` is no float64 array.
    ValueError
        When `points` has another shape.

    Examples
    --------
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> models = [building.model(truth.cloud.origin) for building in truth.buildings]
    >>> from eaves.evaluate import evaluate_models
    >>> from eaves.evaluate.models import read_buildings
    >>> from eaves.formats import write_cityjson
    >>> write_cityjson("nine.city.json", models)
    9
    >>> cities = read_buildings("nine.city.json")
    >>> roofs = truth.cloud.xyz[truth.building > 0] + [*truth.cloud.origin, 0.0]
    >>> score = evaluate_models(cities, roofs, {city.id: city.footprint for city in cities})
    >>> bool(score.median_m < 0.03)
    True
    """
    points = as_points(points)
    origin = _origin(points, models)
    local = points - [*origin, 0.0]
    building = _footprint_at(local, footprints, origin)
    use = np.flatnonzero((building >= 0) & (roof_point_mask(local) if masked else True))
    fit = fit_roof(local[use], roofs_of(models, origin))
    distance, vertical = np.abs(fit.distance), np.abs(fit.vertical)
    hit = np.isfinite(distance)
    shapes = np.array(list(footprints.values()), object)
    of_footprint = pair_by_overlap(np.array([model.footprint for model in models], object), shapes)
    truth = pair_by_overlap(np.array([item.footprint for item in reference], object), shapes)
    order = np.argsort(building[use], kind="stable")
    ends = np.searchsorted(building[use][order], np.arange(len(shapes) + 1))
    rows = []
    for number, name in enumerate(footprints):
        members = order[ends[number] : ends[number + 1]]
        row = _row(name, distance[members], vertical[members])
        if number in of_footprint:
            true = reference[truth[number]] if number in truth else None
            row = _with_model(row, models[of_footprint[number]], true)
        rows.append(row)
    measured = [row for row in rows if row.points]
    nearest = [MISSED_RMSE if row.rmse95_m is None else row.rmse95_m for row in measured]
    distances = np.where(hit, distance, np.inf)
    modelled = [model for model in models if model.faces]
    errors = [(row.volume_error_m3, row.volume_m3) for row in rows]
    shares = [
        abs(error) / abs(volume - error)
        for error, volume in errors
        if error is not None and volume is not None and volume != error
    ]
    return ModelScore(
        len(measured),
        len(use),
        ratio(float((~hit).sum()), len(use)),
        _median_or_nan(distance[hit]),
        _median_or_nan(vertical[hit]),
        mean_of([row.rmse_m for row in measured]),
        _median_or_nan(np.array([row.rmse_m for row in measured])),
        mean_of(nearest),
        _median_or_nan(np.array(nearest)),
        {limit: ratio(float((distances < limit).sum()), len(use)) for limit in WITHIN},
        len(modelled),
        ratio(sum(len(model.faces) for model in modelled), len(modelled)),
        sum(len(model.roofs) for model in models),
        len(models) - len(modelled),
        dict(sorted(Counter(model.lod for model in modelled).items())),
        dict(sorted(Counter(finding.code for finding in findings).items())),
        len({finding.building for finding in findings}),
        mean_of(shares),
        mean_of([abs(row.height_error_m) for row in rows if row.height_error_m is not None]),
        tuple(rows),
    )


def lay_points(buildings: Sequence[CityBuilding], step: float = 0.5) -> Points:
    """Points (N, 3) on a grid of `step` metres on the highest roof faces of reference models."""
    origin = _origin(np.zeros((0, 3)), buildings)
    faces = roofs_of(buildings, origin)
    spots = [np.zeros((0, 2))]
    for shape in faces.polygons:
        west, south, east, north = np.round(np.array(shape.bounds) / step)
        if (east - west + 1) * (north - south + 1) > MOST_SPOTS:
            spans = f"{(east - west) * step:.0f} × {(north - south) * step:.0f} m"
            raise ValueError(f"a roof face spans {spans}, more than any roof; check the models' coordinates")
        x, y = np.meshgrid(
            (np.arange(west, east + 1) + 0.5) * step, (np.arange(south, north + 1) + 0.5) * step
        )
        inside = shapely.contains_xy(shape, x.ravel(), y.ravel())
        spots.append(np.stack([x.ravel()[inside], y.ravel()[inside]], axis=1))
    flat = np.unique(np.concatenate(spots), axis=0)
    over = fit_roof(np.column_stack([flat, np.zeros(len(flat))]), faces)
    return np.column_stack([flat + origin, -over.vertical])[over.face >= 0]


def _row(name: str, distance: Values, vertical: Values) -> ModelRow:
    hit = np.isfinite(distance)
    if not hit.any():
        return ModelRow(name, len(distance), 1.0 if len(distance) else 0.0, MISSED_RMSE, None, None)
    nearest = np.sort(distance[hit])[: max(1, int(np.ceil(hit.sum() * TRIMMED / 100.0)))]
    return ModelRow(
        name,
        len(distance),
        float(1.0 - hit.mean()),
        root_mean_square(distance[hit]),
        root_mean_square(nearest),
        root_mean_square(vertical[hit]),
    )


def _with_model(row: ModelRow, model: CityBuilding, truth: CityBuilding | None) -> ModelRow:
    has_faces = bool(model.faces)
    return replace(
        row,
        model=model.id,
        lod=model.lod,
        faces=len(model.faces),
        volume_m3=model.volume if has_faces else None,
        volume_error_m3=model.volume - truth.volume if truth and has_faces else None,
        height_error_m=model.height - truth.height if truth and has_faces else None,
    )


def _footprint_at(
    local: Points, footprints: Mapping[str, Polygon | MultiPolygon], origin: tuple[float, float]
) -> np.ndarray:
    """The number (N,) of the footprint each point lies in, -1 for none; of several the last."""
    inside = np.full(len(local), -1)
    shapes = shapely.transform(np.array(list(footprints.values()), object), lambda xy: xy - np.array(origin))
    if len(local) and len(shapes):
        number, point = shapely.STRtree(shapely.points(local[:, :2])).query(shapes, predicate="contains")
        inside[point] = number
    return inside


def _origin(points: Points, buildings: Sequence[CityBuilding]) -> tuple[float, float]:
    """Whole metres near the data, for sums and products to keep their digits."""
    if len(points):
        x, y = np.floor(points[:, :2].min(axis=0))
        return float(x), float(y)
    corners = [item.roofs.corners[:, :2].min(axis=0) for item in buildings if item.roofs]
    x, y = np.floor(np.min(corners, axis=0)) if corners else (0.0, 0.0)
    return float(x), float(y)


def _median_or_nan(values: Values) -> float:
    return float(np.median(values)) if len(values) else float("nan")
