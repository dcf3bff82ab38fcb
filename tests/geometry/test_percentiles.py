"""Percentiles by group, against numpy's."""

from __future__ import annotations

import numpy as np
import pytest

from eaves.geometry.planes import group_percentiles, median, quantile


@pytest.mark.parametrize("percent", [0.0, 1.0, 50.0, 70.0, 99.0, 100.0])
def test_percentiles_are_those_of_numpy__to_the_bit(percent: float) -> None:
    rng = np.random.default_rng(3)
    group = rng.integers(-1, 40, 700)
    group[group == 7] = 8
    values = rng.normal(size=700)
    found = group_percentiles(values, group, 41, percent)
    for number in range(41):
        mine = values[group == number]
        assert np.isnan(found[number]) if len(mine) == 0 else found[number] == np.percentile(mine, percent)


def test_no_values_have_no_percentile() -> None:
    assert np.isnan(group_percentiles(np.zeros(0), np.zeros(0, np.int64), 2, 50.0)).all()
    assert len(group_percentiles(np.zeros(0), np.zeros(0, np.int64), 0, 50.0)) == 0


@pytest.mark.parametrize("count", [1, 2, 3, 50, 51, 101])
def test_quantiles_and_the_median_are_those_of_numpy__to_the_bit(count: int) -> None:
    values = np.random.default_rng(count).normal(size=count)
    for share in (0.0, 0.12, 0.35, 0.5, 0.7, 1.0):
        assert quantile(values, share) == np.quantile(values, share)
    assert median(values) == np.median(values)
    assert median(np.arange(count)) == np.median(np.arange(count))
