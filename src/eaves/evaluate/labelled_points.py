"""Points with a number of the roof plane they lie on, as `classified.laz` and a simulated scan have them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
from scipy.spatial import cKDTree

from eaves.evaluate.matching import Numbers
from eaves.formats import InputError
from eaves.geometry.neighbours import measure_spacing
from eaves.model import Points

PLANE_ID = "plane_id"

SAME_POINT = 0.02
"""Points this near (m) are one point of two files."""


@dataclass(frozen=True, eq=False)
class LabelledPoints:
    """World coordinates (N, 3) in the file's units, and plane numbers (N,), 0 for none."""

    xyz: Points
    plane: Numbers


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
    return LabelledPoints(np.asarray(las.xyz, np.float64), np.asarray(las[PLANE_ID], np.int64))


def pair_points(result: LabelledPoints, reference: LabelledPoints) -> tuple[Numbers, Numbers, float]:
    """Plane numbers (N,) of result and reference at the reference's points, and the area (m²) of a point.

    A point the result lacks has no plane there.
    """
    if len(result.xyz) == 0 or len(reference.xyz) == 0:
        return np.zeros(len(reference.xyz), np.int64), reference.plane, 1.0
    origin = reference.xyz.min(axis=0)
    near, which = cKDTree(result.xyz - origin).query(reference.xyz - origin, distance_upper_bound=SAME_POINT)
    found = np.isfinite(near)
    plane = np.zeros(len(reference.xyz), np.int64)
    plane[found] = result.plane[np.asarray(which)[found]]
    roof = reference.xyz[reference.plane > 0] - origin
    return plane, reference.plane, measure_spacing(roof) ** 2
