"""The parametric roof: its height anywhere, and its robust least-squares fit to points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import kernel
from eaves.model import Points, Values

ANGLE, ALONG, ACROSS, TOP, LEFT_SLOPE, RIGHT_SLOPE, END_SLOPE, HALF_RIDGE = range(8)
"""Parameters: the ridge's angle (radians), middle along, across, height (m), slopes, half its length."""

PLANE, GABLE, HIP = 0, 1, 2
"""Forms: one plane (of END_SLOPE along and LEFT_SLOPE across), two planes, four planes."""

FREE: dict[int, tuple[tuple[int, ...], ...]] = {
    PLANE: ((TOP,), (LEFT_SLOPE,), (END_SLOPE,)),
    GABLE: ((ANGLE,), (ACROSS,), (TOP,), (LEFT_SLOPE,), (RIGHT_SLOPE,)),
    HIP: ((ANGLE,), (ALONG,), (ACROSS,), (TOP,), (LEFT_SLOPE, RIGHT_SLOPE), (END_SLOPE,), (HALF_RIDGE,)),
}
"""What each form lets go; parameters in one bracket move together."""

GROUPS = {
    form: np.array([(group[0], group[-1]) for group in groups], np.int64) for form, groups in FREE.items()
}
"""The same as arrays (k, 2): first and last parameter of each bracket."""

CUT = 3.0
"""Distance, in standard deviations, at which a point's weight has fallen to a quarter."""

ROUNDS = 25
"""Gauss–Newton steps at most; ten are usual."""


@kernel
def roof_height_kernel(
    form: int,
    p: NDArray[np.float64],
    cosine: float,
    sine: float,
    x: float,
    y: float,
    slopes: NDArray[np.float64],
) -> Any:
    """Height of the roof at (x, y), and its derivatives by the eight parameters (`slopes`, 8).

    `cosine` and `sine` are those of the ridge's angle.
    """
    u, v = cosine * x + sine * y, -sine * x + cosine * y
    slopes[:] = 0.0
    slopes[3] = 1.0
    if form == 0:
        slopes[4], slopes[6] = -v, u
        slopes[0] = p[6] * v + p[4] * u
        return p[3] + p[6] * u - p[4] * v
    across = v - p[2]
    if across >= 0.0:
        drop = p[4] * across
        side = 1
    else:
        drop = -p[5] * across
        side = 2
    if form == 2:
        along = u - p[1]
        end = p[6] * (abs(along) - p[7])
        if end > drop:
            sign = 1.0 if along >= 0.0 else -1.0
            slopes[6] = -(abs(along) - p[7])
            slopes[7] = p[6]
            slopes[1] = p[6] * sign
            slopes[0] = -p[6] * sign * v
            return p[3] - end
    if side == 1:
        slopes[4], slopes[2], slopes[0] = -across, p[4], p[4] * u
    else:
        slopes[5], slopes[2], slopes[0] = across, -p[5], -p[5] * u
    return p[3] - drop


@kernel
def solve_kernel(matrix: NDArray[np.float64], right: NDArray[np.float64], count: int) -> None:
    """Solve a positive definite system in place by Cholesky; `right` (count,) receives the answer."""
    for i in range(count):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            if i == j:
                matrix[i, i] = np.sqrt(max(total, 1e-30))
            else:
                matrix[i, j] = total / matrix[j, j]
    for i in range(count):
        for k in range(i):
            right[i] -= matrix[i, k] * right[k]
        right[i] /= matrix[i, i]
    for i in range(count - 1, -1, -1):
        for k in range(i + 1, count):
            right[i] -= matrix[k, i] * right[k]
        right[i] /= matrix[i, i]


