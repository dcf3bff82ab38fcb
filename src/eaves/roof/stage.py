"""The roof stage: contract of a segmenter, and the verb that finds roof planes with one."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np

from eaves.methods import Emit, Method, MethodChoice, emitter, ignore, resolve_method
from eaves.model import Points, RoofPlane
from eaves.model.cloud import canonical_order


class RoofMethod(Method):
    """Finds the planes of one roof.

    `planes` sees the building's points (N, 3) in canonical order, in local metres near the origin, and random
    numbers of the building's own; it answers planes with member indices into these points, largest first.
    """

    stage: ClassVar[str] = "roof"

    def planes(
        self, points: Points, spacing: float, rng: np.random.Generator, emit: Emit = ignore
    ) -> list[RoofPlane]:
        """The planes of roof points; see the class."""
        raise NotImplementedError


def segment_roof(
    points: Points,
    spacing: float,
    method: MethodChoice = None,
    *,
    rng: np.random.Generator | None = None,
    debug: str | Path | Emit | None = None,
) -> list[RoofPlane]:
    """The roof planes of one building, largest first; `members` index the given points (N, 3), in any order.

    The method works about the building's own centre (whole metres): no precision is lost far from the origin.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> points = truth.cloud.xyz[truth.building == 1]
    >>> planes = eaves.segment_roof(points, spacing=0.5)
    >>> len(planes) == len(truth.buildings[0].faces)
    True
    """
    segmenter = resolve_method("roof", method)
    assert isinstance(segmenter, RoofMethod)
    good = np.flatnonzero(np.isfinite(points).all(axis=1))
    if len(good) < 3:
        return []
    good = good[canonical_order(points[good])]
    centre = np.floor(points[good].mean(axis=0))
    found = segmenter.planes(points[good] - centre, spacing, rng or np.random.default_rng(0), emitter(debug))
    answers = []
    for plane in found:
        a, b, c = plane.coefficients
        moved = (a, b, float(c + centre[2] - a * centre[0] - b * centre[1]))
        answers.append(RoofPlane(moved, np.sort(good[plane.members]), plane.rmse))
    return answers
