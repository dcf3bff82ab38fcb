"""The signs of a party wall along a line across a row, in the points on both sides of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.detect.toolkit.cells import Cells
from eaves.detect.toolkit.plane_moments import fit_planes, sums_of
from eaves.geometry.planes import CALM_QUANTILE, measure_noise
from eaves.kernels import kernel
from eaves.model import Mask, Points
from eaves.units.row_walls.rows import CELL_M, HouseRow

DEPTH_STEP_M = 1.0
"""Points are compared across a wall at each metre of its length."""

WINDOW_M = 2.0
"""Width of the ground on either side that is compared: half of a narrow house."""

FEWEST = 3
"""Fewer points on one side of a metre say nothing of it."""

WIDE = 3
"""Steps left out beside a wall where the points next to it lie on no plane: gutters, shadows."""

CROSSING_M = 0.6
"""Planes that cross this near (m) to a place meet there in a fold and make no step."""

LEAST_SPREAD = 0.015
"""Points whose variance along a direction (m²) is less show no slope along it."""

PATCH_M = 1.5
"""Side of the squares in which the noise of the roofs is measured: most of them lie on one plane."""

PATCH_POINTS = 6
"""Squares with fewer points do not measure it."""

USUAL_NOISE_M = 0.03
"""Noise of the scans that the weights were learned on. Roofs of tiles and gutters are no flatter: a scan of
less noise is judged as one of this, and so is one that no square has points enough to measure.
"""


def roof_noise(points: Points) -> float:
    """Standard deviation (m) in height of points (N, 3) about their roofs, from planes in small squares; at
    least `USUAL_NOISE_M`.
    """
    cells = Cells.of(points, PATCH_M, margin=0)
    full = np.flatnonzero(cells.count >= PATCH_POINTS)
    if not len(full):
        return USUAL_NOISE_M
    local = points - np.floor(points.min(axis=0))
    _, normal, rmse = fit_planes(sums_of(local, cells.cell, cells.size)[full])
    measured = measure_noise((rmse / normal[:, 2]) ** 2, cells.count[full], CALM_QUANTILE)
    return max(measured, USUAL_NOISE_M)


def wall_signs(row: HouseRow, points: Points, noise: float) -> NDArray[np.float64]:
    """The signs (S + 1, 3) of a wall at each step along the row, from its roof points (N, 3): the share
    of its depth that steps, the mean folds (slopes) of valleys and of ridges."""
    s, t = row.coordinates(points[:, :2])
    step = np.floor(s / CELL_M).astype(np.int64)
    inside = (step >= 0) & (step < len(row.first))
    inside[inside] &= (t[inside] >= row.first[step[inside]]) & (t[inside] < row.last[step[inside]])
    used = row.last > row.first
    low = float(row.first[used].min())
    depths = int((row.last.max() - low) / DEPTH_STEP_M) + 1
    line = ((t[inside] - low) / DEPTH_STEP_M).astype(np.int64)
    middle = t[inside] - low - (line + 0.5) * DEPTH_STEP_M
    moments = moments_kernel(s[inside], middle, points[inside, 2], line, step[inside], depths, len(row.first))
    ground = (low + (np.arange(depths)[:, None] + 0.5) * DEPTH_STEP_M >= row.first) & (
        low + (np.arange(depths)[:, None] + 0.5) * DEPTH_STEP_M < row.last
    )
    return np.asarray(signs_kernel(moments, ground, round(WINDOW_M / CELL_M), CELL_M, noise))


WEIGHTS = {"one": -4.96, "share": 6.33, "ridge": -7.97, "full valley": 4.7}
"""Of the traits in the log-odds of a wall; learned by `python -m benchmarks.accuracy.unit_weights`."""


def wall_odds(signs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Log-odds (S + 1,) of a party wall from its signs (S + 1, 3), by logistic regression."""
    return np.asarray(traits_of(signs) @ np.array(list(WEIGHTS.values())))


def traits_of(signs: NDArray[np.float64]) -> NDArray[np.float64]:
    """The columns (S + 1, K) that `WEIGHTS` weigh."""
    share, valley, ridge = signs.T
    full = np.clip(2.0 * valley - 0.5, 0.0, 1.0)
    return np.column_stack([np.ones(len(signs)), share, np.minimum(ridge, 0.6), full])


