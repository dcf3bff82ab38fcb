"""Fit of a building model to the points it was made from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from eaves.geometry.face_table import FaceTable
from eaves.geometry.roof_fit import RoofFaces, fit_roof, roof_point_mask
from eaves.model import ROOF_SURFACE, BuildingModel, Points
from eaves.model.checks import as_points, check_type

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
