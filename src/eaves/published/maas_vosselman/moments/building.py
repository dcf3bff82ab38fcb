"""The parametric house under a set of roof points: closed solution, one fit, edges, and whether it is one."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from eaves.geometry.rings import FLAT_SLOPE_DEG
from eaves.geometry.tin import Tin, areas_and_radii
from eaves.kernels import kernel
from eaves.model import Failure, Mask, Points, Values
from eaves.published.maas_vosselman.moments.parametric_roof import (
    ACROSS,
    ALONG,
    ANGLE,
    CUT,
    END_SLOPE,
    FREE,
    GABLE,
    HALF_RIDGE,
    HIP,
    LEFT_SLOPE,
    PLANE,
    RIGHT_SLOPE,
    TOP,
    ClosedForm,
    ParametricFit,
    Rectangle,
    border_growth,
    closed_forms,
    fit_parametric_roof,
    surface_moments,
)

STRAY = 6.0
"""A point outside the edge costs as much as a gap in which six points were to be expected."""

MOST_STRAYS = 0.05
"""Share of the points that may lie outside each edge."""


@kernel
def extent_kernel(ordered: Values) -> tuple[float, float, float]:
    """Low and high edge of ordered values (N,), and the standard deviation of each.

    Of uniformly spread points with strays the likeliest edges are sought: n·ln(high − low) plus the strays'
    cost. Beyond the last point the edge is as far as a place at random is from the next point, Σg² / 2Σg
    for gaps g, which is right for random points and for scan lines alike [cox1962].
    """
    count = len(ordered)
    reach = int(MOST_STRAYS * count)
    low, high = 0, count - 1
    for _ in range(2):
        best = np.inf
        for i in range(reach + 1):
            span = ordered[high] - ordered[i]
            if span <= 0.0:
                break
            cost = STRAY * i + count * np.log(span)
            if cost < best:
                best, low = cost, i
        best = np.inf
        for i in range(reach + 1):
            span = ordered[count - 1 - i] - ordered[low]
            if span <= 0.0:
                break
            cost = STRAY * i + count * np.log(span)
            if cost < best:
                best, high = cost, count - 1 - i
    first, second, third = 0.0, 0.0, 0.0
    for i in range(low, high):
        gap = ordered[i + 1] - ordered[i]
        first += gap
        second += gap * gap
        third += gap * gap * gap
    beyond, spread = 0.0, 0.0
    if first > 0.0:
        beyond = second / (2.0 * first)
        spread = np.sqrt(max(third / (3.0 * first) - beyond * beyond, 0.0))
    return float(ordered[low] - beyond), float(ordered[high] + beyond), float(spread)


def extent_of(values: Values) -> tuple[float, float, float]:
    """Low and high edge (m) of values (N,), N ≥ 2, and the standard deviation (m) of each."""
    low, high, deviation = extent_kernel(np.sort(values))
    return low, high, deviation


LEAST_NOISE = 0.015
"""Noise (m) under which a fit does not tell forms apart."""

EMPTY_RADIUS = 4.0
"""A triangle is empty ground when its circle is this many times wider than usual."""


def rectangle_around(plan: BaseGeometry) -> Rectangle:
    """The least rectangle around a plan."""
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(plan))
    sides = np.diff(corners[:3], axis=0)
    sizes = np.hypot(*sides.T)
    longer = int(np.argmax(sizes))
    x, y = corners[:4].mean(axis=0)
    angle = float(np.arctan2(*sides[longer, ::-1]))
    return Rectangle(float(x), float(y), angle, float(sizes[longer]), float(sizes[1 - longer]))


def frame_of(fit: ParametricFit, plan: Rectangle) -> tuple[float, float, float, float, float, float]:
    """The edges of a plan in the axes of the fit, parallel to its own: how sure they are, only its maker
    knows (NaN)."""
    turned = abs(np.sin(fit.parameters[ANGLE] - plan.orientation)) > 0.5
    along, across = 0.5 * plan.length, 0.5 * plan.width
    if turned:
        along, across = across, along
    return -along, along, -across, across, np.nan, np.nan


def settle_axes(fit: ParametricFit, points: Points) -> ParametricFit:
    """The plane's fit with axes along the sides of the rectangle around points (N, 3), falling across.

    A plane has no ridge to tell the orientation. Where it falls, the fall tells it; where it is flat,
    the least rectangle.
    """
    along, across = fit.parameters[END_SLOPE], fit.parameters[LEFT_SLOPE]
    if np.hypot(along, across) >= np.tan(np.radians(FLAT_SLOPE_DEG)):
        return turned_fit(fit, float(np.arctan2(along, across)))
    plan = rectangle_around(shapely.multipoints(points[:, :2]))
    return turned_fit(fit, plan.orientation - fit.parameters[ANGLE])


def turned_fit(fit: ParametricFit, turn: float) -> ParametricFit:
    """The same plane in axes turned by `turn` (radians)."""
    p = fit.parameters.copy()
    cosine, sine = np.cos(turn), np.sin(turn)
    gradient_along, gradient_across = p[END_SLOPE], -p[LEFT_SLOPE]
    p[ANGLE] += turn
    p[END_SLOPE] = cosine * gradient_along + sine * gradient_across
    p[LEFT_SLOPE] = -(cosine * gradient_across - sine * gradient_along)
    return ParametricFit(fit.form, fit.centre, p, fit.residuals, fit.covariance, fit.scale)


def measure_edges(fit: ParametricFit, points: Points) -> tuple[float, float, float, float, float, float]:
    """Low and high along, low and high across, in the axes of the fit, and a deviation for each axis."""
    along, across = fit.axes(points)
    west, east, end_deviation = extent_of(along)
    south, north, side_deviation = extent_of(across)
    return west, east, south, north, end_deviation, side_deviation


def covered_area(points: Points, triangles: NDArray[np.int32]) -> float:
    """Area (m²) of the triangles (T, 3) between points (N, 3) without the wide ones over empty ground."""
    area, radius = areas_and_radii(points, triangles)
    return float(area[radius <= EMPTY_RADIUS * np.median(radius)].sum())


FEWEST_POINTS = 16
"""Points a house of seven parameters is asked from."""

CHOICE_POINTS = 160
"""Points with which the forms are compared before the one fit."""

CLOSED_ROUNDS = 10
"""Times that the moments are integrated again without what stands on the roof; three are usual."""

HIP_FALL, FULL_HIP_FALL = 0.12, 0.8
"""Fall of the ends as a share of the sides': a gable below the first, a hip from the second.
A hip whose ridge is a smaller share of its length than the first is a pyramid."""

FARTHEST_OVERLAP = 0.5
"""Distance (m) by which the end planes of a pyramid may reach over its middle."""

HIGHEST_PARAPET = 1.2
"""Points up to this height (m) above the roof's plane belong to its rectangle."""


