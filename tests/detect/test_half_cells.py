"""Half cells and the cells of four of them: every placement holds every point, in the cell it lies in."""

from __future__ import annotations

import numpy as np
import pytest

from eaves.detect.consensus.half_cells import STEPS, CellsOfFour
from eaves.detect.toolkit.cells import Cells

SIDE = 0.6


@pytest.fixture(scope="module")
def half() -> Cells:
    """Half cells of 300 points, which begin at no whole cell."""
    xyz = np.random.default_rng(3).uniform([-3.1, 1.4, 0.0], [4.2, 6.5, 1.0], (300, 3))
    return Cells.of(xyz, SIDE / 2, margin=4, whole=2)


@pytest.mark.parametrize("step", STEPS)
def test_points_lie_in_the_cell_of_their_half_cell__in_every_placement(
    half: Cells, step: tuple[int, int]
) -> None:
    cells = CellsOfFour.of(half, step)
    down, right = (begin * SIDE / 2 for begin in step)
    assert np.isclose((cells.west - right) / SIDE, round((cells.west - right) / SIDE))
    assert np.isclose((cells.north + down) / SIDE, round((cells.north + down) / SIDE))
    some = np.flatnonzero(cells.count)
    assert cells.count.sum() == 300
    which, points = cells.points_of(some)
    assert sorted(points) == list(range(300))
    assert (cells.of_half.ravel()[half.cell[points]] == some[which]).all()
    middle = cells.centres(some[which]) - half.centres(half.cell[points])
    assert np.allclose(np.abs(middle), SIDE / 4)
    east, north = cells.off_middle
    row, column = np.divmod(half.cell[points], half.shape[1])
    assert np.allclose(middle, -np.c_[east[column], north[row]])


@pytest.mark.parametrize("step", STEPS)
def test_a_cell_has_the_sum_and_the_highest_of_its_half_cells(half: Cells, step: tuple[int, int]) -> None:
    cells = CellsOfFour.of(half, step)
    values = np.random.default_rng(4).normal(size=half.shape) * (half.count > 0).reshape(half.shape)
    assert np.allclose(
        cells.sum(values).ravel(), np.bincount(cells.of_half.ravel(), values.ravel(), cells.size)
    )
    highest = np.full(cells.size, -np.inf)
    np.maximum.at(highest, cells.of_half.ravel(), values.ravel())
    inside = np.flatnonzero(cells.count)
    assert (cells.highest(values).ravel()[inside] == highest[inside]).all()
