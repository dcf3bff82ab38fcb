"""The lines along which the heights of a roof jump."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from eaves.model import Mask, Values
from eaves.reconstruct.line import SAME_DIRECTION_DEG, Line, angle_between

WINDOW = 1.2
"""Width, in spacings, of the strip in which border places make one line."""

FEWEST_SAMPLES = 3
"""Border places that make a line."""

MAIN_WEIGHT = 1.3
"""How much more a line along the footprint is trusted than one along a plane's fall."""

MOST_TOGETHER = 2000
"""Places among which lines are sought together; more are divided, which bounds the work."""

LEAST_FALL = 0.1
"""Rise per metre below which a plane has no direction worth following."""


def fall_angles(planes: NDArray[np.float64]) -> Values:
    """Angles (K,) in [0, π) along and across the falls of sloped planes (P, 3), each direction once."""
    steep = planes[np.hypot(planes[:, 0], planes[:, 1]) > LEAST_FALL]
    angles: list[float] = []
    for a, b, _ in steep.tolist():
        for angle in (np.arctan2(b, a), np.arctan2(a, -b)):
            if all(angle_between(angle, other) > np.radians(SAME_DIRECTION_DEG) for other in angles):
                angles.append(float(np.mod(angle, np.pi)))
    return np.array(angles)


def jump_lines(
    places: NDArray[np.float64], weights: Values, main: Values, falls: Values, spacing: float
) -> list[Line]:
    """Lines through the border places (M, 2) where heights jump, best supported first.

    Their angles are those of the footprint, `main` and its perpendiculars, or else those of the planes'
    falls.
    """
    angles = [*main, *(main + np.pi / 2)]
    trust = [MAIN_WEIGHT] * len(angles)
    for angle in falls.tolist():
        if all(angle_between(angle, other) > 2.0 * np.radians(SAME_DIRECTION_DEG) for other in angles):
            angles.append(angle)
            trust.append(1.0)
    normals = np.column_stack([-np.sin(angles), np.cos(angles)])
    lines: list[Line] = []
    for part in divide(places):
        lines += strongest_lines(places[part], weights[part], normals, np.array(trust), spacing)
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
    places: NDArray[np.float64], weights: Values, normals: NDArray[np.float64], trust: Values, spacing: float
) -> list[Line]:
    """Lines across `normals` (A, 2) through places (M, 2), again and again the strip with most weight in it.

    `trust` (A,) multiplies the weight of each direction.
    """
    lines: list[Line] = []
    width, gap = max(WINDOW * spacing, 0.25), max(2.5 * spacing, 0.8)
    shortest = max(2.0 * spacing, 0.6)
    offsets = normals @ places.T
    order = np.argsort(offsets, axis=1, kind="stable")
    columns = np.take_along_axis(offsets, order, axis=1)
    left = np.ones(len(places), bool)
    while left.sum() >= FEWEST_SAMPLES:
        best, start = strongest_strip_kernel(columns, order, weights, left, trust, width)
        first = columns[best, start]
        strip = order[best, start : np.searchsorted(columns[best], first + width, side="right")]
        near = np.sort(strip[left[strip]])
        nx, ny = normals[best].tolist()
        along = places[near] @ np.array([-ny, nx])
        turn = np.argsort(along, kind="stable")
        near, along = near[turn], along[turn]
        stretch = np.split(np.arange(len(near)), np.flatnonzero(np.diff(along) > gap) + 1)
        longest = max(stretch, key=lambda some: float(weights[near[some]].sum()))
        low, high = float(along[longest[0]]), float(along[longest[-1]])
        if len(longest) >= FEWEST_SAMPLES and high - low >= shortest:
            middle = float(np.median(offsets[best, near[longest]]))
            lines.append(Line((nx, ny), middle, low, high, float(weights[near[longest]].sum()), False))
        left[near[longest]] = False
        if 2 * left.sum() < order.shape[1]:
            stays = left[order]
            order = order[stays].reshape(len(normals), -1)
            columns = columns[stays].reshape(len(normals), -1)
    return lines


@njit(cache=True)
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
