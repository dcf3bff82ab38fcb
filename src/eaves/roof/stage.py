"""The roof stage: contract of a roof method, and the function that finds roof planes."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np

from eaves.geometry.neighbours import given_spacing
from eaves.geometry.planes import LocalPlanes
from eaves.methods import (
    Emit,
    Method,
    MethodChoice,
    check_returned,
    emitter,
    ignore,
    naming,
    parameter,
    resolve_method,
)
from eaves.model import PointCloud, Points, RoofPlane
from eaves.model.cloud import canonical_order, plain_points


class RoofMethod(Method):
    """The contract of a roof segmentation method.

    `planes` gets the building's points (N, 3) in canonical order, in local metres near the origin, and a
    random generator seeded by the building; it returns planes with member indices into these points, largest
    first.

    Examples
    --------
    >>> import eaves
    >>> isinstance(eaves.GlobalRefinement(), eaves.RoofMethod)
    True
    """

    stage: ClassVar[str] = "roof"

    min_area: float = parameter(
        0.8, "Area of the smallest plane; never fewer than 5 points.", unit="m2", ge=0.0
    )

    def planes(
        self, points: Points, spacing: float, rng: np.random.Generator, emit: Emit = ignore
    ) -> list[RoofPlane]:
        """The planes of roof points; see the class."""
        raise NotImplementedError

    def fewest_points(self, local: LocalPlanes) -> int:
        """Points of the smallest plane."""
        return max(5, int(self.min_area / local.spacing**2))


def segment_roof(
    points: Points | PointCloud,
    spacing: float | None = None,
    method: MethodChoice = None,
    *,
    rng: np.random.Generator | None = None,
    debug: str | Path | Emit | None = None,
) -> list[RoofPlane]:
    """The roof planes of one building, largest first.

    The method computes about the building's own centre (whole metres), so that no precision is lost far from
    the origin.

    Parameters
    ----------
    points : ndarray (N, 3) or PointCloud
        x, y, z in local metres, in any order; points with NaN coordinates are left out.
    spacing : float or None
        Mean distance (m, > 0) of the points in plan; by default as measured.
    method : RoofMethod, str, mapping or None
        The method, its name, or its parameters; None is `GlobalRefinement()`.
    rng : numpy.random.Generator or None
        Random numbers for methods that draw samples; None is a generator with seed 0.
    debug : str, Path, callable or None
        A folder or a callback `(name, value)` that receives every named intermediate.

    Returns
    -------
    list of RoofPlane
        `members` index the given points; the list is empty for fewer than three points, and where no plane
        is.

    Raises
    ------
    TypeError
        When `points` are no numbers, `spacing` is none, or `method` no roof method.
    ValueError
        When `points` has another shape, `spacing` is not above 0, or no method or parameter has that name.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> points = truth.cloud.xyz[truth.building == 1]
    >>> planes = eaves.segment_roof(points)
    >>> len(planes) == len(truth.buildings[0].faces)
    True
    """
    points = plain_points(points)
    segmenter = resolve_method("roof", method)
    assert isinstance(segmenter, RoofMethod)
    good = np.flatnonzero(np.isfinite(points).all(axis=1))
    if len(good) < 3:
        return []
    good = good[canonical_order(points[good])]
    spacing = given_spacing(spacing, points[good])
    centre = np.floor(points[good].mean(axis=0))
    rng = rng or np.random.default_rng(0)
    with naming(segmenter):
        planes = segmenter.planes(points[good] - centre, spacing, rng, emitter(debug))
    held = isinstance(planes, list) and all(isinstance(plane, RoofPlane) for plane in planes)
    check_returned(segmenter, held, "a list of RoofPlanes", planes)
    for plane in planes:
        members = np.asarray(plane.members)
        held = members.dtype.kind in "iu" and not ((members < 0) | (members >= len(good))).any()
        rule = f"planes whose members are numbers of its {len(good)} points"
        check_returned(segmenter, held, rule, plane.members)
    results = []
    for plane in planes:
        a, b, c = plane.coefficients
        moved = (a, b, float(c + centre[2] - a * centre[0] - b * centre[1]))
        results.append(RoofPlane(moved, np.sort(good[plane.members]), plane.rmse))
    return results
