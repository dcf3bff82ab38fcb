"""The lines of strips with most weight."""

from __future__ import annotations

import numpy as np
import pytest

from eaves.geometry.sums import pairwise_sum_kernel
from eaves.reconstruct.toolkit.height_steps import strongest_lines


@pytest.mark.parametrize("count", [0, 1, 7, 8, 9, 100, 128, 129, 1000])
def test_a_sum_is_that_of_numpy__to_the_bit(count: int) -> None:
    values = np.random.default_rng(count).random(count)
    assert pairwise_sum_kernel(values) == values.sum()


def test_two_rows_of_places_give_two_lines__the_longer_first() -> None:
    along = np.linspace(0.0, 5.0, 21)
    places = np.vstack(
        [
            np.column_stack([along, np.full(21, 2.0)]),
            np.column_stack([np.full(11, 8.0), along[:11]]),
            [[20.0, 20.0], [30.0, 30.0]],
        ]
    )
    normals = np.array([[0.0, 1.0], [1.0, 0.0]])
    lines = strongest_lines(places, np.ones(len(places)), normals, np.ones(2), 0.25, 1.2)
    found = [(line.normal, line.offset, line.low, line.high, line.support) for line in lines]
    assert found == [((0.0, 1.0), 2.0, -5.0, 0.0, 21.0), ((1.0, 0.0), 8.0, 0.0, 2.5, 11.0)]


def test_a_row_with_a_gap_is_two_lines() -> None:
    along = np.concatenate([np.linspace(0.0, 3.0, 13), np.linspace(9.0, 11.0, 9)])
    places = np.column_stack([along, np.zeros(len(along))])
    lines = strongest_lines(places, np.ones(len(along)), np.array([[0.0, 1.0]]), np.ones(1), 0.25, 1.2)
    assert [(line.low, line.high) for line in lines] == [(-3.0, 0.0), (-11.0, -9.0)]
