"""The TIN: Delaunay, exact, open to more points."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import Delaunay

from eaves.geometry.tin import Tin, hilbert_kernel


def faces(triangles: np.ndarray) -> set[tuple[int, ...]]:
    return set(map(tuple, np.sort(triangles, axis=1).tolist()))


def test_triangles_are_qhulls() -> None:
    xy = np.round(np.random.default_rng(1).uniform(0, 50, (800, 2)), 3)
    assert faces(Tin(xy).triangles) == faces(Delaunay(xy).simplices)


def test_points_inserted_later_give_the_same_triangles() -> None:
    xy = np.round(np.random.default_rng(2).uniform(0, 50, (600, 2)), 3)
    tin = Tin(xy, np.arange(0, 600, 7))
    for start in range(1, 7):
        tin.insert(np.arange(start, 600, 7))
    assert faces(tin.triangles) == faces(Tin(xy).triangles)


def test_where_a_search_begins_does_not_matter() -> None:
    xy = np.round(np.random.default_rng(5).uniform(0, 50, (600, 2)), 3)
    tin = Tin(xy, np.arange(0, 600, 7))
    for start in range(1, 7):
        numbers = np.arange(start, 600, 7)
        away = np.random.default_rng(start).integers(0, len(tin.vertices), len(numbers), np.int32)
        tin.insert(numbers, away)
    assert faces(tin.triangles) == faces(Delaunay(xy).simplices)


@pytest.mark.parametrize("step", [1.0, 0.1, 1e4])
def test_a_grid_has_all_its_area_and_no_turned_triangle(step: float) -> None:
    xy = np.stack(np.meshgrid(np.arange(25.0), np.arange(25.0)), axis=-1).reshape(-1, 2) * step
    tin = Tin(np.r_[xy, xy[:40]])
    a, b, c = (tin.xy[tin.triangles[:, k]] for k in range(3))
    u, v = b - a, c - a
    area = (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2
    assert (area > 0).all()
    assert area.sum() == pytest.approx((24 * step) ** 2)


def test_neighbours_are_mutual() -> None:
    tin = Tin(np.random.default_rng(3).uniform(0, 9, (300, 2)))
    back = tin.neighbours[tin.neighbours]
    assert (back == np.arange(len(tin.neighbours))[:, None, None]).any(axis=2).all()


def test_heights_of_a_plane_are_exact_inside_and_missing_outside() -> None:
    rng = np.random.default_rng(4)
    xy = rng.uniform(0, 10, (500, 2))
    z = 2.0 * xy[:, 0] - xy[:, 1]
    at = rng.uniform(1, 9, (200, 2))
    tin = Tin(xy)
    assert np.allclose(tin.interpolate(z, at), 2.0 * at[:, 0] - at[:, 1])
    assert np.isnan(tin.interpolate(z, np.array([[-5.0, 3.0], [30.0, 30.0]]))).all()


@pytest.mark.parametrize(
    "xy", [np.zeros((0, 2)), np.zeros((1, 2)), np.zeros((4, 2)), np.c_[np.arange(6.0), 2 * np.arange(6.0)]]
)
def test_points_on_one_line_have_no_triangles(xy: np.ndarray) -> None:
    tin = Tin(xy)
    assert len(tin.triangles) == 0
    assert np.isnan(tin.interpolate(np.zeros(len(xy)), np.ones((2, 2)))).all()


def test_a_line_becomes_a_triangle_when_a_point_off_it_comes() -> None:
    xy = np.r_[np.c_[np.arange(5.0), np.zeros(5)], [[2.0, 3.0]]]
    tin = Tin(xy, np.arange(5))
    assert len(tin.triangles) == 0
    tin.insert(np.array([5]))
    assert len(tin.triangles) == 4


def test_curve_goes_from_cell_to_neighbouring_cell() -> None:
    rows, columns = np.indices((64, 64))
    whole = np.c_[rows.ravel(), columns.ravel()] * (1 << 10)
    ordered = whole[np.argsort(hilbert_kernel(np.r_[whole, [[(1 << 16) - 1, 0]]])[:-1])]
    assert (np.abs(np.diff(ordered, axis=0)).sum(axis=1) == 1 << 10).all()