@dataclass(frozen=True, eq=False)
class ParametricBuilding(Rectangle):
    """A house with a simple roof: what it measures (m, radians), and how sure each number is.

    `length` runs along the ridge (the eaves of a shed), `width` across; `x, y` is the rectangle's middle.
    `slope` is the mean of both sides' slopes (radians), `ridge_offset` how far the ridge lies beside the
    middle. `deviations` holds a standard deviation for each parameter by name, `inlier` (N,) the points the
    roof explains.
    """

    roof: str
    eaves: float
    ridge: float
    slope: float
    ridge_offset: float
    deviations: dict[str, float]
    rmse: float
    fit: ParametricFit = field(repr=False)
    closed: ClosedForm = field(repr=False)
    edges: tuple[float, float, float, float] = field(repr=False)
    """Rectangle in the axes of the fit: low and high along, low and high across (m)."""
    inlier: Mask = field(repr=False)
    empty_share: float
    """Share of the rectangle that the points, with their border, do not cover."""
    on_plan: bool = False
    """True if place, orientation, length and width are those of a ground plan."""


def fit_building(
    points: Points,
    plan: Polygon | None = None,
    *,
    closed_only: bool = False,
    sums: bool = False,
    only: str = "",
) -> ParametricBuilding | Failure:
    """The parametric house under roof points (N, 3), or a Failure when there are too few.

    With a ground plan, place, orientation, length and width are those of its least rectangle. With
    `closed_only` nothing is fitted: roof, edges and heights are those of the closed solution, and how sure
    they are is not known (NaN). Moments are integrals over triangles, or `sums` over points. The roof `only`
    is a gable or a hip, where one is stated.
    """
    if len(points) < FEWEST_POINTS:
        return Failure("too_few_points", f"{len(points)} roof points for a parametric house", "reconstruct")
    triangles = Tin(points[:, :2]).triangles
    moments = surface_moments(points, triangles, sums)
    if moments.area <= 0.0 or min(moments.xx, moments.yy) <= 0.0:
        return Failure("no_area", "the roof points lie on one line", "reconstruct")
    rectangle = None if plan is None else rectangle_around(plan)
    forms, best = solve_closed(points, triangles, rectangle, sums, only)
    if not closed_only:
        best = choose_fit(points, forms, rectangle is None, only)
    inlier = np.abs(best.residuals) <= CUT * best.scale
    if rectangle is not None or closed_only:
        frame = frame_of(best, rectangle or forms[0])
    else:
        rim = inlier | ((best.residuals > 0.0) & (best.residuals < HIGHEST_PARAPET))
        if best.form == PLANE:
            best = settle_axes(best, points[rim])
        above = points[~rim & (best.residuals > 0.0)]
        frame = measure_edges(best, np.vstack([points[rim], hiding(best, above, points[rim])]))
    covered = covered_area(points, triangles) * border_growth(len(points)) ** 2
    house = describe_building(best, forms[0], frame, inlier, covered)
    return replace(house, on_plan=rectangle is not None)


