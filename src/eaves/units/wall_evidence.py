"""What the points on both sides of a line across a row say of a party wall along it."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from eaves.model import Mask, Points
from eaves.units.rows import CELL_M, Row

DEPTH_STEP_M = 1.0
"""Points are compared across a wall at each metre of its length."""

WINDOW_M = 2.0
"""Width of the ground on either side that is compared: half of a narrow house."""

STRIP_M = 0.5
"""What stands over the roof within this distance of the wall stands on it."""

FEWEST = 3
"""Fewer points on one side of a metre say nothing of it."""

SIGNS = (
    "step",
    "stepped share",
    "valley",
    "ridge",
    "parapet",
    "chimney",
    "depth change",
    "one-sided share",
    "change of slope",
    "rough share",
)
COLUMNS = 10
"""The columns of `wall_signs`."""


def wall_signs(row: Row, points: Points, noise: float) -> NDArray[np.float64]:
    """The signs (S + 1, 10) of a wall at each step along the row, from its roof points (N, 3)."""
    s, t = row.coordinates(points[:, :2])
    step = np.floor(s / CELL_M).astype(np.int64)
    inside = (step >= 0) & (step < len(row.first))
    inside[inside] &= (t[inside] >= row.first[step[inside]]) & (t[inside] < row.last[step[inside]])
    used = row.last > row.first
    low = float(row.first[used].min())
    depths = int((row.last.max() - low) / DEPTH_STEP_M) + 1
    line = ((t[inside] - low) / DEPTH_STEP_M).astype(np.int64)
    moments = moments_kernel(s[inside], points[inside, 2], line, step[inside], depths, len(row.first))
    ground = (low + (np.arange(depths)[:, None] + 0.5) * DEPTH_STEP_M >= row.first) & (
        low + (np.arange(depths)[:, None] + 0.5) * DEPTH_STEP_M < row.last
    )
    window, strip = int(round(WINDOW_M / CELL_M)), int(round(STRIP_M / CELL_M))
    return np.asarray(signs_kernel(moments, ground, row.first, row.last, window, strip, CELL_M, noise))


WEIGHTS = {
    "one": -4.13,
    "share": 6.62,
    "step": 2.93,
    "root": -4.08,
    "valley": -1.71,
    "ridge": -14.83,
    "parapet": 5.64,
    "depth": 0.36,
    "lone": 1.27,
    "rough": 0.8,
    "rough share": -3.34,
}


def wall_odds(signs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Log-odds (S + 1,) of a party wall from its signs (S + 1, 10), by logistic regression."""
    return traits_of(signs) @ np.array(list(WEIGHTS.values()))


def traits_of(signs: NDArray[np.float64]) -> NDArray[np.float64]:
    """The columns (S + 1, K) that `WEIGHTS` weigh."""
    step, share, valley, ridge, parapet, _, depth, lone, _, rough = signs.T
    return np.column_stack(
        [
            np.ones(len(signs)),
            share,
            step,
            np.sqrt(step),
            np.minimum(valley, 0.6),
            np.minimum(ridge, 0.6),
            np.minimum(parapet, 0.3),
            np.minimum(depth, 1.5),
            np.minimum(lone, 0.3),
            rough,
            rough * share,
        ]
    )


@njit(cache=True)
def moments_kernel(
    s: NDArray[np.float64],
    z: NDArray[np.float64],
    line: NDArray[np.int64],
    step: NDArray[np.int64],
    depths: int,
    steps: int,
) -> NDArray[np.float64]:
    """Running sums (6, D, S + 1) of 1, s, s², z, s z, z² along each of D lines of S steps."""
    sums = np.zeros((6, depths, steps + 1))
    for k in range(len(s)):
        i, j = line[k], step[k] + 1
        sums[0, i, j] += 1.0
        sums[1, i, j] += s[k]
        sums[2, i, j] += s[k] * s[k]
        sums[3, i, j] += z[k]
        sums[4, i, j] += s[k] * z[k]
        sums[5, i, j] += z[k] * z[k]
    for m in range(6):
        for i in range(depths):
            for j in range(steps):
                sums[m, i, j + 1] += sums[m, i, j]
    return sums


