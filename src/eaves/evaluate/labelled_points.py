"""Points with a number of the roof plane they lie on, as `classified.laz` and a simulated scan have them."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
from scipy.spatial import cKDTree

from eaves.evaluate.matching import Numbers
from eaves.formats import InputError
from eaves.geometry.neighbours import measure_spacing
from eaves.model import Mask, Points

PLANE_ID = "plane_id"

SAME_POINT = 0.02
"""Points this near (m) are one point of two files."""


LabelledPoints = tuple[Points, Numbers]
"""World coordinates (N, 3) in the file's units, and plane numbers (N,), 0 for none."""


def read_labelled_points(path: Path) -> LabelledPoints:
    """The points of a LAS or LAZ file with the extra dimension `plane_id`."""
    try:
        las = laspy.read(path)
    except (OSError, ValueError, laspy.errors.LaspyException) as error:
        raise InputError.about(path, f"cannot be read ({error})", "give LAS or LAZ") from None
    if PLANE_ID not in set(las.point_format.extra_dimension_names):
        raise InputError.about(
            path, f"has no dimension '{PLANE_ID}'", "give classified.laz of a run, or a simulated scan"
        )
    return np.asarray(las.xyz, np.float64), np.asarray(las[PLANE_ID], np.int64)


def pair_points(result: LabelledPoints, reference: LabelledPoints) -> tuple[Numbers, Numbers, float]:
    """Plane numbers (N,) of result and reference at the reference's points, and the area (m²) of a point.

    A point the result lacks has no plane there.
    """
    (xyz, planes), (places, true) = result, reference
    found, partner = match_points(xyz, places)
    plane = np.zeros(len(places), np.int64)
    plane[found] = planes[partner]
    return plane, true, measure_spacing(places[true > 0] - places[:1]) ** 2


def match_points(result: Points, reference: Points) -> tuple[Mask, Numbers]:
    """Mask (N,) of the points of a reference (N, 3) in a result (M, 3), and the number (K,) of each in the
    result."""
    if len(result) == 0 or len(reference) == 0:
        return np.zeros(len(reference), bool), np.zeros(0, np.int64)
    origin = reference.min(axis=0)
    away, which = cKDTree(result - origin).query(reference - origin, distance_upper_bound=SAME_POINT)
    found = np.isfinite(away)
    return found, np.asarray(which)[found]
