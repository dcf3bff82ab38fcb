"""The parametric roof: its height anywhere, and its robust least-squares fit to points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eaves.model import Points, Values

ANGLE, ALONG, ACROSS, TOP, LEFT_SLOPE, RIGHT_SLOPE, END_SLOPE, HALF_RIDGE = range(8)
"""Parameters: the ridge's angle (radians), middle along, across, height (m), slopes, half its length."""

PLANE, GABLE, HIP = range(3)
"""Forms: one plane (of END_SLOPE along and LEFT_SLOPE across), two planes, four planes."""

FREE: dict[int, tuple[tuple[int, ...], ...]] = {
    PLANE: ((TOP,), (LEFT_SLOPE,), (END_SLOPE,)),
    GABLE: ((ANGLE,), (ACROSS,), (TOP,), (LEFT_SLOPE,), (RIGHT_SLOPE,)),
    HIP: ((ANGLE,), (ALONG,), (ACROSS,), (TOP,), (LEFT_SLOPE, RIGHT_SLOPE), (END_SLOPE,), (HALF_RIDGE,)),
}
"""The free parameters of each form; those in one bracket move together."""


def matrix_of(groups: tuple[tuple[int, ...], ...]) -> NDArray[np.float64]:
    """Matrix (8, k) of what each free number adds to the parameters."""
    return np.stack([np.isin(np.arange(8), group) for group in groups], axis=1).astype(np.float64)


GROUPS = {form: matrix_of(groups) for form, groups in FREE.items()}
"""The same as matrices (8, k)."""

CUT = 3.0
"""Distance, in standard deviations, at which a point's weight has fallen to a quarter."""

ROUNDS = 25
"""Gauss–Newton steps at most; ten are usual."""

SETTLED = 0.01
"""Share of the residuals' scale that a last step moves no height by."""


def roof_heights(
    form: int, p: NDArray[np.float64], xy: NDArray[np.float64]
) -> tuple[Values, NDArray[np.float64]]:
    """Heights (N,) of the roof of parameters (8,) at (N, 2 or 3), and their derivatives (N, 8)."""
    cosine, sine = np.cos(p[ANGLE]), np.sin(p[ANGLE])
    u, v = cosine * xy[:, 0] + sine * xy[:, 1], cosine * xy[:, 1] - sine * xy[:, 0]
    slopes = np.zeros((len(xy), 8))
    slopes[:, TOP] = 1.0
    if form == PLANE:
        slopes[:, LEFT_SLOPE], slopes[:, END_SLOPE] = -v, u
        slopes[:, ANGLE] = p[END_SLOPE] * v + p[LEFT_SLOPE] * u
        return p[TOP] + p[END_SLOPE] * u - p[LEFT_SLOPE] * v, slopes
    across = v - p[ACROSS]
    left = across >= 0.0
    fall = np.where(left, p[LEFT_SLOPE], -p[RIGHT_SLOPE])
    drop = fall * across
    slopes[:, LEFT_SLOPE], slopes[:, RIGHT_SLOPE] = -across * left, across * ~left
    slopes[:, ACROSS], slopes[:, ANGLE] = fall, fall * u
    if form == HIP:
        along, way = u - p[ALONG], np.where(u >= p[ALONG], p[END_SLOPE], -p[END_SLOPE])
        beyond = np.abs(along) - p[HALF_RIDGE]
        at_end = p[END_SLOPE] * beyond > drop
        drop = np.where(at_end, p[END_SLOPE] * beyond, drop)
        slopes[at_end] = 0.0
        slopes[at_end, TOP], slopes[at_end, HALF_RIDGE] = 1.0, p[END_SLOPE]
        slopes[at_end, END_SLOPE], slopes[at_end, ALONG] = -beyond[at_end], way[at_end]
        slopes[at_end, ANGLE] = -(way * v)[at_end]
    return p[TOP] - drop, slopes


@dataclass(frozen=True, eq=False)
class ParametricFit:
    """A form, its parameters (8,) about `centre` (2,), residuals (N,) and the fit's covariance (8, 8)."""

    form: int
    centre: NDArray[np.float64]
    parameters: NDArray[np.float64]
    residuals: Values
    covariance: NDArray[np.float64]
    scale: float

    def height_at(self, xy: NDArray[np.float64]) -> Values:
        """Heights (M,) of the roof at (M, 2 or 3)."""
        return roof_heights(self.form, self.parameters, xy[:, :2] - self.centre)[0]

    def axes(self, xy: NDArray[np.float64]) -> tuple[Values, Values]:
        """Coordinates (M,) of (M, 2 or 3) along and across the ridge, about the centre."""
        cosine, sine = np.cos(self.parameters[ANGLE]), np.sin(self.parameters[ANGLE])
        x, y = xy[:, 0] - self.centre[0], xy[:, 1] - self.centre[1]
        return np.asarray(cosine * x + sine * y), np.asarray(cosine * y - sine * x)


def fit_parametric_roof(
    form: int,
    points: Points,
    centre: NDArray[np.float64],
    start: NDArray[np.float64],
    floor: float,
    rounds: int = ROUNDS,
    turns: bool = True,
) -> ParametricFit:
    """The robust least-squares fit of a form to points (N, 3), from `start` (8,), by Gauss–Newton.

    Weights are 1 / (1 + (r / cut·scale)²)², the scale is 1.48 times the median residual, never below `floor`
    (m). Without `turns` the orientation stays as it starts.
    """
    xy, z = points[:, :2] - centre, points[:, 2]
    moves = GROUPS[form] if turns else GROUPS[form][:, GROUPS[form][ANGLE] == 0.0]
    best = start.astype(np.float64)
    normal: NDArray[np.float64] = np.eye(moves.shape[1])
    for _ in range(rounds):
        height, slopes = roof_heights(form, best, xy)
        scale = scale_of(z - height, floor)
        free, weight = slopes @ moves, (1.0 + ((z - height) / (CUT * scale)) ** 2) ** -2
        normal = free.T @ (free * weight[:, None])
        damped = normal + np.diag(1e-4 * np.diag(normal) + 1e-9)
        step = np.asarray(np.linalg.solve(damped, free.T @ (weight * (z - height))), np.float64)
        best = best + moves @ step
        if np.abs(free @ step).max() < SETTLED * scale:
            break
    residuals = z - roof_heights(form, best, xy)[0]
    scale = scale_of(residuals, floor)
    covariance = covariance_of(moves, normal, residuals[np.abs(residuals) < CUT * scale])
    return ParametricFit(form, centre, best, residuals, covariance, scale)


def scale_of(residuals: Values, floor: float) -> float:
    """The standard deviation (m) of residuals (N,) without outliers, at least `floor` (m)."""
    return max(1.4826 * float(np.median(np.abs(residuals))), floor)


def covariance_of(
    moves: NDArray[np.float64], normal: NDArray[np.float64], residuals: Values
) -> NDArray[np.float64]:
    """Covariance (8, 8) of the parameters from the normal matrix (k, k) and the explained residuals (M,)."""
    variance = float(residuals @ residuals) / max(len(residuals) - len(normal), 1)
    level = np.sqrt(np.maximum(np.diag(normal), 1e-12))
    scaled = normal / np.outer(level, level) + 1e-9 * np.eye(len(level))
    return np.asarray(moves @ (np.linalg.inv(scaled) / np.outer(level, level)) @ moves.T * variance)
