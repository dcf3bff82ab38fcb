"""Quantiles of values, and of many groups of values at once, to the bit as numpy has them, for less."""

from __future__ import annotations

import numpy as np

from eaves.model import Integers, Labels, Values


def quantile(values: Values, share: float) -> float:
    """The quantile of values (N,), N ≥ 1, none of them NaN, as `numpy.quantile` has it."""
    last = len(values) - 1
    place = last * share
    low = int(place)
    places = [low, min(low + 1, last)]
    before, after = map(float, np.partition(values, places)[places])
    step, part = after - before, place - low
    return before + step * part if part < 0.5 else after - step * (1.0 - part)


def median(values: Values | Integers) -> float:
    """The median of values (N,), N ≥ 1, none of them NaN, as `numpy.median` has it."""
    middles = [(len(values) - 1) // 2, len(values) // 2]
    below, above = np.partition(values, middles)[middles]
    return float(below + above) / 2.0


def group_percentiles(values: Values, group: Labels | Integers, count: int, percent: float) -> Values:
    """The percentile (G,) of the values (N,) of each of `count` groups; NaN for a group without any.

    Between two values it is linear, to the bit as `numpy.percentile` is. Values of group -1 are left out.
    """
    # one after the other, and in sixteen bits by radix: to sort by both at once takes five times as long
    order = np.argsort(values)
    few = np.int16 if count < np.iinfo(np.int16).max else np.int64
    order = order[np.argsort(group[order].astype(few), kind="stable")]
    ordered = values[order]
    first = np.searchsorted(group[order], np.arange(count + 1))
    size = np.diff(first)
    last = np.maximum(size - 1, 0)
    place = last * (percent / 100.0)
    low = np.floor(place).astype(np.int64)
    filled = size > 0
    percentiles = np.full(count, np.nan)
    before = ordered[(first[:-1] + low)[filled]]
    after = ordered[(first[:-1] + np.minimum(low + 1, last))[filled]]
    percentiles[filled] = between(before, after, (place - low)[filled])
    return percentiles


def column_percentiles(values: Values, percents: tuple[float, ...]) -> Values:
    """The percentiles (P, K) of each column of values (N, K), N ≥ 1; to the bit as `numpy.percentile` has
    them.
    """
    ordered = np.sort(values, axis=0)
    last = len(ordered) - 1
    rows = []
    for percent in percents:
        place = last * (percent / 100.0)
        low = int(place)
        rows.append(between(ordered[low], ordered[min(low + 1, last)], place - low))
    return np.array(rows)


def between(before: Values, after: Values, share: Values | float) -> Values:
    """The values (K,) at a share of the way from some to others, from the nearer end: as numpy has them."""
    step = after - before
    return np.where(share < 0.5, before + step * share, after - step * (1.0 - share))