@kernel
def fit_roof_kernel(
    form: int,
    xyz: NDArray[np.float64],
    groups: NDArray[np.int64],
    parameters: NDArray[np.float64],
    floor: float,
    cut: float,
    rounds: int,
    residuals: NDArray[np.float64],
    normal: NDArray[np.float64],
) -> float:
    """The scale (m) of residuals after a robust Gauss–Newton fit of `parameters` (8,), changed in place.

    `groups` (k, 2) names the one or two parameters that each of the k free numbers moves. Weights are 1 /
    (1 + (r / cut·scale)²)², the scale is 1.48 times the median residual, never below `floor`. `residuals`
    (N,) and the weighted `normal` (k, k) are filled in; steps that raise the robust cost are halved.
    """
    count, free = len(xyz), len(groups)
    slopes, row = np.zeros(8), np.zeros(free)
    system, right, step = np.zeros((free, free)), np.zeros(free), np.zeros(free)
    matrix, vector = np.zeros((free, free)), np.zeros(free)
    trial = parameters.copy()
    scale, best, shrink = 1.0, np.inf, 1.0
    for turn in range(rounds):
        if turn == 0 or turn == 3 or turn == 6:
            cosine, sine = np.cos(parameters[0]), np.sin(parameters[0])
            for i in range(count):
                height = roof_height_kernel(form, parameters, cosine, sine, xyz[i, 0], xyz[i, 1], slopes)
                residuals[i] = abs(xyz[i, 2] - height)
            scale = max(1.4826 * np.median(residuals), floor)
            best = np.inf
            trial[:] = parameters
        cost = 0.0
        matrix[:] = 0.0
        vector[:] = 0.0
        cosine, sine = np.cos(trial[0]), np.sin(trial[0])
        unit = 1.0 / (cut * scale)
        for i in range(count):
            away = xyz[i, 2] - roof_height_kernel(form, trial, cosine, sine, xyz[i, 0], xyz[i, 1], slopes)
            square = (away * unit) ** 2
            share = 1.0 / (1.0 + square)
            cost += square * share
            weight = share * share
            for k in range(free):
                row[k] = slopes[groups[k, 0]]
                if groups[k, 1] != groups[k, 0]:
                    row[k] += slopes[groups[k, 1]]
            for k in range(free):
                if row[k] == 0.0:
                    continue
                weighted = weight * row[k]
                vector[k] += weighted * away
                for q in range(k + 1):
                    matrix[k, q] += weighted * row[q]
        if cost > best * (1.0 + 1e-12):
            shrink *= 0.5
            if shrink < 0.05:
                break
        else:
            gain = best - cost
            best, shrink = cost, 1.0
            parameters[:] = trial
            normal[:] = matrix
            right[:] = vector
            if turn > 6 and gain < 1e-6 * count:
                break
            system[:] = normal
            for k in range(free):
                system[k, k] = system[k, k] * 1.0001 + 1e-9
            step[:] = right
            solve_kernel(system, step, free)
        trial[:] = parameters
        for k in range(free):
            trial[groups[k, 0]] += shrink * step[k]
            if groups[k, 1] != groups[k, 0]:
                trial[groups[k, 1]] += shrink * step[k]
    cosine, sine = np.cos(parameters[0]), np.sin(parameters[0])
    for i in range(count):
        height = roof_height_kernel(form, parameters, cosine, sine, xyz[i, 0], xyz[i, 1], slopes)
        residuals[i] = xyz[i, 2] - height
    for k in range(free):
        for q in range(k):
            normal[q, k] = normal[k, q]
    return scale


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
        p = self.parameters
        along, across = self.axes(xy)
        if self.form == PLANE:
            return np.asarray(p[TOP] + p[END_SLOPE] * along - p[LEFT_SLOPE] * across)
        v = across - p[ACROSS]
        drop = np.maximum(p[LEFT_SLOPE] * v, -p[RIGHT_SLOPE] * v)
        if self.form == HIP:
            drop = np.maximum(drop, p[END_SLOPE] * (np.abs(along - p[ALONG]) - p[HALF_RIDGE]))
        return np.asarray(p[TOP] - drop)

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
    """The robust least-squares fit of a form to points (N, 3), from `start` (8,).

    `floor` is the least noise (m); without `turns` the orientation stays as it starts. A fit of fewer than
    `ROUNDS` rounds is a comparison, and its covariance is left at zero.
    """
    local = points - np.array([centre[0], centre[1], 0.0])
    groups = GROUPS[form] if turns else GROUPS[form][GROUPS[form][:, 0] != ANGLE]
    parameters = start.astype(np.float64).copy()
    residuals, normal = np.zeros(len(points)), np.zeros((len(groups), len(groups)))
    scale = float(fit_roof_kernel(form, local, groups, parameters, floor, CUT, rounds, residuals, normal))
    covariance = np.zeros((8, 8))
    if rounds >= ROUNDS:
        covariance = covariance_of(groups, normal, residuals[np.abs(residuals) < CUT * scale])
    return ParametricFit(form, centre, parameters, residuals, covariance, scale)


def covariance_of(
    groups: NDArray[np.int64], normal: NDArray[np.float64], residuals: Values
) -> NDArray[np.float64]:
    """Covariance (8, 8) of the parameters from the normal matrix (k, k) and the explained residuals (M,)."""
    variance = float(residuals @ residuals) / max(len(residuals) - len(groups), 1)
    covariance = np.zeros((8, 8))
    covariance_kernel(groups, normal, variance, covariance)
    return covariance


@kernel
def covariance_kernel(
    groups: NDArray[np.int64],
    normal: NDArray[np.float64],
    variance: float,
    covariance: NDArray[np.float64],
) -> None:
    """Spread `variance` times the inverse of the normal matrix (k, k), scaled first, over (8, 8)."""
    free = len(groups)
    level, column, system = np.zeros(free), np.zeros(free), np.zeros((free, free))
    for k in range(free):
        level[k] = np.sqrt(max(normal[k, k], 1e-12))
    for k in range(free):
        for i in range(free):
            column[i] = 1.0 if i == k else 0.0
            for q in range(free):
                system[i, q] = normal[i, q] / (level[i] * level[q]) + (1e-9 if i == q else 0.0)
        solve_kernel(system, column, free)
        for i in range(free):
            share = column[i] / (level[i] * level[k]) * variance
            for row in range(2):
                for across in range(2):
                    covariance[groups[i, row], groups[k, across]] = share
