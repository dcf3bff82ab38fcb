"""The lowest and highest values in squares about each cell, against the plain search."""

from __future__ import annotations

import numpy as np
import pytest

from eaves.raster.grid import highest_in_squares, lowest_in_squares


@pytest.mark.parametrize("radius", [0, 1, 2, 7, 8, 31])
@pytest.mark.parametrize("shape", [(1, 1), (3, 40), (50, 47)])
def test_squares_are_searched_to_the_rim(radius: int, shape: tuple[int, int]) -> None:
    values = np.random.default_rng(radius).normal(size=shape).astype(np.float32)
    lowest, highest = lowest_in_squares(values, radius), highest_in_squares(values, radius)
    for row, column in np.ndindex(shape):
        square = values[
            max(0, row - radius) : row + radius + 1, max(0, column - radius) : column + radius + 1
        ]
        assert lowest[row, column] == square.min()
        assert highest[row, column] == square.max()


def test_values_without_bounds_are_compared_too() -> None:
    values = np.array([[np.inf, 1.0, np.inf, np.inf, -np.inf]], np.float32)
    assert lowest_in_squares(values, 1).tolist() == [[1.0, 1.0, 1.0, -np.inf, -np.inf]]
