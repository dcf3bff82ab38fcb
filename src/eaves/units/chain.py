"""Where the walls of one row are: the best division of a chain of steps, and how sure each wall is."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from eaves.model import Values


def best_walls(odds: Values, width_score: Values) -> tuple[NDArray[np.int64], Values]:
    """The steps (W,) at which the best division has its walls, and the probability of a wall near each (W,).

    `odds` (S + 1,) are the log-odds of a wall at each step, `width_score` (M + 1,) what a unit of so many
    steps adds; wider ones add its last value. The division with the greatest sum is found by dynamic
    programming, the probabilities by the forward-backward sums over all divisions.
    """
    best, before, total = forward_kernel(odds, width_score)
    walls = []
    step = int(before[-1])
    while step > 0:
        walls.append(step)
        step = int(before[step])
    found = np.array(walls[::-1], np.int64)
    if len(found) == 0:
        return found, np.zeros(0)
    _, _, backward = forward_kernel(odds[::-1].copy(), width_score)
    # an inner step counts its own odds in both directions
    at = total + backward[::-1] - odds - total[-1]
    chance = np.exp(np.minimum(at, 0.0))
    chance[[0, -1]] = 0.0
    sums = np.concatenate([[0.0], np.cumsum(chance)])
    low, high = np.maximum(found - NEAR, 0), np.minimum(found + NEAR + 1, len(chance))
    return found, np.minimum(sums[high] - sums[low], 1.0)


def log_sum(odds: Values, width_score: Values) -> float:
    """Logarithm of the sum over all divisions of the exponentials of their scores."""
    return float(forward_kernel(odds, width_score)[2][-1])


NEAR = 2
"""Divisions with a wall within so many steps agree on it."""


@njit(cache=True)
def forward_kernel(odds: Values, width_score: Values) -> tuple[Values, NDArray[np.int64], Values]:
    """For each step the best score of a division that has a wall there, the wall before it, and the logarithm
    of the sum of the exponentials of all scores; the first and the last step are walls of no odds.
    """
    count, widest = len(odds), len(width_score) - 1
    best = np.full(count, -np.inf)
    total = np.full(count, -np.inf)
    before = np.zeros(count, np.int64)
    best[0] = total[0] = 0.0
    for end in range(1, count):
        own = odds[end] if end < count - 1 else 0.0
        if own < -8.0:
            continue
        top = -np.inf
        for start in range(end):
            score = width_score[min(end - start, widest)]
            if best[start] + score > best[end]:
                best[end], before[end] = best[start] + score, start
            top = max(top, total[start] + score)
        if top == -np.inf:
            continue
        rest = 0.0
        for start in range(end):
            rest += np.exp(total[start] + width_score[min(end - start, widest)] - top)
        best[end] += own
        total[end] = top + np.log(rest) + own
    return best, before, total
