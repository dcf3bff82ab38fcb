"""Where the walls of one row are: the best division of a chain of steps, and how sure each wall is."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from eaves.model import Values

NEAR = 2
"""Divisions with a wall within so many steps agree on it."""


def best_walls(odds: Values, width_odds: Values) -> tuple[NDArray[np.int64], Values]:
    """The steps (W,) at which the best division has its walls, and the probability of a wall near each (W,).

    `odds` (S + 1,) are the odds of a wall at each step, `width_odds` (S + 1,) what a unit of so many steps
    multiplies them by. The division with the greatest product is found by dynamic programming, the
    probabilities by the forward-backward sums over all divisions [rabiner1989].
    """
    before = best_kernel(np.log(odds), np.log(np.maximum(width_odds, 1e-300)))
    walls = []
    step = int(before[-1])
    while step > 0:
        walls.append(step)
        step = int(before[step])
    found = np.array(walls[::-1], np.int64)
    if len(found) == 0:
        return found, np.zeros(0)
    forward = forward_kernel(odds, width_odds)
    backward = forward_kernel(odds[::-1].copy(), width_odds)[::-1]
    # an inner step counts its own odds in both directions
    chance = forward * backward / odds / forward[-1]
    chance[[0, -1]] = 0.0
    sums = np.concatenate([[0.0], np.cumsum(chance)])
    low, high = np.maximum(found - NEAR, 0), np.minimum(found + NEAR + 1, len(chance))
    return found, np.minimum(sums[high] - sums[low], 1.0)


def total_of(odds: Values, width_odds: Values) -> float:
    """Logarithm of the sum over all divisions of their products."""
    return float(np.log(forward_kernel(odds, width_odds)[-1]))


@njit(cache=True)
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


@njit(cache=True)
def best_kernel(log_odds: Values, log_width: Values) -> NDArray[np.int64]:
    """For each step the wall before it in the best division that has a wall there."""
    count = len(log_odds)
    best = np.full(count, -np.inf)
    before = np.zeros(count, np.int64)
    best[0] = 0.0
    for end in range(1, count):
        for start in range(end):
            score = best[start] + log_width[end - start]
            if score > best[end]:
                best[end], before[end] = score, start
        if end < count - 1:
            best[end] += log_odds[end]
    return before
