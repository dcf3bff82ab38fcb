"""Attributes of a building from its model: heights, areas, slopes, volume, fit, roof type."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely

from eaves.figures.roof_figures import face_shapes, roof_figures, storey_figures
from eaves.geometry.face_table import FaceTable
from eaves.geometry.percentiles import quantile
from eaves.geometry.roof_fit import highest_faces
from eaves.model import ROOF_SURFACE, WALL_SURFACE, BuildingModel, Integers, Mask, Points, Solid, Values

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
