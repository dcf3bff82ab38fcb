"""Extent of a set of points: the edge just beyond its outermost points."""

from __future__ import annotations

import numpy as np

from eaves.kernels import kernel
from eaves.model import Values

STRAY = 6.0
"""A point outside the edge costs as much as a gap in which six points were to be expected."""

MOST_STRAYS = 0.05
"""Share of the points that may lie outside each edge."""


@kernel
def extent_kernel(ordered: Values) -> tuple[float, float, float]:
    """Low and high edge of ordered values (N,), and the standard deviation of each.

    Of uniformly spread points with strays the likeliest edges are sought: n·ln(high − low) plus the strays'
    cost. Beyond the last point the edge is as far as a place at random is from the next point, Σg² / 2Σg
    for gaps g, which is right for random points and for scan lines alike [cox1962].
    """
    count = len(ordered)
    reach = int(MOST_STRAYS * count)
    low, high = 0, count - 1
    for _ in range(2):
        best = np.inf
        for i in range(reach + 1):
            span = ordered[high] - ordered[i]
            if span <= 0.0:
                break
            cost = STRAY * i + count * np.log(span)
            if cost < best:
                best, low = cost, i
        best = np.inf
        for i in range(reach + 1):
            span = ordered[count - 1 - i] - ordered[low]
            if span <= 0.0:
                break
            cost = STRAY * i + count * np.log(span)
            if cost < best:
                best, high = cost, count - 1 - i
    first, second, third = 0.0, 0.0, 0.0
    for i in range(low, high):
        gap = ordered[i + 1] - ordered[i]
        first += gap
        second += gap * gap
        third += gap * gap * gap
    beyond, spread = 0.0, 0.0
    if first > 0.0:
        beyond = second / (2.0 * first)
        spread = np.sqrt(max(third / (3.0 * first) - beyond * beyond, 0.0))
    return float(ordered[low] - beyond), float(ordered[high] + beyond), float(spread)


def extent_of(values: Values) -> tuple[float, float, float]:
    """Low and high edge (m) of values (N,), N ≥ 2, and the standard deviation (m) of each."""
    low, high, deviation = extent_kernel(np.sort(values))
    return low, high, deviation
