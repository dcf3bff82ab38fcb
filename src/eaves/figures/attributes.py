"""Attributes of a building from its model: heights, areas, slopes, volume, fit, roof type."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from shapely import Polygon

from eaves.geometry.face_table import FaceTable, highest_faces
from eaves.geometry.planes import quantile
from eaves.model import ROOF_SURFACE, WALL_SURFACE, BuildingModel, Integers, Mask, Points, Solid, Values

MAIN_SHARE = 0.9
"""The largest faces that cover so much of the plan are the main ones: dormers and chimneys decide nothing.
Nor is what has no more than the rest of the pitched plan a side of the roof. The smallest side of a pyramid
has this share of the largest's plan."""

LEVEL_SLOPE_DEG = 6.0
"""Faces flatter than this are flat: drainage falls reach 5 degrees."""

ANNEX_SHARE = 0.6
"""Main faces that end below this share of the height that half of the main plan reaches are an annex's and
have eaves of their own."""

DECIDING_SHARE = 0.75
"""A roof is flat, or pitched, when this share of its main plan is."""

OPPOSITE_DEG = 20.0
"""Azimuths this near are one side of a roof; this near to opposite they face each other across a ridge."""

ONE_SLOPE_DEG = 10.0
"""Slopes of one side that differ by more break it, as those of a mansard: no pyramid."""

NARROWEST_M = 0.5
"""Faces narrower than this are parapets: no main faces."""

LONG_M = 1.5
"""A level edge this long is a ridge; chimneys are shorter. A face that alone, and without a ridge there,
rises more over all others runs on under a chimney."""

LEVEL_M = 0.15
"""The ends of a level edge differ by no more in height."""

STOREY_M = 2.9
"""Height of a storey with its floor, from floor to floor (m), as dwellings in Europe have it."""

HEADROOM_M = 1.5
"""Clear height (m) from which a floor counts, as under the slopes of an attic (NEN 2580, DIN 277)."""

FULL_M, FULL_SHARE = 2.0, 0.75
"""Clear height (m) that a full storey has, and over what share of the floor. Building codes ask 2.3 m;
storeys lower than `STOREY_M` put a second floor of 2.6 m by so much too high."""

CODES = {"flat": "1000", "shed": "1010", "gable": "1030", "hip": "1040", "pyramid": "1070", "complex": "1130"}
"""The roof types in the code list of CityGML's `roofType` (SIG3D)."""

QUARTERS = ("n", "e", "s", "w")
"""The quarters of the compass that roof faces look to."""

Record = dict[str, Any]


@dataclass(frozen=True, eq=False)
class FaceShape:
    """A roof face in plan, and the height (m) of its highest long level edge, None without one."""

    plan: Polygon
    level_top: float | None

    @property
    def width(self) -> float:
        """Twice its area over its perimeter (m): the width of a long strip."""
        return float(2.0 * self.plan.area / self.plan.length) if self.plan.length > 0.0 else 0.0


def face_shapes(faces: FaceTable) -> list[FaceShape]:
    """The shapes of roof faces, in order."""
    start, end = faces.corners, faces.corners[faces.following]
    x, y, z = (end - start).T
    level = (np.hypot(x, y) >= LONG_M) & (np.abs(z) <= LEVEL_M)
    tops = np.full(len(faces), -np.inf)
    np.maximum.at(tops, faces.face_of_corner[level], (start[level, 2] + end[level, 2]) / 2.0)
    pairs = zip(faces.polygons(), tops.tolist(), strict=True)
    return [FaceShape(plan, top if np.isfinite(top) else None) for plan, top in pairs]


