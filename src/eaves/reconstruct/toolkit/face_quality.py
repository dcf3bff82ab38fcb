"""How well its points support each roof face, and what a user should look at."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.model import Values

NEAR_M = 0.2
"""A point this near (m) to its face lies on it: six times the noise of a common scan."""

WORST_RMSE_M = 1.0
"""A face whose points scatter by more (m) is no surface they show."""

LEAST_INLIERS = 0.5
"""Share of a face's points that must lie on it."""

FEWEST = 3
"""Fewer points do not support a face."""


def grade_faces(records: list[dict[str, Any]], error: Values, face: NDArray[np.int64]) -> None:
    """Adds to the record of each roof face its inlier share, density, coverage, and in words why it is weak.

    `error` (N,; m) are the distances of roof points, `face` (N,) the number of the face under each. The
    records know `points`, `rmse_m`, `share_no_data` and `no_data`.
    """
    inside = np.abs(error) <= NEAR_M
    near = np.bincount(face[inside & (face >= 0)], minlength=len(records))
    for number, record in enumerate(records):
        points = record["points"]
        record["inlier_share"] = float(near[number] / points) if points else None
        record["density"] = points / record["projected_m2"] if record["projected_m2"] > 0.0 else None
        record["coverage"] = 1.0 - record["share_no_data"]
        record["weak"] = weakness(record)


def weakness(record: dict[str, Any]) -> str | None:
    """Why a face is not supported by its points; None where it is."""
    if record["points"] < FEWEST:
        return f"{record['points']} points"
    if record["rmse_m"] > WORST_RMSE_M or record["inlier_share"] < LEAST_INLIERS:
        return f"{record['inlier_share']:.0%} of its points within {NEAR_M} m, RMSE {record['rmse_m']:.2f} m"
    if record["no_data"]:
        return f"{record['share_no_data']:.0%} of its plan without points"
    return None


def supported_share(records: list[dict[str, Any]]) -> float | None:
    """Share of the roof's plan under faces that their points support."""
    plan = sum(record["projected_m2"] for record in records)
    good = sum(record["projected_m2"] for record in records if record["weak"] is None)
    return good / plan if plan > 0.0 else None
