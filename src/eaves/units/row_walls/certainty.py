"""How sure the walls between units are, as a share of walls that are there."""

from __future__ import annotations

import numpy as np

LEAST_CHANCE, MOST_ODDS = 0.001, 5.0
"""Probabilities nearer to 0 or 1, and log-odds further from 0, are as sure as these."""

OF_ROWS = (0.53, 0.46)
OF_BORDERS = (-0.45, 0.7)
"""Log-odds that a wall is there: a + b · log-odds found; learned on the walls of the towns that the weights
were learned on, by `python -m benchmarks.accuracy.unit_weights`.
"""


def sure_in_row(chance: float) -> float:
    """The calibrated probability of a wall in a row, from that among all divisions of the row."""
    held = float(np.clip(chance, LEAST_CHANCE, 1.0 - LEAST_CHANCE))
    return calibrated(float(np.log(held / (1.0 - held))), OF_ROWS)


def sure_on_border(odds: float) -> float:
    """The calibrated probability of a wall on the border of two rows, from its log-odds."""
    return calibrated(float(np.clip(odds, -MOST_ODDS, MOST_ODDS)), OF_BORDERS)


def calibrated(odds: float, line: tuple[float, float]) -> float:
    """The probability at log-odds on a line [platt1999]."""
    return float(1.0 / (1.0 + np.exp(-line[0] - line[1] * odds)))
