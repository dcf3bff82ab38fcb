"""Where the walls of one row are: all divisions of a chain of steps, and the share of them with each wall."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import kernel
from eaves.model import Values

NEAR = 2
"""Divisions with a wall within so many steps agree on it."""

LEAST = float(np.finfo(np.float64).tiny)
"""The impossible is this likely, so that its logarithm is finite."""


def chances_of(odds: Values, width_odds: Values) -> tuple[float, Values]:
    """Logarithm of the sum over all divisions of their products, and the share (S + 1,) of it that has a wall
    at each step.

    `odds` (S + 1,) are the odds of a wall at each step; a unit multiplies them by its `width_odds` (S + 1,):
    forward-backward sums over all divisions [rabiner1989].
    """
    forward = forward_kernel(odds, width_odds)
    total = max(forward[-1], LEAST)
    chance = forward * backward_kernel(odds, width_odds) / total
    chance[[0, -1]] = 0.0
    return float(np.log(total)), chance


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
def forward_kernel(odds: Values, width_odds: Values) -> Values:
    """For each step the sum over all divisions up to it that have a wall there; the first and the last
    step are walls of odds 1.
    """
    count = len(odds)
    total = np.zeros(count)
    total[0] = 1.0
    for end in range(1, count):
        own = 0.0
        for start in range(end):
            own += total[start] * width_odds[end - start]
        total[end] = own * odds[end] if end < count - 1 else own
    return total


@kernel
def backward_kernel(odds: Values, width_odds: Values) -> Values:
    """For each step the sum over all divisions after it, its own odds left out."""
    count = len(odds)
    total = np.zeros(count)
    total[count - 1] = 1.0
    for start in range(count - 2, -1, -1):
        for end in range(start + 1, count):
            own = odds[end] if end < count - 1 else 1.0
            total[start] += width_odds[end - start] * own * total[end]
    return total
