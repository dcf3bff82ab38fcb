"""The outline stage: contract of an outliner, and the verbs that trace and regularise footprints."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import shapely
from shapely import Polygon

from eaves.geometry.polygons import as_polygon
from eaves.methods import Emit, Method, MethodChoice, emitter, ignore, resolve_method
from eaves.model import Boundary, Failure, Footprint, Mask, Points
from eaves.model.cloud import canonical_order

MIN_POINTS = 4
"""Fewer points have no outline worth the name."""


class OutlineMethod(Method):
    """Draws the outline of a region's points.

    `trace` sees the points (N, 3) of one region in canonical order and their spacing; it answers a Boundary
    with at least one ring, or a Failure. `regularise` sees the boundaries of neighbours together and
    answers one polygon each (holes allowed), or a Failure in its place.
    """

    stage: ClassVar[str] = "outline"

    def trace(self, points: Points, spacing: float, emit: Emit = ignore) -> Boundary | Failure:
        """The boundary of points; see the class."""
        raise NotImplementedError

    def regularise(self, boundaries: list[Boundary], emit: Emit = ignore) -> list[Polygon | Failure]:
        """A polygon for each boundary; see the class."""
        raise NotImplementedError


def trace_outline(
    points: Points,
    spacing: float,
    method: MethodChoice = None,
    *,
    not_last: Mask | None = None,
    debug: str | Path | Emit | None = None,
) -> Boundary | Failure:
    """The boundary of points (N, 3) in local metres; `spacing` is their mean distance in plan (m).

    `not_last` (N,) are the points whose pulses came back once more from below, where the scan says so: they
    tell how wide the beam is, which places points beyond an edge.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> points = truth.cloud.xyz[truth.building == 1]
    >>> boundary = eaves.trace_outline(points, spacing=0.5)
    >>> len(boundary.rings), boundary.rings[0].shape[1]
    (1, 2)
    """
    outliner = resolve_method("outline", method)
    assert isinstance(outliner, OutlineMethod)
    finite = np.isfinite(points).all(axis=1)
    good = points[finite]
    good = good[canonical_order(good)]
    if len(np.unique(good[:, :2], axis=0)) < MIN_POINTS:
        return Failure("too_few_points", f"{len(good)} points have no outline", "outline")
    boundary = outliner.trace(good, spacing, emitter(debug))
    if isinstance(boundary, Failure) or not_last is None:
        return boundary
    return replace(boundary, not_last=points[finite & not_last])


def regularise_outlines(
    boundaries: list[Boundary],
    method: MethodChoice = None,
    *,
    debug: str | Path | Emit | None = None,
) -> list[Footprint | Failure]:
    """One valid footprint, or a Failure, for each boundary; give neighbours that touch together.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> points = truth.cloud.xyz[truth.building == 1]
    >>> footprint = eaves.regularise_outlines([eaves.trace_outline(points, spacing=0.5)])[0]
    >>> true = truth.buildings[0].footprint
    >>> bool(footprint.polygon.symmetric_difference(true).area < 0.1 * true.area)
    True
    """
    outliner = resolve_method("outline", method)
    assert isinstance(outliner, OutlineMethod)
    answers: list[Footprint | Failure] = []
    for polygon in outliner.regularise(boundaries, emitter(debug)):
        if isinstance(polygon, Failure):
            answers.append(polygon)
            continue
        whole = as_polygon(polygon)
        if whole is None:
            answers.append(Failure("no_area", "the outline encloses no area", "outline"))
        else:
            answers.append(Footprint(shapely.orient_polygons(whole)))
    return answers
