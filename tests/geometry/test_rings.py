"""Areas of rings in the plane, and walks parted into loops."""

import numpy as np
import pytest

from eaves.geometry.rings import signed_area, split_loops

SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])


def test_area_is_positive_counter_clockwise_and_negative_clockwise() -> None:
    assert signed_area(SQUARE) == pytest.approx(4.0)
    assert signed_area(SQUARE[::-1]) == pytest.approx(-4.0)


def test_a_ring_of_two_points_has_no_area() -> None:
    assert signed_area(SQUARE[:2]) == 0.0


def test_a_walk_that_meets_itself_is_parted_into_loops_that_do_not() -> None:
    loops = split_loops(np.array([0, 1, 2, 3, 1, 4]))
    assert sorted(sorted(loop.tolist()) for loop in loops) == [[0, 1, 4], [1, 2, 3]]