def roof_figures(
    faces: list[Record],
    ground: float,
    shapes: Sequence[FaceShape] | None = None,
) -> Record:
    """Attributes from the records of the roof faces, and their shapes in plan; `ground` (m) is the base of
    the building.

    Heights are those of the roof's own surface; the eaves are the lowest, the ridge the highest edge of the
    main faces, annexes left out: area decides which are.
    """
    if not faces:
        return {"roof_type": "flat", "h_eaves": None, "h_ridge": None, "h_max": None}
    if shapes is not None:
        faces = [{**face, "shape": shape} for face, shape in zip(faces, shapes, strict=True)]
    main = main_faces(faces)
    kind = roof_type(faces)
    ridge, top = ridge_height(main), max(face["h_high"] for face in faces)
    by_top = sorted(main, key=lambda face: face["h_high"])
    below = np.cumsum([face["projected_m2"] for face in by_top])
    half = by_top[int(np.searchsorted(below, below[-1] / 2.0))]["h_high"] - ground
    eaves = min(face["h_low"] for face in main if face["h_high"] - ground >= min(half, ANNEX_SHARE * half))
    plan = sum(face["projected_m2"] for face in faces)
    pitched = [face for face in main if face["slope_deg"] >= LEVEL_SLOPE_DEG]
    level = sum(face["projected_m2"] for face in faces if face["slope_deg"] < LEVEL_SLOPE_DEG)
    figures: Record = {
        "roof_type": kind,
        "roofType": CODES[kind],
        "roof_share_flat": round(level / plan, 3) if plan > 0.0 else None,
        "roof_share_pitched": round(1.0 - level / plan, 3) if plan > 0.0 else None,
        "h_eaves": eaves,
        "h_ridge": max(ridge, eaves),
        "h_max": top,
        "measuredHeight": top - ground,
        "ridge_direction_deg": ridge_direction(pitched),
        "roof_slope_deg": mean_slope(pitched),
    }
    areas = dict.fromkeys(("flat", *QUARTERS), 0.0)
    for face in faces:
        side = "flat" if face["slope_deg"] < LEVEL_SLOPE_DEG else quarter_of(face["azimuth_deg"])
        areas[side] += face["area_m2"]
    return figures | {f"roof_area_{side}_m2": area for side, area in areas.items()}


def storey_figures(solids: FaceTable, ground: float) -> Record:
    """Storeys and gross floor area (m²) of closed solids on a base (m), an estimate: sections of the
    solids over floors `STOREY_M` apart.

    A floor is the section `HEADROOM_M` over it: an attic counts where a person can stand, a lean-to with its
    own storeys, a passage with none. A storey is full, and counted, when it is `FULL_M` high over
    `FULL_SHARE` of the largest floor.
    """
    top = float(solids.corners[:, 2].max()) - ground
    upper = np.arange(STOREY_M, top, STOREY_M).tolist()
    floors = [solids.section_area(ground + floor + HEADROOM_M) for floor in upper]
    floors.append(solids.section_area(ground + min(HEADROOM_M, 0.5 * top)))
    least = FULL_SHARE * max(floors)
    full = [solids.section_area(ground + floor + FULL_M) >= least for floor in upper]
    return {
        "storeysAboveGround": 1 + sum(full),
        "storeys_source": f"{FULL_M} m clear over floors {STOREY_M} m apart",
        "floor_area_m2": sum(floors),
    }


def ridge_height(main: list[Record]) -> float:
    """The highest place (m) of the main faces: of a ridge, or where two of them meet; a face that runs on
    under a chimney does not raise it.
    """
    tops = sorted((face["h_high"] for face in main), reverse=True)
    if len(tops) == 1 or tops[0] - tops[1] > LONG_M:
        return float(tops[0])
    levels = [face["shape"].level_top for face in main if face.get("shape") is not None]
    if not levels:
        return float(tops[0])
    return float(max([tops[1], *(level for level in levels if level is not None)]))


def main_faces(faces: list[Record]) -> list[Record]:
    """The largest faces in plan that together cover `MAIN_SHARE` of it, parapets left out."""
    wide = [face for face in faces if face.get("shape") is None or face["shape"].width >= NARROWEST_M]
    order = sorted(wide or faces, key=lambda face: -face["projected_m2"])
    plan = np.cumsum([face["projected_m2"] for face in order])
    return order[: int(np.searchsorted(plan, MAIN_SHARE * plan[-1])) + 1]


