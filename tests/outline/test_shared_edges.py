"""Neighbours that overlap share their edges."""

from __future__ import annotations

import shapely
from shapely import Polygon, box

from eaves.geometry.rings import share_edges


def gap_and_overlap(polygons: list[Polygon]) -> tuple[float, float]:
    whole = shapely.union_all(polygons)
    return whole.convex_hull.area - whole.area, sum(p.area for p in polygons) - whole.area


def test_an_overlap_goes_to_the_larger() -> None:
    a, b = share_edges([box(0, 0, 10, 12), box(9.8, 0, 20, 12)])
    assert gap_and_overlap([a, b]) == (0.0, 0.0)
    assert b.area == 10.2 * 12 and a.area == 9.8 * 12


def test_what_does_not_overlap_stays_and_a_row_of_three_is_one_block() -> None:
    houses = [box(0, 0, 10, 12), box(11, 0, 20, 12)]
    assert share_edges(houses) == houses
    row = share_edges([box(0, 0, 6, 10), box(6, 0, 12, 10), box(11.9, 0, 18, 10)])
    gap, overlap = gap_and_overlap(row)
    assert abs(gap) < 1e-9 and abs(overlap) < 1e-9
    assert all(polygon.is_valid for polygon in row)
