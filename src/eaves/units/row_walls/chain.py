"""Walls of one row: all divisions of a chain of steps, and the share of them with each wall."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import kernel
from eaves.model import Values

NEAR = 2
"""Steps within which walls of two divisions agree."""

LEAST = float(np.finfo(np.float64).tiny)
"""Sum where no division is possible, so that shares are finite."""


def chances_of(odds: Values, width_odds: Values, prior: Values) -> Values:
    """The share (S + 1,) of all divisions that have a wall at each step, each as likely as its product.

    `odds` (S + 1,) are the odds of a wall at each step; a unit multiplies them by its `width_odds`
    (U, S + 1), of which one row holds for all units, each row as likely as its `prior` (U,): forward-backward
    sums over all divisions [rabiner1989].
    """
    forward, backward = sums_kernel(odds, width_odds)
    chance = prior @ (forward * backward) / max(float(prior @ forward[:, -1]), LEAST)
    chance[[0, -1]] = 0.0
    return np.asarray(chance)


def likely_walls(chance: Values, least: float) -> tuple[NDArray[np.int64], Values]:
    """The steps (W,) near which divisions agree on a wall, and the share of them (W,), at least `least`.

    A wall stands at the mean of the places that divisions give it.
    """
    left, found = chance.copy(), []
    steps = np.arange(len(chance))
    while len(left) > 2 * NEAR:
        near = np.convolve(left, np.ones(2 * NEAR + 1), "same")
        middle = int(np.argmax(near))
        if near[middle] < least:
            break
        own = np.abs(steps - middle) <= NEAR
        found.append((round(float(steps[own] @ left[own] / near[middle])), min(float(near[middle]), 1.0)))
        left[np.abs(steps - middle) <= 2 * NEAR] = 0.0
    found.sort()
    return np.array([wall for wall, _ in found], np.int64), np.array([sure for _, sure in found])


@kernel
def sums_kernel(odds: Values, width_odds: Values) -> tuple[Values, Values]:
    """For each row of widths (U, S + 1) and each step the sum over all divisions up to it with a wall there,
    and that over all after it, its own odds left out; the first and the last step are walls of odds 1.
    """
    rows, count = width_odds.shape
    forward, backward = np.zeros((rows, count)), np.zeros((rows, count))
    forward[:, 0] = backward[:, count - 1] = 1.0
    for row in range(rows):
        for end in range(1, count):
            for start in range(end):
                forward[row, end] += forward[row, start] * width_odds[row, end - start]
            forward[row, end] *= odds[end] if end < count - 1 else 1.0
        for start in range(count - 2, -1, -1):
            for end in range(start + 1, count):
                own = odds[end] if end < count - 1 else 1.0
                backward[row, start] += width_odds[row, end - start] * own * backward[row, end]
    return forward, backward
