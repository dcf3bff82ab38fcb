"""Shift of one epoch against the other, in plan and height, from ground and roofs that are the same in both.

A point p of the old epoch on a plane of slopes a, b and the new epoch's point beside it differ along the
plane's vertical by d. Where nothing changed, d = dz − a·dx − b·dy: ground and flat roofs give dz, slopes to
all sides give dx and dy. What changed are outliers, and are trimmed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eaves.flow import FEWEST
from eaves.model import Values

TRIM = 3.0
"""Robust standard deviations beyond which pairs are taken for changes."""

ROUNDS = 8
"""Rounds of trimming and fitting; they settle after three or four."""

SPREAD = 0.05
"""Where slopes scatter less (a town of flat roofs), the ridge holds dx and dy near 0."""


@dataclass(frozen=True)
class Shift:
    """The new epoch's place against the old one's (m), the pairs' robust spread (m), and their number."""

    east: float
    north: float
    up: float
    noise: float
    pairs: int

    @property
    def vector(self) -> NDArray[np.float64]:
        """East, north, up (3,)."""
        return np.array([self.east, self.north, self.up])


def robust_spread(values: Values) -> float:
    """1.4826 times the median distance from the median: the standard deviation of what has no outliers."""
    return float(1.4826 * np.median(np.abs(values - np.median(values)))) if len(values) else 0.0


def fit_shift(slope: NDArray[np.float64], distance: Values) -> Shift:
    """The shift of pairs with slopes (N, 2) and vertical distances (N,)."""
    known = np.isfinite(distance)
    slope, distance = slope[known], distance[known]
    if len(distance) < FEWEST:
        return Shift(0.0, 0.0, 0.0, 0.0, len(distance))
    steepness = np.sqrt(1.0 + (slope**2).sum(axis=1))
    columns = np.column_stack([-slope, np.ones(len(slope))])
    place, ridge = np.array([0.0, 0.0, np.median(distance)]), np.diag([SPREAD**2, SPREAD**2, 0.0])
    for _ in range(ROUNDS):
        left = (distance - columns @ place) / steepness
        kept = np.abs(left) <= TRIM * max(robust_spread(left), 0.01)
        some = columns[kept]
        place = np.linalg.solve(some.T @ some + len(some) * ridge, some.T @ distance[kept])
    east, north, up = map(float, place)
    return Shift(east, north, up, robust_spread(left[kept]), int(kept.sum()))