def solve_closed(
    points: Points,
    triangles: NDArray[np.int32],
    plan: Rectangle | None,
    sums: bool = False,
    only: str = "",
) -> tuple[list[ClosedForm], ParametricFit]:
    """The closed solutions, first the one that explains points (N, 3) best, and its roof with residuals.

    Points off the roof are dormers, chimneys and terraces: they take its height, and the moments are
    integrated again, until the same points are off.
    """
    heights, off = points, np.zeros(len(points), bool)
    growth = 1.0 if sums else border_growth(len(points))  # points spread over all of it have its moments
    for _ in range(CLOSED_ROUNDS):
        moments = surface_moments(heights, triangles, sums)
        level = float(np.tan(np.radians(FLAT_SLOPE_DEG)) * np.sqrt(12.0 * moments.area) / 4.0)
        forms = closed_forms(moments, level, growth, plan)
        forms = [form for form in forms if form.roof == only] or forms
        fits = [closed_fit(points, closed) for closed in forms]
        order = np.argsort(costs_of(fits), kind="stable")
        best = fits[order[0]]
        before, off = off, np.abs(best.residuals) > CUT * best.scale
        if (off == before).all():
            break
        heights = points - np.where(off, best.residuals, 0.0)[:, None] * [0.0, 0.0, 1.0]
    return [forms[k] for k in order], best


def closed_fit(points: Points, closed: ClosedForm) -> ParametricFit:
    """The roof of a closed solution as it is, with the residuals of points (N, 3) and no covariance."""
    form, start = parameters_of(closed)
    fit = fit_parametric_roof(form, points, np.array([closed.x, closed.y]), start, LEAST_NOISE, 0)
    return replace(fit, covariance=np.full_like(fit.covariance, np.nan))


def parameters_of(closed: ClosedForm) -> tuple[int, NDArray[np.float64]]:
    """The form and the parameters (8,) of a closed solution."""
    form = {"flat": PLANE, "shed": PLANE, "gable": GABLE}.get(closed.roof, HIP)
    start, rise = np.zeros(8), abs(closed.rise)
    start[ANGLE], start[ACROSS], start[TOP] = closed.orientation, closed.ridge_offset, closed.ridge
    if form == PLANE:
        start[TOP], start[LEFT_SLOPE] = closed.eaves + 0.5 * rise, -closed.rise / closed.width
        return form, start
    start[[LEFT_SLOPE, RIGHT_SLOPE, END_SLOPE]] = 2.0 * rise / closed.width
    start[HALF_RIDGE] = max(closed.length - closed.width, 0.0) / 2.0
    if closed.roof == "pyramid":
        start[HALF_RIDGE], start[END_SLOPE] = 0.0, 2.0 * rise / closed.length
    return form, start


def hiding(fit: ParametricFit, above: Points, rim: Points) -> Points:
    """Those of the points `above` the roof (M, 3) that lie between the points of its rim (N, 3).

    Without them a wide dormer looks like the end of a slope, and the roof below it like a few strays.
    """
    inside = np.ones(len(above), bool)
    for place, reach in zip(fit.axes(above), fit.axes(rim), strict=True):
        inside &= (place >= reach.min()) & (place <= reach.max())
    return above[inside]