@kernel
def moments_kernel(
    s: NDArray[np.float64],
    t: NDArray[np.float64],
    z: NDArray[np.float64],
    line: NDArray[np.int64],
    step: NDArray[np.int64],
    depths: int,
    steps: int,
) -> NDArray[np.float64]:
    """Running sums (D, S + 1, 10) of 1, s, t, s², s t, t², z, s z, t z, z² along each of D lines of S steps.

    t counts from the middle of the line.
    """
    sums = np.zeros((depths, steps + 1, 10))
    for k in range(len(s)):
        own = sums[line[k], step[k] + 1]
        own[0] += 1.0
        own[1] += s[k]
        own[2] += t[k]
        own[3] += s[k] * s[k]
        own[4] += s[k] * t[k]
        own[5] += t[k] * t[k]
        own[6] += z[k]
        own[7] += s[k] * z[k]
        own[8] += t[k] * z[k]
        own[9] += z[k] * z[k]
    for i in range(depths):
        for j in range(steps):
            for m in range(10):
                sums[i, j + 1, m] += sums[i, j, m]
    return sums


@kernel
def side_kernel(
    sums: NDArray[np.float64], at: int, way: int, room: int, place: float, noise: float
) -> tuple[bool, float, float, float]:
    """Whether the points beside step `at` of a line (`sums` (S + 1, 10)), on the side `way`, lie on a plane;
    how many they are, the height of that plane at `place` in the middle of the line, its slope along the row.

    The widest of three windows in which they do is taken, at most `room` steps wide.
    """
    n = 0.0
    for share in (4, 2, 1):
        width = room * share // 4
        low, high = (at - width, at) if way < 0 else (at, at + width)
        low, high = max(low, 0), min(high, len(sums) - 1)
        if low >= high:
            return False, 0.0, 0.0, 0.0
        q = sums[high] - sums[low]
        n = q[0]
        if n < FEWEST:
            return False, n, 0.0, 0.0
        s, t, z = q[1] / n, q[2] / n, q[6] / n
        ss, st, tt = q[3] / n - s * s, q[4] / n - s * t, q[5] / n - t * t
        sz, tz, zz = q[7] / n - s * z, q[8] / n - t * z, q[9] / n - z * z
        whole = ss * tt - st * st
        slope, rise = 0.0, 0.0
        if n > FEWEST and ss > LEAST_SPREAD and tt > LEAST_SPREAD and whole > 0.1 * ss * tt:
            slope = (sz * tt - tz * st) / whole
            rise = (tz * ss - sz * st) / whole
        elif tt > LEAST_SPREAD:
            rise = tz / tt
        left = zz - slope * sz - rise * tz
        if left < noise * noise:
            return True, n, z + slope * (place - s) - rise * t, slope
    return False, n, 0.0, 0.0


@kernel
def signs_kernel(
    sums: NDArray[np.float64],
    ground: Mask,
    window: int,
    cell: float,
    noise: float,
) -> NDArray[np.float64]:
    """The signs at each of S + 1 steps; see `wall_signs`."""
    depths, steps = ground.shape
    signs = np.zeros((steps + 1, 3))
    straight = 2.0 * noise + 0.03
    for j in range(1, steps):
        place = j * cell
        both = 0
        for i in range(depths):
            if not (ground[i, j - 1] and ground[i, j]):
                continue
            good, n, before, rise = side_kernel(sums[i], j - 1, -1, window, place, straight)
            fine, m, after, fall = side_kernel(sums[i], j + 1, 1, window, place, straight)
            if not good:
                good, n, before, rise = side_kernel(sums[i], j - WIDE, -1, window, place, straight)
            if not fine:
                fine, m, after, fall = side_kernel(sums[i], j + WIDE, 1, window, place, straight)
            if not (good and fine):
                continue
            both += 1
            jump = abs(after - before)
            if jump < CROSSING_M * abs(fall - rise):
                jump = 0.0
            if jump > max(3.0 * noise * np.sqrt(4.0 / n + 4.0 / m), 0.08):
                signs[j, 0] += 1.0
            fold = min(max(fall - rise, -1.5), 1.5)
            if jump < 0.5:
                if fold > 0.0:
                    signs[j, 1] += fold
                else:
                    signs[j, 2] -= fold
        signs[j] /= max(both, 1)
    return signs