def roof_type(faces: list[Record]) -> str:
    """flat, shed, gable, hip, pyramid or complex, judged over the whole plan of the main faces."""
    main = main_faces(faces)
    plan = sum(face["projected_m2"] for face in main)
    pitched = [face for face in main if face["slope_deg"] >= LEVEL_SLOPE_DEG]
    share = sum(face["projected_m2"] for face in pitched) / plan if plan > 0.0 else 0.0
    if share <= 1.0 - DECIDING_SHARE:
        return "flat"
    if share < DECIDING_SHARE:
        return "complex"
    sides = sides_of(pitched)
    azimuths = np.sort(np.array([azimuth for azimuth, _ in sides]))
    if len(sides) == 1:
        return "shed"
    if len(sides) == 2 and abs(azimuths[1] - azimuths[0] - 180.0) <= OPPOSITE_DEG:
        return "gable"
    quarter = np.diff(np.append(azimuths, azimuths[0] + 360.0))
    if len(sides) == 4 and np.all(np.abs(quarter - 90.0) <= OPPOSITE_DEG):
        if not fills_rectangle(pitched):
            return "complex"
        areas = sorted(area for _, area in sides)
        return "pyramid" if areas[0] > MAIN_SHARE * areas[-1] and not is_broken(pitched) else "hip"
    return "complex"


def fills_rectangle(pitched: list[Record]) -> bool:
    """True if pitched faces fill the rectangle around them: two gables that cross have four sides, too."""
    plans = [face["shape"].plan.buffer(0.0) for face in pitched if face.get("shape") is not None]
    if not plans:
        return True
    union = shapely.union_all(plans)
    return bool(union.area >= MAIN_SHARE * shapely.minimum_rotated_rectangle(union).area)


def is_broken(pitched: list[Record]) -> bool:
    """True if the sides have several slopes."""
    slopes = [face["slope_deg"] for face in pitched]
    return bool(max(slopes) - min(slopes) > ONE_SLOPE_DEG)


def sides_of(pitched: list[Record]) -> list[tuple[float, float]]:
    """Azimuth (degrees) and plan (m²) of the sides of a roof: faces that look the same way are one."""
    remaining = sorted(pitched, key=lambda face: -face["projected_m2"])
    total = sum(face["projected_m2"] for face in remaining)
    sides = []
    while remaining:
        azimuth = remaining[0]["azimuth_deg"]
        apart = [abs((face["azimuth_deg"] - azimuth + 180.0) % 360.0 - 180.0) for face in remaining]
        side = [face for face, away in zip(remaining, apart, strict=True) if away <= OPPOSITE_DEG]
        remaining = [face for face, away in zip(remaining, apart, strict=True) if away > OPPOSITE_DEG]
        area = sum(face["projected_m2"] for face in side)
        if area > (1.0 - MAIN_SHARE) * total:
            sides.append((float(azimuth), float(area)))
    return sides


def ridge_direction(pitched: list[Record]) -> float | None:
    """Direction of the ridges, 0 to 180 degrees clockwise from grid north: upright on the falls, whose
    doubled angles are averaged by plan; None for a flat roof.
    """
    if not pitched:
        return None
    doubled = 2.0 * np.radians([face["azimuth_deg"] for face in pitched])
    weight = np.array([face["projected_m2"] for face in pitched])
    mean = 0.5 * np.arctan2((weight * np.sin(doubled)).sum(), (weight * np.cos(doubled)).sum())
    return round(float((np.degrees(mean) + 90.0) % 180.0), 1)


def mean_slope(pitched: list[Record]) -> float | None:
    """Mean slope (degrees) of the pitched faces, by plan; None for a flat roof."""
    if not pitched:
        return None
    weight = [face["projected_m2"] for face in pitched]
    return round(float(np.average([face["slope_deg"] for face in pitched], weights=weight)), 1)