def choose_fit(points: Points, closed: list[ClosedForm], turns: bool, only: str = "") -> ParametricFit:
    """The fit that explains the points best for its number of parameters, from a closed solution, in whose
    axes it stays unless it `turns`; a hip whose ends hardly fall is a gable. Where no fit is the roof that is
    stated, `only`, the closed solution of it stands."""
    centre = np.array([closed[0].x, closed[0].y])
    sample = points[:: max(1, len(points) // CHOICE_POINTS)]
    fits = []
    for solution in closed:
        form, start = parameters_of(solution)
        if form == HIP:
            start[HALF_RIDGE] += 0.25 * solution.width  # half-way to a gable: half-hips are found from there
        fits.append(fit_parametric_roof(form, sample, centre, start, LEAST_NOISE, turns=turns))
    fits = [fit for fit in fits if is_roof(fit)]
    for choice in np.argsort(costs_of(fits), kind="stable") if fits else ():
        form, start = fits[choice].form, fits[choice].parameters
        final = fit_parametric_roof(form, points, centre, start, LEAST_NOISE, turns=turns)
        inside = points[np.abs(final.residuals) <= CUT * final.scale]
        if form == HIP and max(end_falls(final, *measure_edges(final, inside)[:4])) < HIP_FALL:
            if only:
                continue
            final = fit_parametric_roof(GABLE, points, centre, final.parameters, LEAST_NOISE, turns=turns)
        if is_roof(final):
            return final
    if closed[0].roof == only:
        return closed_fit(points, closed[0])
    return fit_parametric_roof(PLANE, points, centre, np.zeros(8), LEAST_NOISE)


def costs_of(fits: list[ParametricFit]) -> list[float]:
    """The robust squares of each fit's residuals, and a price for each of its parameters."""
    scale = min(fit.scale for fit in fits)
    costs = []
    for fit in fits:
        square = (fit.residuals / (CUT * scale)) ** 2
        price = 0.5 * float(np.log(len(square))) * len(FREE[fit.form])
        costs.append(0.5 * CUT**2 * float(np.sum(square / (1.0 + square))) + price)
    return costs


def is_roof(fit: ParametricFit) -> bool:
    """True if a fit has the shape of its form: sides and ends fall, ends do not begin beyond the middle."""
    p = fit.parameters
    if fit.form == PLANE:
        return True
    falls = [p[LEFT_SLOPE], p[RIGHT_SLOPE]]
    if fit.form == HIP:
        falls.append(p[END_SLOPE])
        if p[HALF_RIDGE] < -FARTHEST_OVERLAP:
            return False
    return bool(min(falls) > np.tan(np.radians(FLAT_SLOPE_DEG)))


def describe_building(
    fit: ParametricFit,
    closed: ClosedForm,
    frame: tuple[float, float, float, float, float, float],
    inlier: Mask,
    covered: float,
) -> ParametricBuilding:
    """The house of a fit and its edges."""
    west, east, south, north, end_deviation, side_deviation = frame
    p = fit.parameters
    length, width = east - west, north - south
    along, across = 0.5 * (west + east), 0.5 * (south + north)
    cosine, sine = np.cos(p[ANGLE]), np.sin(p[ANGLE])
    x = fit.centre[0] + cosine * along - sine * across
    y = fit.centre[1] + sine * along + cosine * across
    corners = corner_heights(fit, west, east, south, north)
    roof, slope, ridge = name_roof(fit, west, east, south, north)
    eaves = min(corners) if roof in ("flat", "shed") else side_eaves(fit, south, north)
    if roof == "flat":
        eaves = ridge = float(np.mean(corners))
    variance = np.maximum(np.diag(fit.covariance), 0.0)
    tangent = float(np.tan(slope))
    slope_variance = variance[[LEFT_SLOPE, END_SLOPE]].sum() if fit.form == PLANE else variance[LEFT_SLOPE]
    edge = 0.5 * width * np.sqrt(slope_variance)
    deviations = {
        "x": float(np.hypot(cosine * end_deviation, sine * side_deviation) / np.sqrt(2.0)),
        "y": float(np.hypot(sine * end_deviation, cosine * side_deviation) / np.sqrt(2.0)),
        "orientation": orientation_deviation(fit, variance, length, width, end_deviation, side_deviation),
        "length": float(np.sqrt(2.0) * end_deviation),
        "width": float(np.sqrt(2.0) * side_deviation),
        "ridge": float(
            np.sqrt(variance[TOP]) if fit.form != PLANE else np.hypot(np.sqrt(variance[TOP]), edge)
        ),
        "eaves": float(np.sqrt(variance[TOP] + edge**2 + np.nan_to_num(tangent * side_deviation) ** 2)),
        "slope": float(np.sqrt(slope_variance) / (1.0 + tangent**2)),
    }
    inside = fit.residuals[inlier]
    return ParametricBuilding(
        float(x),
        float(y),
        float(np.mod(p[ANGLE], np.pi)),
        float(length),
        float(width),
        roof,
        float(eaves),
        float(ridge),
        slope,
        float(p[ACROSS] - across) if fit.form != PLANE else 0.0,
        deviations,
        float(np.sqrt(np.mean(inside**2))) if len(inside) else 0.0,
        fit,
        closed,
        (west, east, south, north),
        inlier,
        float(1.0 - covered / (length * width)),
    )


def squared_up(house: ParametricBuilding) -> ParametricFit:
    """The fit with a full hip's ridge in the middle and level eaves, so that its hips end in the corners."""
    if house.roof not in ("hip", "pyramid"):
        return house.fit
    west, east, south, north = house.edges
    p = house.fit.parameters.copy()
    p[ALONG], p[ACROSS] = 0.5 * (west + east), 0.5 * (south + north)
    p[HALF_RIDGE] = 0.0 if house.roof == "pyramid" else min(max(p[HALF_RIDGE], 0.0), 0.45 * house.length)
    fall = house.ridge - house.eaves
    p[LEFT_SLOPE] = p[RIGHT_SLOPE] = 2.0 * fall / house.width
    p[END_SLOPE] = fall / (0.5 * house.length - p[HALF_RIDGE])
    return replace(house.fit, parameters=p)


def corner_heights(fit: ParametricFit, west: float, east: float, south: float, north: float) -> list[float]:
    """Heights (m) of the roof over the rectangle's corners."""
    cosine, sine = np.cos(fit.parameters[ANGLE]), np.sin(fit.parameters[ANGLE])
    places = np.array([[west, south], [east, south], [east, north], [west, north]])
    turn = np.array([[cosine, sine], [-sine, cosine]])
    return [float(height) for height in fit.height_at(places @ turn + fit.centre)]


def side_eaves(fit: ParametricFit, south: float, north: float) -> float:
    """Mean height (m) of the two eaves of a gable or hip."""
    p = fit.parameters
    left, right = p[LEFT_SLOPE] * (north - p[ACROSS]), p[RIGHT_SLOPE] * (p[ACROSS] - south)
    return float(p[TOP] - 0.5 * (left + right))


def name_roof(
    fit: ParametricFit, west: float, east: float, south: float, north: float
) -> tuple[str, float, float]:
    """The roof's type, slope (radians) and ridge height (m)."""
    p = fit.parameters
    if fit.form == PLANE:
        slope = float(np.arctan(np.hypot(p[LEFT_SLOPE], p[END_SLOPE])))
        ridge = max(corner_heights(fit, west, east, south, north))
        return ("flat" if slope < np.radians(FLAT_SLOPE_DEG) else "shed"), slope, ridge
    slope = float(np.mean(np.arctan(p[[LEFT_SLOPE, RIGHT_SLOPE]])))
    if fit.form == HIP:
        falls = end_falls(fit, west, east, south, north)
        if max(falls) >= HIP_FALL:
            short = 2.0 * p[HALF_RIDGE] < HIP_FALL * (east - west)
            name = "half_hip" if min(falls) < FULL_HIP_FALL else "pyramid" if short else "hip"
            return name, slope, float(p[TOP])
    return "gable", slope, float(p[TOP])


def end_falls(
    fit: ParametricFit, west: float, east: float, south: float, north: float
) -> tuple[float, float]:
    """Fall of the western and of the eastern end plane, as a share of the sides' fall."""
    p = fit.parameters
    sides = max(p[TOP] - side_eaves(fit, south, north), 1e-6)
    west_run, east_run = p[ALONG] - west - p[HALF_RIDGE], east - p[ALONG] - p[HALF_RIDGE]
    return float(p[END_SLOPE] * west_run / sides), float(p[END_SLOPE] * east_run / sides)


def orientation_deviation(
    fit: ParametricFit,
    variance: NDArray[np.float64],
    length: float,
    width: float,
    end_deviation: float,
    side_deviation: float,
) -> float:
    """Standard deviation (radians) of the orientation: of the fit, or of the edges for a single plane."""
    if np.isnan(side_deviation):  # the plan's own
        return side_deviation
    if fit.form != PLANE:
        return float(np.sqrt(variance[ANGLE]))
    if abs(fit.parameters[END_SLOPE]) < 1e-9:  # turned to its fall
        return float(np.sqrt(variance[END_SLOPE]) / max(abs(fit.parameters[LEFT_SLOPE]), 1e-6))
    return float(1.0 / np.hypot(length / max(side_deviation, 1e-6), width / max(end_deviation, 1e-6)))
