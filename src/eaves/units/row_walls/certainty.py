"""How sure the walls between units are, as a share of walls that are there."""

from __future__ import annotations

import numpy as np

MOST_ODDS = 5.0
"""Log-odds further from 0 are as sure as these."""

OF_ROWS = (0.91, 0.34)
OF_BORDERS = (-0.66, 0.72)
"""Log-odds that a wall is there: a + b · log-odds found; learned on the walls of the towns that the weights
were learned on, by `python -m benchmarks.accuracy.unit_weights`.
"""


def sure_in_row(chance: float) -> float:
    """The calibrated probability of a wall in a row, from that among all divisions of the row."""
    with np.errstate(divide="ignore"):
        return calibrated(float(np.log(chance) - np.log1p(-chance)), OF_ROWS)


def sure_on_border(odds: float) -> float:
    """The calibrated probability of a wall on the border of two rows, from its log-odds."""
    return calibrated(odds, OF_BORDERS)


def calibrated(odds: float, line: tuple[float, float]) -> float:
    """The probability at log-odds on a line [platt1999]."""
    held = float(np.clip(odds, -MOST_ODDS, MOST_ODDS))
    return float(1.0 / (1.0 + np.exp(-line[0] - line[1] * held)))
