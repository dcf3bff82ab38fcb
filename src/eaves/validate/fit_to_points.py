"""How well a building model fits the points it was made from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from eaves.geometry.roof_fit import RoofFaces, collect_faces, fit_roof, roof_point_mask
from eaves.model import BuildingModel, Points
from eaves.model.building import ROOF_SURFACE

MISSED_RMSE = 1.0
"""What a building without any face under its points counts as (m)."""


@dataclass(frozen=True)
class Fit:
    """Distances (m) of roof points to a model along the faces' normals; those without a face are missed."""

    points: int
    missed: float
    """Share of the roof points with no face under or over them."""
    median: float
    rmse: float
    within_01: float
    within_02: float
    within_05: float


def fit_to_points(model: BuildingModel, points: Points, lod: str | None = None) -> Fit | None:
    """The fit of a model at a level of detail (None: its finest) to building points (N, 3) in local metres.

    Only roof points inside the footprint count (see `roof_point_mask`); None when there is none.
    """
    inside = shapely.contains_xy(model.footprint.polygon, points[:, 0], points[:, 1])
    roof = points[inside & roof_point_mask(points)]
    if len(roof) == 0:
        return None
    distance = np.abs(fit_roof(roof, roof_faces(model, lod or model.lod)).distance)
    hit = np.isfinite(distance)
    if not hit.any():
        return Fit(len(roof), 1.0, float("nan"), MISSED_RMSE, 0.0, 0.0, 0.0)
    near = np.where(hit, distance, np.inf)
    return Fit(
        len(roof),
        float(1.0 - hit.mean()),
        float(np.median(distance[hit])),
        float(np.sqrt(np.mean(distance[hit] ** 2))),
        *(float((near < limit).mean()) for limit in (0.1, 0.2, 0.5)),
    )


def roof_faces(model: BuildingModel, lod: str) -> RoofFaces:
    """The roof faces of a model at a level of detail, all of building 0."""
    faces = [
        [solid.vertices[list(ring)] for ring in face.rings]
        for solid in model.solids.get(lod, ())
        for face in solid.faces
        if face.surface == ROOF_SURFACE
    ]
    return collect_faces(faces, [0] * len(faces))
