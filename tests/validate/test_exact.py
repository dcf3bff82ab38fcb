"""The integer predicates are exact where floating point is not."""

from __future__ import annotations

import numpy as np
import pytest

from eaves.validate.exact import (
    CROSS,
    OPPOSITE_SIDE,
    SAME_SIDE,
    crossings_kernel,
    enclosed_kernel,
    orient_kernel,
    triangles_meet_kernel,
)


def exact_orientation(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> int:
    """The slow twin: Python's whole numbers have no limit."""
    u, v, w = ([int(x) - int(y) for x, y in zip(p, a, strict=True)] for p in (b, c, d))
    value = (
        w[0] * (u[1] * v[2] - u[2] * v[1])
        + w[1] * (u[2] * v[0] - u[0] * v[2])
        + w[2] * (u[0] * v[1] - u[1] * v[0])
    )
    return (value > 0) - (value < 0)


def test_orientation_is_exact_near_and_on_the_plane() -> None:
    rng = np.random.default_rng(0)
    for _ in range(3000):
        a, b, c = rng.integers(0, 1 << 28, (3, 3))
        s, t = rng.integers(-3, 4, 2)
        d = np.clip(a + s * (b - a) // 7 + t * (c - a) // 7 + rng.integers(-1, 2, 3), 0, 1 << 28)
        assert orient_kernel(a, b, c, d) == exact_orientation(a, b, c, d)


def test_orientation_of_points_on_one_plane_is_zero() -> None:
    rng = np.random.default_rng(1)
    for _ in range(500):
        a = rng.integers(0, 1 << 20, 3)
        u, v = rng.integers(-(1 << 20), 1 << 20, (2, 3))
        assert orient_kernel(a, a + u, a + v, a + 3 * u - 2 * v) == 0


T = np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0]])


@pytest.mark.parametrize(
    ("other", "numbers", "meet"),
    [
        ([[2, 2, -5], [2, 2, 5], [20, 20, 0]], [3, 4, 5], True),
        ([[2, 2, 1], [2, 2, 5], [20, 20, 1]], [3, 4, 5], False),
        ([[2, 2, 0], [2, 2, 5], [20, 20, 1]], [3, 4, 5], True),
        ([[0, 0, 0], [-5, 0, 5], [0, -5, 5]], [0, 4, 5], False),
        ([[0, 0, 0], [5, 5, 0], [0, 0, 5]], [0, 4, 5], True),
        ([[0, 0, 0], [10, 0, 0], [0, -10, 0]], [0, 1, 5], False),
        ([[0, 0, 0], [10, 0, 0], [5, 5, 0]], [0, 1, 5], True),
        ([[0, 0, 0], [10, 0, 0], [5, 5, 1]], [0, 1, 5], False),
        ([[1, 1, 0], [3, 1, 0], [1, 3, 0]], [3, 4, 5], True),
        ([[6, 6, 0], [9, 6, 0], [6, 9, 0]], [3, 4, 5], False),
        ([[5, 5, 0], [9, 6, 0], [6, 9, 0]], [3, 4, 5], True),
    ],
    ids=[
        "a corner through the face",
        "above the face",
        "a corner on the face",
        "a shared corner only",
        "a shared corner, an edge through the far side",
        "a shared edge, unfolded",
        "a shared edge, folded over",
        "a shared edge, opened by one step",
        "inside on the plane",
        "beside on the plane",
        "a corner on the other's edge",
    ],
)
def test_triangles_meet_only_where_they_share(other: list[list[int]], numbers: list[int], meet: bool) -> None:
    numbers_t, numbers_u = np.array([0, 1, 2]), np.array(numbers)
    assert triangles_meet_kernel(T, np.array(other), numbers_t, numbers_u) == meet
    assert triangles_meet_kernel(np.array(other), T, numbers_u, numbers_t) == meet


@pytest.mark.parametrize(
    ("other", "code"),
    [
        ([[2, 2, -5], [3, 2, 5], [20, 20, 0]], CROSS),
        ([[2, 2, 0], [3, 2, 5], [20, 20, 1]], 0),
        ([[1, 1, 0], [3, 1, 0], [1, 3, 0]], SAME_SIDE),
        ([[1, 1, 0], [1, 3, 0], [3, 1, 0]], OPPOSITE_SIDE),
        ([[10, 0, 0], [10, 10, 0], [0, 10, 0]], 0),
    ],
)
def test_triangles_of_two_shells_cross_or_share_area(other: list[list[int]], code: int) -> None:
    assert crossings_kernel(T[None], np.array(other)[None]) == code


def test_a_box_encloses_what_is_inside() -> None:
    from tests.validate.made_shells import box

    quads = [face[0] for face in box(0, 0, 0, 10, 10, 10)]
    triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    places = np.array(
        [[5, 5, 5], [5, 5, 10], [10, 10, 10], [0, 5, 10], [5, 5, 11], [5, 5, 9.9], [-1e3, 5, 5]]
    )
    assert enclosed_kernel(places, triangles).tolist() == [1, 0, 0, 0, -1, 1, -1]
