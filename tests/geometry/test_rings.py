"""Areas of rings in the plane and in space, and walks parted into loops."""

import numpy as np
import pytest

from eaves.geometry.rings import area_vector, ring_edges, signed_area, split_loops

SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])


def test_area_is_positive_counter_clockwise_and_negative_clockwise() -> None:
    assert signed_area(SQUARE) == pytest.approx(4.0)
    assert signed_area(SQUARE[::-1]) == pytest.approx(-4.0)


def test_a_ring_of_two_points_has_no_area() -> None:
    assert signed_area(SQUARE[:2]) == 0.0


def test_area_vector_of_a_sloping_square_is_its_area_along_its_normal() -> None:
    far = np.array([85_000.0, 447_000.0, 12.0])
    ring = np.c_[SQUARE, 0.75 * SQUARE[:, 0]] + far
    assert np.allclose(area_vector(ring), 4.0 * np.array([-0.75, 0.0, 1.0]))


def test_a_walk_that_meets_itself_is_parted_into_loops_that_do_not() -> None:
    loops = split_loops(np.array([0, 1, 2, 3, 1, 4]))
    assert sorted(sorted(loop.tolist()) for loop in loops) == [[0, 1, 4], [1, 2, 3]]


def test_ring_edges_close_every_ring() -> None:
    start, end, ring = ring_edges([(4, 5, 6), (1, 2), (7,)])
    assert start.tolist() == [4, 5, 6, 1, 2, 7]
    assert end.tolist() == [5, 6, 4, 2, 1, 7]
    assert ring.tolist() == [0, 0, 0, 1, 1, 2]
