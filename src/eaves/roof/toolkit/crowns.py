"""Points of a building that are of crowns standing over its roof."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from eaves.geometry.neighbours import nearest
from eaves.model import Mask, Points

NEIGHBOURS = 8
"""Points, a point itself with them, that say what it lies on; solid ones that say how high the roof is."""


HIGH = 3.0
"""A storey (m): chimneys and railings, whose edges split pulses too, rise no more over the roof."""


def crown_points(points: Points, not_last: Mask | None) -> Mask:
    """Mask (N,) of the points (N, 3) that are of a crown over the roof.

    A roof lets no pulse through but at its edges. A point is of something that does where most of the points
    around it are `not_last` (N,): echoes of pulses that came back once more from below. It is of a crown
    where the solid points around it in plan lie lower by more than `HIGH`. Glass has no solid roof below and
    stays. Without echoes nothing is a crown.
    """
    crown = np.zeros(len(points), bool)
    if not_last is None or 2 * not_last.sum() <= NEIGHBOURS or len(points) < NEIGHBOURS:
        return crown
    if np.ptp(points[:, 2]) <= HIGH:
        return crown
    around, _ = nearest(points, points, NEIGHBOURS)
    split = not_last[around].mean(axis=1) > 0.5
    loose, solid = np.flatnonzero(split), np.flatnonzero(~split)
    if len(loose) and len(solid) >= NEIGHBOURS:
        below = cKDTree(points[solid, :2]).query(points[loose, :2], NEIGHBOURS)[1]
        crown[loose] = points[loose, 2] - np.median(points[solid[below], 2], axis=1) > HIGH
    return crown
