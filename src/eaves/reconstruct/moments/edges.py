"""The rectangle of a parametric house: its axes where the roof does not tell them, its edges, its cover."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from eaves.geometry.tin import areas_and_radii
from eaves.geometry.tolerance import FLAT_SLOPE_DEG
from eaves.model import Points
from eaves.reconstruct.moments.extents import extent_of
from eaves.reconstruct.moments.invariants import Rectangle
from eaves.reconstruct.moments.parametric_roof import (
    ANGLE,
    END_SLOPE,
    LEFT_SLOPE,
    ParametricFit,
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
