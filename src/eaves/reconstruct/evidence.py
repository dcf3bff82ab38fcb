"""Which points speak for the roof, and from how high the roof is seen."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from shapely import Polygon

from eaves.model import Mask, Points

TOP_RADIUS, TOP_DEPTH = 0.3, 0.6
"""A roof point has no other point more than 0.6 m above it within 0.3 m in plan (methods.md, section 8)."""

PRISM_PERCENTILE = 70.0
"""Height of a flat-topped model: percentile of the roof points, as the 3DBAG publishes it."""

FEWEST_POINTS = 3
"""Fewer roof points than this say nothing about a roof."""

LOWEST_ROOF = 0.5
"""A roof is at least this high (m) above the base: nothing is built lower, and solids keep a wall."""


def is_roof_point(points: Points) -> Mask:
    """Which points (N, 3) are the highest around: walls, balconies and what lies under eaves drop out."""
    if len(points) == 0:
        return np.zeros(0, bool)
    top = points[:, 2].copy()
    pairs = cKDTree(points[:, :2]).query_pairs(TOP_RADIUS, output_type="ndarray")
    np.maximum.at(top, pairs[:, 0], points[pairs[:, 1], 2])
    np.maximum.at(top, pairs[:, 1], points[pairs[:, 0], 2])
    return np.asarray(top - points[:, 2] <= TOP_DEPTH)


def points_inside(points: Points, polygon: Polygon) -> NDArray[np.int64]:
    """Numbers of the finite points (N, 3) inside a polygon."""
    shapely.prepare(polygon)
    inside = shapely.contains_xy(polygon, points[:, 0], points[:, 1])
    return np.flatnonzero(inside & np.isfinite(points).all(axis=1))