@njit(cache=True)
def side_kernel(
    sums: NDArray[np.float64], line: int, at: int, way: int, room: int, place: float, noise: float
) -> tuple[bool, float, float, float]:
    """Whether the points beside step `at` of a line, on the side `way`, lie on a straight line; how many they
    are, the height of that line at `place`, and its slope.

    The widest of three windows in which they do is taken, at most `room` steps wide.
    """
    for share in (4, 2, 1):
        width = room * share // 4
        low, high = (at - width, at) if way < 0 else (at, at + width)
        low, high = max(low, 0), min(high, sums.shape[2] - 1)
        if low >= high:
            return False, 0.0, 0.0, 0.0
        n = sums[0, line, high] - sums[0, line, low]
        if n < FEWEST:
            return False, n, 0.0, 0.0
        s1 = sums[1, line, high] - sums[1, line, low]
        s2 = sums[2, line, high] - sums[2, line, low]
        z1 = sums[3, line, high] - sums[3, line, low]
        sz = sums[4, line, high] - sums[4, line, low]
        z2 = sums[5, line, high] - sums[5, line, low]
        mean = s1 / n
        spread = s2 / n - mean * mean
        slope = 0.0
        if spread > 0.02:
            slope = (sz / n - mean * z1 / n) / spread
        left = z2 / n - (z1 / n) ** 2 - slope * slope * spread
        if left < noise * noise:
            return True, n, z1 / n + slope * (place - mean), slope
    return False, n, 0.0, 0.0


@njit(cache=True)
def signs_kernel(
    sums: NDArray[np.float64],
    ground: Mask,
    first: NDArray[np.float64],
    last: NDArray[np.float64],
    window: int,
    strip: int,
    cell: float,
    noise: float,
) -> NDArray[np.float64]:
    """The signs at each of S + 1 steps; see `wall_signs`."""
    depths, steps = ground.shape
    signs = np.zeros((steps + 1, COLUMNS))
    straight = 2.0 * noise + 0.03
    for j in range(1, steps):
        place = j * cell
        both, lone, rough = 0, 0, 0
        for i in range(depths):
            left, right = ground[i, j - 1], ground[i, j]
            if left != right:
                lone += 1
            if not (left and right):
                continue
            good, n, before, rise = side_kernel(sums, i, j - 1, -1, window, place, straight)
            fine, m, after, fall = side_kernel(sums, i, j + 1, 1, window, place, straight)
            if n < FEWEST or m < FEWEST:
                continue
            if not (good and fine):
                rough += 1
                continue
            both += 1
            jump = abs(after - before)
            doubt = 3.0 * noise * np.sqrt(4.0 / n + 4.0 / m)
            if jump > max(doubt, 0.08):
                signs[j, 0] += min(jump, 1.0)
                signs[j, 1] += 1.0
            fold = min(max(fall - rise, -1.5), 1.5)
            if jump < 0.5:
                if fold > 0.0:
                    signs[j, 2] += fold
                else:
                    signs[j, 3] -= fold
            signs[j, 8] += min(abs(fall - rise), 1.0)
            good, n, before, _ = side_kernel(sums, i, j - strip, -1, window, place, straight)
            fine, m, after, _ = side_kernel(sums, i, j + strip, 1, window, place, straight)
            half = strip // 2
            if good and fine and j >= strip and j + strip <= steps:
                k = sums[0, i, j + half] - sums[0, i, j - half]
                if k >= 1:
                    top = (sums[3, i, j + half] - sums[3, i, j - half]) / k
                    over = top - max(before, after)
                    if over > max(0.15, 3.0 * noise):
                        signs[j, 4] += 1.0
                    if over > 0.4:
                        signs[j, 5] += 1.0
        if both:
            for c in (0, 1, 2, 3, 4, 8):
                signs[j, c] /= both
            signs[j, 5] = min(signs[j, 5], 2.0)
        signs[j, 7] = lone / max(both + rough + lone, 1)
        signs[j, 6] = min(abs(first[j] - first[j - 1]), 2.0) + min(abs(last[j] - last[j - 1]), 2.0)
        signs[j, 9] = rough / max(both + rough, 1)
    return signs