def quarter_of(azimuth: float) -> str:
    """The quarter of the compass an azimuth (degrees) lies in: north is 315 to 45."""
    return QUARTERS[int(((azimuth + 45.0) % 360.0) // 90.0)]


NEAR_M = 0.2
"""A point this near (m) to its face lies on it: six times the noise of a common scan."""

LEAST_SHOWN = 0.5
"""Share of a face's points that must lie on it, and of its plan that must have points."""

FEWEST_POINTS = 3
"""Fewer points support no face and say nothing of a roof."""


def grade_faces(records: list[dict[str, Any]], error: Values, face: Integers) -> None:
    """Adds to the record of each roof face its inlier share, density, coverage, and in words why it is weak.

    `error` (N,; m) are the distances of roof points, `face` (N,) the number of the face under each. The
    records know `points`, `rmse_m`, `share_no_data` and `no_data`.
    """
    inside = np.abs(error) <= NEAR_M
    inliers = np.bincount(face[inside & (face >= 0)], minlength=len(records))
    for number, record in enumerate(records):
        points = record["points"]
        record["inlier_share"] = float(inliers[number] / points) if points else None
        record["density"] = points / record["projected_m2"] if record["projected_m2"] > 0.0 else None
        record["coverage"] = 1.0 - record["share_no_data"]
        record["weak"] = weakness(record)


def weakness(record: dict[str, Any]) -> str | None:
    """Why a face is not supported by its points; None where it is."""
    if record["points"] < FEWEST_POINTS:
        return f"{record['points']} points"
    if record["inlier_share"] < LEAST_SHOWN:
        return f"{record['inlier_share']:.0%} of its points within {NEAR_M} m"
    if record["no_data"]:
        return f"{record['share_no_data']:.0%} of its plan without points"
    return None


def supported_share(records: list[dict[str, Any]]) -> float | None:
    """Share of the roof's plan under faces that their points support."""
    plan = sum(record["projected_m2"] for record in records)
    good = sum(record["projected_m2"] for record in records if record["weak"] is None)
    return good / plan if plan > 0.0 else None


EMPTY_CELL = 1.0
"""Side of the cells (m) in which the share of roof without points is counted."""

OWN_SURFACE = 1.0
"""Points further (m) from the roof hang over it or lie under it: they say nothing of its heights."""

STRAY_M = 100.0
"""What lies further (m) from the roof was not measured on the building: a bird, a cloud, a broken echo."""

TRIMMED_SHARE = 0.95
"""Share of the best-fitting points the trimmed RMSE is computed from."""

Surface = tuple[Values, Values, Integers]
"""Height of a model over places (N,), cosine of its slope there, number of the roof face."""


def measure_volume(solid: Solid) -> float:
    """Volume (m³) of a closed solid."""
    return FaceTable.of_solids([solid]).volume


def surface_heights(solids: tuple[Solid, ...], xy: Values) -> Surface:
    """Height of the model over places (N, 2), cosine of the slope there, and number of the roof face.

    Roof faces are counted through all solids; where there is none the height is NaN and the number -1.
    """
    faces = FaceTable.of_solids(solids, ROOF_SURFACE)
    sloped = np.flatnonzero(~np.isnan(faces.planes[:, 0]))
    if len(sloped) < len(faces):
        faces = faces.take(~np.isnan(faces.planes[:, 0]))
    places = faces.corners[:, :2]
    face, height = highest_faces(xy, places, places[faces.following], faces.face_of_corner, faces.planes)
    a, b, _ = faces.planes.T
    cosine = np.append(1.0 / np.sqrt(a * a + b * b + 1.0), 1.0)
    return height, cosine[face], np.append(sloped, -1)[face]


def describe_roof(
    model: BuildingModel, points: Points, roof: Points, ground: float, surface: Surface | None = None
) -> dict[str, Any]:
    """The attributes of a model: `points` (N, 3) are the building's inside the footprint, `roof` (R, 3)
    its roof points, `surface` the model over them where it is known.
    """
    solids = model.solids[model.lod]
    facts = describe_solids(model, ground)
    roof_faces = facts["roof_faces"]
    height, cosine, number = surface or surface_heights(solids, roof[:, :2])
    error = np.where(np.isfinite(height), (roof[:, 2] - height) * cosine, 0.0)
    for face, record in enumerate(roof_faces):
        errors = error[(number == face) & (np.abs(error) <= STRAY_M)]
        record["points"] = len(errors)
        record["rmse_m"] = float(np.sqrt(np.mean(errors**2))) if len(errors) else None
    centres, empty = empty_cells(points, model)
    mark_unknown(roof_faces, surface_heights(solids, centres)[2], empty)
    grade_faces(roof_faces, error, number)
    fitting = roof[np.abs(error) <= OWN_SURFACE]
    own = np.abs(error) <= STRAY_M
    squared = np.sort(error[own if own.any() else ...] ** 2)
    trimmed = squared[: max(1, int(TRIMMED_SHARE * len(squared)))]
    heights = (fitting if len(fitting) else roof)[:, 2]
    return {
        **facts,
        "h_50p": quantile(heights, 0.5),
        "h_70p": quantile(heights, 0.7),
        "rmse_m": float(np.sqrt(squared.mean())),
        "rmse95_m": float(np.sqrt(trimmed.mean())),
        "inlier_share": float(np.mean(np.abs(error) <= NEAR_M)),
        "points": len(points),
        "density": len(points) / float(model.footprint.polygon.area),
        "share_no_data": float(empty.mean()) if len(empty) else float(len(points) == 0),
        "supported_share": supported_share(roof_faces),
    }


def describe_solids(model: BuildingModel, ground: float) -> dict[str, Any]:
    """Attributes from the solids of a model's finest level alone, with a record for each roof face."""
    solids = model.solids[model.lod]
    faces = FaceTable.of_solids(solids)
    surface = np.concatenate([solid.surfaces for solid in solids])
    roofs = faces.take(surface == ROOF_SURFACE)
    roof_faces = describe_faces(roofs)
    return {
        **roof_figures(roof_faces, ground, face_shapes(roofs)),
        **storey_figures(faces, ground),
        "h_ground": ground,
        "volume_m3": faces.volume,
        "wall_area_m2": float(faces.areas[surface == WALL_SURFACE].sum()),
        "roof_area_m2": float(sum(face["area_m2"] for face in roof_faces)),
        "roof_projected_m2": float(sum(face["projected_m2"] for face in roof_faces)),
        "roof_face_count": len(roof_faces),
        "roof_faces": roof_faces,
    }


SIZES = ("volume_", "wall_area_", "roof_area_", "roof_projected_", "roof_face", "floor_area_", "storeys")
"""Prefixes of the names of attributes that are sizes of the finest level's solids."""


def measure_again(model: BuildingModel) -> BuildingModel:
    """The model with the sizes of its finest level in place of those of another; type, heights and slopes of
    the roof stay what the points show."""
    earlier = model.attributes
    facts = describe_solids(model, earlier["h_ground"])
    sizes = {name: value for name, value in facts.items() if name.startswith(SIZES)}
    # the same faces, with what their points say
    if earlier.get("roof_face_count") == facts["roof_face_count"]:
        del sizes["roof_faces"]
    return model.with_(attributes={**earlier, **sizes})


def describe_faces(faces: FaceTable) -> list[dict[str, Any]]:
    """One record for each roof face, in order."""
    low, high = faces.heights
    columns = {
        "slope_deg": faces.slopes_deg,
        "azimuth_deg": faces.azimuths_deg,
        "area_m2": faces.areas,
        "projected_m2": faces.vectors[:, 2],
        "h_low": low,
        "h_high": high,
    }
    records = [dict(zip(columns, row, strict=True)) for row in np.column_stack([*columns.values()]).tolist()]
    for record in records:
        if np.isnan(record["azimuth_deg"]):
            record["azimuth_deg"] = None
    return records


def empty_cells(points: Points, model: BuildingModel) -> tuple[Values, Mask]:
    """The centres (C, 2) of the footprint's 1 m cells, and which of them (C,) no point (N, 3) falls in."""
    west, south, east, north = model.footprint.polygon.bounds
    columns, rows = int((east - west) / EMPTY_CELL) + 1, int((north - south) / EMPTY_CELL) + 1
    column, row = np.meshgrid(np.arange(columns), np.arange(rows))
    x, y = west + (column.ravel() + 0.5) * EMPTY_CELL, south + (row.ravel() + 0.5) * EMPTY_CELL
    inside = shapely.contains_xy(model.footprint.polygon, x, y)
    of_point = ((points[:, 1] - south) / EMPTY_CELL).astype(np.int64) * columns
    of_point += ((points[:, 0] - west) / EMPTY_CELL).astype(np.int64)
    filled = np.bincount(of_point, minlength=columns * rows)[: columns * rows] > 0
    return np.column_stack([x, y])[inside], ~filled[inside]


def mark_unknown(roof_faces: list[dict[str, Any]], face: Integers, empty: Mask) -> None:
    """Adds to the record of each roof face which share of it has no data, and whether most of it has none.

    `face` (C,) is the face over each cell, `empty` (C,) whether a point fell in it; a face that covers the
    centre of no cell has data when it has points.
    """
    for number, record in enumerate(roof_faces):
        cells = empty[face == number]
        share = float(cells.mean()) if len(cells) else float(record["points"] == 0)
        record["share_no_data"] = share
        record["no_data"] = share > 1.0 - LEAST_SHOWN
