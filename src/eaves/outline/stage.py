"""The outline stage: contract of an outline method, and the functions that trace and regularise outlines."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import ClassVar, overload

import numpy as np
import shapely
from shapely import Polygon

from eaves.geometry.neighbours import given_spacing
from eaves.geometry.rings import as_polygon
from eaves.methods import (
    Emit,
    Method,
    MethodChoice,
    check_returned,
    emitter,
    ignore,
    naming,
    resolve_method,
)
from eaves.model import Boundary, Failure, Footprint, Labels, Mask, PointCloud, Points
from eaves.model.checks import check_type
from eaves.model.cloud import canonical_order, plain_points

MIN_POINTS = 4
"""Fewer points tell nothing of an outline or of one of its edges; whether there are is first seen of some."""
SOME_POINTS = 16 * MIN_POINTS


class OutlineMethod(Method):
    """The contract of an outline method.

    `trace` gets the points (N, 3) of one region in canonical order and their spacing (m); it returns a
    Boundary with at least one ring, or a Failure. Which points have an outline of their own `parts` says
    before. `regularise` gets the boundaries of neighbours together and returns for each one polygon (holes
    allowed), or a Failure in its place.

    Examples
    --------
    >>> import eaves
    >>> isinstance(eaves.GlobalFit(), eaves.OutlineMethod)
    True
    """

    stage: ClassVar[str] = "outline"

    def parts(self, points: Points, spacing: float) -> Labels:
        """Numbers 0, 1, … (N,) of the points that have an outline each; one for all by default."""
        return np.zeros(len(points), np.int32)

    def trace(self, points: Points, spacing: float, emit: Emit = ignore) -> Boundary | Failure:
        """The boundary of points; see the class."""
        raise NotImplementedError

    def regularise(self, boundaries: list[Boundary], emit: Emit = ignore) -> list[Polygon | Failure]:
        """A polygon for each boundary; see the class."""
        raise NotImplementedError


def trace_outline(
    points: Points | PointCloud,
    spacing: float | None = None,
    method: MethodChoice = None,
    *,
    not_last: Mask | None = None,
    ground: Points | None = None,
    others: Points | None = None,
    origin: tuple[float, float] | None = None,
    debug: str | Path | Emit | None = None,
) -> Boundary | Failure:
    """The boundary of the points of one region.

    Parameters
    ----------
    points : ndarray (N, 3) or PointCloud
        x, y, z in local metres, in any order; points with NaN coordinates are left out.
    spacing : float or None
        Mean distance (m, > 0) of the points in plan; by default as measured.
    method : OutlineMethod, str, mapping or None
        The method, its name, or its parameters; None is `GlobalFit()`.
    not_last : ndarray (N,) of bool or None
        The points whose pulses have a later return, where the scan says so: they show the width of the beam,
        which places points beyond an edge.
    ground : ndarray (K, 2) of float64 or None
        Ground points seen around the points; None when that is not known.
    others : ndarray (K, 3) of float64 or None
        Points around them that are high and no building's: trees. Where they stand over the boundary, and no
        ground was seen beside it, it says less about where the building ends.
    origin : (float, float) or None
        World metres of local (0, 0), by default that of a cloud, else (0, 0). The footprint and the model
        have it, and files are then written where the building stands.
    debug : str, Path, callable or None
        A folder or a callback `(name, value)` that receives every named intermediate.

    Returns
    -------
    Boundary or Failure
        A Failure `too_few_points` for points at fewer than four places, another code where the method finds
        no outline.

    Raises
    ------
    TypeError
        When `points` are no numbers, `spacing` is none, or `method` no outline method.
    ValueError
        When `points` has another shape, `spacing` is not above 0, or no method or parameter has that name.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> points = truth.cloud.xyz[truth.building == 1]
    >>> boundary = eaves.trace_outline(points)
    >>> len(boundary.rings), boundary.rings[0].shape[1]
    (1, 2)
    """
    if origin is None:
        origin = points.origin if isinstance(points, PointCloud) else (0.0, 0.0)
    points = plain_points(points)
    outliner = resolve_method("outline", method)
    assert isinstance(outliner, OutlineMethod)
    finite = np.isfinite(points).all(axis=1)
    good = points[finite]
    good = good[canonical_order(good)]
    places = count_places(good[:SOME_POINTS])
    if places < MIN_POINTS and (places := count_places(good)) < MIN_POINTS:
        reason = f"{len(good)} points at {places} places have no outline; {MIN_POINTS} places are needed"
        return Failure("too_few_points", reason, "outline")
    with naming(outliner):
        boundary = outliner.trace(good, given_spacing(spacing, good), emitter(debug))
    check_returned(outliner, isinstance(boundary, Boundary | Failure), "a Boundary or a Failure", boundary)
    if isinstance(boundary, Failure):
        return boundary
    divided = None if not_last is None else points[finite & not_last]
    return replace(boundary, not_last=divided, ground=ground, others=others, origin=origin)


def count_places(points: Points) -> int:
    """The number of different places of points (N, 3) in plan."""
    return len(np.unique(points[:, :2], axis=0))


@overload
def regularise_outlines(
    boundaries: Boundary | Failure, method: MethodChoice = None, *, debug: str | Path | Emit | None = None
) -> Footprint | Failure: ...


@overload
def regularise_outlines(
    boundaries: list[Boundary], method: MethodChoice = None, *, debug: str | Path | Emit | None = None
) -> list[Footprint | Failure]: ...


def regularise_outlines(
    boundaries: Boundary | Failure | list[Boundary],
    method: MethodChoice = None,
    *,
    debug: str | Path | Emit | None = None,
) -> Footprint | Failure | list[Footprint | Failure]:
    """A valid footprint, or a Failure, for each boundary.

    Parameters
    ----------
    boundaries : Boundary, Failure or list of Boundary
        Results of `trace_outline` in one system of local metres; buildings that touch belong in one list,
        without failures. A Failure alone is given back.
    method : OutlineMethod, str, mapping or None
        The method, its name, or its parameters; None is `GlobalFit()`.
    debug : str, Path, callable or None
        A folder or a callback `(name, value)` that receives every named intermediate.

    Returns
    -------
    Footprint or Failure, or list of them
        For the boundary, or one for each, in their order. How far an outline can be relied on is its
        `agreement` with those drawn through either half of the boundary points: the reliability of split
        halves [spearman1910].

    Raises
    ------
    TypeError
        When an element is no Boundary, or `method` no outline method.
    ValueError
        When no method or parameter has that name, or a value is out of range.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> points = truth.cloud.xyz[truth.building == 1]
    >>> footprint = eaves.regularise_outlines(eaves.trace_outline(points))
    >>> true = truth.buildings[0].footprint
    >>> bool(footprint.polygon.symmetric_difference(true).area < 0.1 * true.area)
    True
    """
    if isinstance(boundaries, Failure):
        return boundaries
    if not isinstance(boundaries, list | tuple):
        return regularise_outlines([boundaries], method, debug=debug)[0]
    for number, boundary in enumerate(boundaries):
        remedy = "leave the failures of trace_outline out"
        check_type(boundary, Boundary, f"boundaries[{number}]", remedy)
    outliner = resolve_method("outline", method)
    assert isinstance(outliner, OutlineMethod)
    results: list[Footprint | Failure] = []
    with naming(outliner):
        polygons = outliner.regularise(boundaries, emitter(debug))
        halves = [outliner.regularise([half_of(one, k) for one in boundaries], ignore) for k in range(2)]
    held = isinstance(polygons, list) and len(polygons) == len(boundaries)
    held = held and all(isinstance(one, Polygon | Failure) for one in polygons)
    rule = f"a list of {len(boundaries)} Polygons or Failures, one a boundary"
    check_returned(outliner, held, rule, polygons)
    for boundary, polygon, *redrawn in zip(boundaries, polygons, *halves, strict=True):
        if isinstance(polygon, Failure):
            results.append(polygon)
            continue
        whole = as_polygon(polygon)
        if whole is None:
            results.append(Failure("no_area", "the outline encloses no area", "outline"))
            continue
        agreement = float(np.mean([common_share(whole, half) for half in redrawn]))
        results.append(Footprint(shapely.orient_polygons(whole), boundary.origin, agreement=agreement))
    return results


def half_of(boundary: Boundary, first: int) -> Boundary:
    """The boundary with every second point of its rings from number `first` on; short rings stay whole."""
    long = 2 * MIN_POINTS
    rings = tuple(ring[first::2].copy() if len(ring) >= long else ring for ring in boundary.rings)
    return replace(boundary, rings=rings)


def common_share(polygon: Polygon, redrawn: Polygon | Failure) -> float:
    """Intersection over union with an outline drawn again; 0 where that has no area."""
    other = None if isinstance(redrawn, Failure) else as_polygon(redrawn)
    if other is None:
        return 0.0
    common = polygon.intersection(other).area
    return float(common / (polygon.area + other.area - common))
