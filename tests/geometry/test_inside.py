"""Points in polygons, against shapely."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from eaves.geometry.inside import edges_of, is_inside, points_in_polygons

HOLED = shapely.Polygon([(0, 0), (6, 0), (6, 6), (0, 6)], [[(2, 2), (2, 4), (4, 4), (4, 2)]])


@pytest.mark.parametrize("seed", range(5))
def test_pairs_are_those_of_shapely__many_points_on_borders(seed: int) -> None:
    rng = np.random.default_rng(seed)
    stars = []
    for _ in range(12):
        angle = np.sort(rng.random(9)) * 2 * np.pi
        reach = 1.0 + rng.integers(1, 5, 9)
        corner = np.round(
            rng.integers(0, 10, 2) + reach[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        )
        star = shapely.Polygon(corner)
        if star.is_valid and not star.is_empty:
            stars.append(star)
    polygons = np.array(
        [*stars, HOLED, shapely.Polygon(), shapely.affinity.translate(HOLED, 0.1, 0.3)], object
    )
    points = np.round(rng.integers(-20, 150, (3000, 3)) / 10.0, 1)
    point, polygon = points_in_polygons(points, *edges_of(polygons), len(polygons))
    tree = shapely.STRtree(polygons)
    expected = tree.query(shapely.points(points[:, :2]), predicate="intersects")
    assert sorted(zip(point, polygon, strict=True)) == sorted(map(tuple, expected.T))
    assert np.all(np.diff(point) >= 0)


def test_a_point_beside_a_long_edge_differs_from_one_on_it__by_the_last_bit() -> None:
    triangle = np.array([shapely.Polygon([(0.0, 0.0), (3.0, 3.0), (0.0, 3.0)])], object)
    points = np.array([[0.1, 0.1], [np.nextafter(0.1, 1.0), 0.1], [np.nextafter(0.1, 0.0), 0.1]])
    point, _ = points_in_polygons(points, *edges_of(triangle), 1)
    assert point.tolist() == [0, 2]
    start, end, _ = edges_of(triangle)
    assert [is_inside(x, y, start, end) for x, y in points] == [True, False, True]


def test_no_points_and_no_polygons_have_a_result() -> None:
    none = np.zeros((0, 2))
    square = np.array([shapely.box(0, 0, 1, 1)], object)
    assert len(points_in_polygons(none, *edges_of(square), 1)[0]) == 0
    assert len(points_in_polygons(np.ones((1, 2)), none, none, np.zeros(0, np.int64), 0)[0]) == 0
