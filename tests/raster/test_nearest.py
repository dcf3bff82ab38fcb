"""The nearest known cell, ties included, against all pairs."""

from __future__ import annotations

import numpy as np
import pytest

from eaves.model import Raster
from eaves.raster.interpolate import fill_nearest, near_cells, nearest_cells


@pytest.mark.parametrize(
    ("rows", "columns", "share"), [(1, 1, 1.0), (1, 30, 0.1), (40, 1, 0.1), (60, 80, 0.01), (50, 50, 0.3)]
)
def test_the_nearest_cell_is_the_westernmost_then_northernmost_of_those_equally_near(
    rows: int, columns: int, share: float
) -> None:
    known = np.random.default_rng(rows).random((rows, columns)) < share
    known[rows // 2, columns // 3] = True
    wanted = np.nonzero(~known | known)
    known_rows, known_columns = np.nonzero(known)
    row, column = nearest_cells(known, *wanted)
    square = (wanted[0][:, None] - known_rows) ** 2 + (wanted[1][:, None] - known_columns) ** 2
    rank = (square * columns + known_columns) * rows + known_rows
    which = np.argmin(rank, axis=1)
    assert (row == known_rows[which]).all()
    assert (column == known_columns[which]).all()


@pytest.mark.parametrize("square", [0, 1, 2, 24, 144])
@pytest.mark.parametrize("share", [0.0, 0.003, 0.1])
def test_near_cells_are_those_within_the_distance(square: int, share: float) -> None:
    known = np.random.default_rng(square).random((40, 55)) < share
    known_rows, known_columns = np.nonzero(known)
    rows, columns = np.nonzero(known | ~known)
    away = (rows[:, None] - known_rows) ** 2 + (columns[:, None] - known_columns) ** 2
    assert np.array_equal(near_cells(known, square).ravel(), (away <= square).any(axis=1))


@pytest.mark.parametrize("within", [0.0, 1.0, 1.6, 2.5])
def test_a_gap_takes_the_value_of_the_nearest_cell_within_the_distance(within: float) -> None:
    values = np.random.default_rng(3).normal(0, 1, (30, 40)).astype(np.float32)
    values[np.random.default_rng(4).random(values.shape) < 0.9] = np.nan
    known = np.isfinite(values)
    rows, columns = np.nonzero(~known)
    row, column = nearest_cells(known, rows, columns)
    near = 0.5 * np.hypot(row - rows, column - columns) <= within
    expected = values.copy()
    expected[rows[near], columns[near]] = values[row, column][near]
    assert np.array_equal(
        fill_nearest(Raster(values, 0.0, 15.0, 0.5), within).values, expected, equal_nan=True
    )
