"""The rectangle of a parametric house: its axes where the roof does not tell them, its edges, its cover."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from eaves.geometry.tolerance import FLAT_SLOPE_DEG
from eaves.kernels import kernel
from eaves.model import Points
from eaves.reconstruct.moments.extents import extent_of
from eaves.reconstruct.moments.invariants import Rectangle
from eaves.reconstruct.moments.parametric_roof import (
    ANGLE,
    END_SLOPE,
    LEFT_SLOPE,
    PLANE,
    ParametricFit,
    fit_parametric_roof,
)

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


def take_plan(
    fit: ParametricFit, points: Points, plan: BaseGeometry
) -> tuple[ParametricFit, tuple[float, float, float, float, float, float]]:
    """The fit to points (N, 3) in the axes of the plan's least rectangle, and its edges: how sure those are,
    only the plan's maker knows (NaN)."""
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(plan))
    side = corners[1] - corners[0]
    turn = np.arctan2(side[1], side[0]) - fit.parameters[ANGLE]
    turn = np.mod(turn + np.pi / 4.0, np.pi / 2.0) - np.pi / 4.0
    if fit.form == PLANE:
        fit = turned_fit(fit, float(turn))
        if abs(fit.parameters[END_SLOPE]) > abs(fit.parameters[LEFT_SLOPE]):
            fit = turned_fit(fit, np.pi / 2.0)
    else:
        start = fit.parameters.copy()
        start[ANGLE] += turn
        fit = fit_parametric_roof(fit.form, points, fit.centre, start, LEAST_NOISE, turns=False)
    along, across = fit.axes(corners)
    return fit, (along.min(), along.max(), across.min(), across.max(), np.nan, np.nan)


def settle_axes(fit: ParametricFit, points: Points) -> ParametricFit:
    """The plane's fit with axes along the sides of the rectangle around points (N, 3), falling across.

    A plane has no ridge to tell the orientation. Where it falls, the fall tells it; where it is flat,
    the least rectangle.
    """
    along, across = fit.parameters[END_SLOPE], fit.parameters[LEFT_SLOPE]
    if np.hypot(along, across) >= np.tan(np.radians(FLAT_SLOPE_DEG)):
        return turned_fit(fit, float(np.arctan2(along, across)))
    settled, (west, east, south, north, _, _) = take_plan(fit, points, shapely.multipoints(points[:, :2]))
    return settled if east - west >= north - south else turned_fit(settled, np.pi / 2.0)


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
    area, radius = np.zeros(len(triangles)), np.zeros(len(triangles))
    circles_kernel(points, triangles, area, radius)
    return float(area[radius <= EMPTY_RADIUS * np.median(radius)].sum())


@kernel
def circles_kernel(
    xyz: NDArray[np.float64],
    triangles: NDArray[np.int32],
    area: NDArray[np.float64],
    radius: NDArray[np.float64],
) -> None:
    """Area (T,) and radius of the circle (T,) around each of the triangles (T, 3) in plan."""
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ux, uy = xyz[b, 0] - xyz[a, 0], xyz[b, 1] - xyz[a, 1]
        vx, vy = xyz[c, 0] - xyz[b, 0], xyz[c, 1] - xyz[b, 1]
        wx, wy = xyz[a, 0] - xyz[c, 0], xyz[a, 1] - xyz[c, 1]
        area[t] = 0.5 * abs(ux * wy - uy * wx)
        sides = np.sqrt((ux * ux + uy * uy) * (vx * vx + vy * vy) * (wx * wx + wy * wy))
        radius[t] = sides / max(4.0 * area[t], 1e-12)
