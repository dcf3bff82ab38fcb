"""The lines along which the heights of a roof jump."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.geometry.sums import pairwise_sum_kernel
from eaves.kernels import kernel
from eaves.model import Mask, Values
from eaves.reconstruct.toolkit.line import SAME_DIRECTION_DEG, Line, angle_between
from eaves.reconstruct.toolkit.line_limits import LineLimits

FEWEST_SAMPLES = 3
"""Border places that make a line."""

MOST_TOGETHER = 2000
"""Places among which lines are sought together; more are divided, which bounds the work."""


def fall_angles(planes: NDArray[np.float64], least: float) -> Values:
    """Angles (K,) in [0, π) along and across the falls of planes (P, 3) that rise by more than `least` a
    metre, each direction once.
    """
    steep = planes[np.hypot(planes[:, 0], planes[:, 1]) > least]
    angles: list[float] = []
    for a, b, _ in steep.tolist():
        for angle in (np.arctan2(b, a), np.arctan2(a, -b)):
            if all(angle_between(angle, other) > np.radians(SAME_DIRECTION_DEG) for other in angles):
                angles.append(float(np.mod(angle, np.pi)))
    return np.array(angles)


def step_lines(
    places: NDArray[np.float64],
    weights: Values,
    main: Values,
    falls: Values,
    spacing: float,
    limits: LineLimits,
) -> list[Line]:
    """Lines through the border places (M, 2) where heights jump, best supported first.

    Their angles are those of the footprint, `main` and its perpendiculars, or else those of the planes'
    falls.
    """
    angles = [*main, *(main + np.pi / 2)]
    trust = [limits.main_weight] * len(angles)
    for angle in falls.tolist():
        if all(angle_between(angle, other) > 2.0 * np.radians(SAME_DIRECTION_DEG) for other in angles):
            angles.append(angle)
            trust.append(1.0)
    normals = np.column_stack([-np.sin(angles), np.cos(angles)])
    lines: list[Line] = []
    for part in divide(places):
        lines += strongest_lines(
            places[part], weights[part], normals, np.array(trust), spacing, limits.strip_width
        )
    return lines


def divide(places: NDArray[np.float64]) -> list[NDArray[np.int64]]:
    """Numbers of the places (M, 2) in groups of at most `MOST_TOGETHER`, halved across their longer side."""
    waiting, groups = [np.arange(len(places))], []
    while waiting:
        some = waiting.pop()
        if len(some) <= MOST_TOGETHER:
            groups.append(some)
            continue
        axis = int(np.argmax(np.ptp(places[some], axis=0)))
        order = some[np.argsort(places[some, axis], kind="stable")]
        waiting += [order[len(order) // 2 :], order[: len(order) // 2]]
    return groups


def strongest_lines(
    places: NDArray[np.float64],
    weights: Values,
    normals: NDArray[np.float64],
    trust: Values,
    spacing: float,
    strip_width: float,
) -> list[Line]:
    """Lines across `normals` (A, 2) through places (M, 2), again and again the strip with most weight in it.

    `trust` (A,) multiplies the weight of each direction; `strip_width` is in spacings.
    """
    width, gap = max(strip_width * spacing, 0.25), max(2.5 * spacing, 0.8)
    shortest = max(2.0 * spacing, 0.6)
    offsets = normals @ places.T
    order = np.argsort(offsets, axis=1, kind="stable")
    columns = np.take_along_axis(offsets, order, axis=1)
    found = strongest_lines_kernel(places, columns, order, weights, normals, trust, width, gap, shortest)
    direction, first, strip, longest = found
    lines: list[Line] = []
    for line, best in enumerate(direction.tolist()):
        mine = slice(first[line], first[line + 1])
        near = strip[mine][longest[mine]]
        nx, ny = normals[best].tolist()
        along = (places[strip[mine]] @ np.array([-ny, nx]))[longest[mine]]
        near = near[np.argsort(along, kind="stable")]
        middle, support = float(np.median(offsets[best, near])), float(weights[near].sum())
        lines.append(Line((nx, ny), middle, float(along.min()), float(along.max()), support, False))
    return lines


@kernel
def strongest_lines_kernel(
    places: NDArray[np.float64],
    columns: NDArray[np.float64],
    order: NDArray[np.int64],
    weights: Values,
    normals: NDArray[np.float64],
    trust: Values,
    width: float,
    gap: float,
    shortest: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], Mask]:
    """The direction (L,) of each line, and the places in its strip: where they start (L + 1,), their numbers
    (S,), ascending, and whether each belongs to the longest stretch without a `gap` (S,), which is the line.

    `columns` (A, M) are the offsets of the places `order` (A, M) in each direction, ascending; both change.
    Lines of fewer than `FEWEST_SAMPLES` places or shorter than `shortest` only use their places up.
    """
    count = columns.shape[1]
    direction, first = np.empty(count, np.int64), np.zeros(count + 1, np.int64)
    strip, longest = np.empty(count * len(normals), np.int64), np.zeros(count * len(normals), np.bool_)
    left = np.ones(count, np.bool_)
    lines, remaining = 0, count
    while remaining >= FEWEST_SAMPLES:
        best, start = strongest_strip_kernel(
            columns[:, :count], order[:, :count], weights, left, trust, width
        )
        end = np.searchsorted(columns[best, :count], columns[best, start] + width, side="right")
        near = order[best, start:end]
        near = np.sort(near[left[near]])
        nx, ny = normals[best]
        along = np.empty(len(near))
        for one in range(len(near)):
            along[one] = places[near[one], 1] * nx - places[near[one], 0] * ny
        turn = np.argsort(along, kind="mergesort")
        most, low, high, begin = -1.0, 0, 0, 0
        for one in range(1, len(turn) + 1):
            if one == len(turn) or along[turn[one]] - along[turn[one - 1]] > gap:
                total = pairwise_sum_kernel(weights[near[turn[begin:one]]])
                if total > most:
                    most, low, high = total, begin, one
                begin = one
        if high - low >= FEWEST_SAMPLES and along[turn[high - 1]] - along[turn[low]] >= shortest:
            if first[lines] + len(near) > len(strip):
                strip = np.append(strip, np.empty(len(strip) + len(near), np.int64))
                longest = np.append(longest, np.zeros(len(strip), np.bool_))
            direction[lines], first[lines + 1] = best, first[lines] + len(near)
            strip[first[lines] : first[lines + 1]] = near
            longest[first[lines] + turn[low:high]] = True
            lines += 1
        left[near[turn[low:high]]] = False
        remaining -= high - low
        if 2 * remaining < count:
            for number in range(len(normals)):
                kept = 0
                for one in range(count):
                    if left[order[number, one]]:
                        order[number, kept] = order[number, one]
                        columns[number, kept] = columns[number, one]
                        kept += 1
            count = remaining
    used = first[lines]
    return direction[:lines], first[: lines + 1], strip[:used], longest[:used]


@kernel
def strongest_strip_kernel(
    columns: NDArray[np.float64],
    order: NDArray[np.int64],
    weights: Values,
    left: Mask,
    trust: Values,
    width: float,
) -> tuple[int, int]:
    """Direction and position in its column of the first place of the strip with the most weight in it.

    `columns` (A, K) are the offsets of the places `order` (A, K) in each direction, ascending; only those
    still `left` count.
    """
    most, best, start = -1.0, 0, 0
    for number in range(columns.shape[0]):
        total, end = 0.0, 0
        for first in range(columns.shape[1]):
            if not left[order[number, first]]:
                continue
            while end < columns.shape[1] and columns[number, end] <= columns[number, first] + width:
                if left[order[number, end]]:
                    total += weights[order[number, end]]
                end += 1
            if trust[number] * total > most + 1e-9:
                most, best, start = trust[number] * total, number, first
            total -= weights[order[number, first]]
    return best, start
