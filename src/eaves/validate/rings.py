"""Rings: enough points, none repeated, simple on the plane of their polygon (codes 101 to 104)."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.model import Mask
from eaves.validate.boundaries import Boundaries

FEWEST_POINTS = 3


def faces_with_short_rings(boundaries: Boundaries) -> Mask:
    """Faces (F,) with a ring of fewer than three points, or with no ring at all: code 101."""
    bad = np.asarray(np.diff(boundaries.faces) == 0)
    short = np.diff(boundaries.rings) < FEWEST_POINTS
    bad[boundaries.face_of_ring[short]] = True
    return bad


def faces_with_repeated_points(boundaries: Boundaries) -> Mask:
    """Faces (F,) with two consecutive points at one place, last and first included: code 102."""
    bad = np.zeros(boundaries.face_count, bool)
    same = boundaries.points == boundaries.points[boundaries.next_point]
    bad[boundaries.face_of_point[same]] = True
    return bad


def is_simple_ring(ring: NDArray[np.float64]) -> bool:
    """Whether a ring of points (M, 2) encloses an area and does not cross or touch itself."""
    return bool(shapely.is_valid(shapely.Polygon(ring)))
