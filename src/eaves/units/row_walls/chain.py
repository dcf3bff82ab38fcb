"""Where the walls of one row are: the best division of a chain of steps, and how sure each wall is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import kernel
from eaves.model import Values

NEAR = 2
"""Divisions with a wall within so many steps agree on it."""

LEAST = float(np.finfo(np.float64).tiny)
"""The impossible is this likely, so that its logarithm is finite."""


def best_walls(odds: Values, width_odds: Values) -> tuple[NDArray[np.int64], Values]:
    """The steps (W,) at which the best division has its walls, and the probability of a wall near each (W,).

    `odds` (S + 1,) are the odds of a wall at each step; a unit multiplies them by its `width_odds` (S + 1,).
    The division with the greatest product is found by dynamic programming, the probabilities by the
    forward-backward sums over all divisions [rabiner1989].
    """
    before = best_kernel(odds, width_odds)
    walls = []
    step = int(before[-1])
    while step > 0:
        walls.append(step)
        step = int(before[step])
    found = np.array(walls[::-1], np.int64)
    if len(found) == 0:
        return found, np.zeros(0)
    forward = forward_kernel(odds, width_odds)
    chance = forward * backward_kernel(odds, width_odds) / forward[-1]
    chance[[0, -1]] = 0.0
    sums = np.concatenate([[0.0], np.cumsum(chance)])
    low, high = np.maximum(found - NEAR, 0), np.minimum(found + NEAR + 1, len(chance))
    return found, np.minimum(sums[high] - sums[low], 1.0)


def total_of(odds: Values, width_odds: Values) -> float:
    """Logarithm of the sum over all divisions of their products."""
    return float(np.log(max(forward_kernel(odds, width_odds)[-1], LEAST)))


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


@kernel
def best_kernel(odds: Values, width_odds: Values) -> NDArray[np.int64]:
    """For each step the wall before it in the best division that has a wall there."""
    count = len(odds)
    best = np.full(count, -np.inf)
    before = np.zeros(count, np.int64)
    best[0] = 0.0
    for end in range(1, count):
        for start in range(end):
            unit = width_odds[end - start]
            score = best[start] + np.log(max(unit, LEAST))
            if score > best[end]:
                best[end], before[end] = score, start
        if end < count - 1:
            best[end] += np.log(odds[end])
    return before
