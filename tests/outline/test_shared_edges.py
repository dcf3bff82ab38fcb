"""Neighbours share their edges without gap or overlap."""

from __future__ import annotations

import shapely
from shapely import Polygon, box

from eaves.outline.toolkit.shared_edges import share_edges


def gap_and_overlap(polygons: list[Polygon]) -> tuple[float, float]:
    whole = shapely.union_all(polygons)
    return whole.convex_hull.area - whole.area, sum(p.area for p in polygons) - whole.area


def test_a_gap_is_closed_by_the_shorter_edge_without_a_jog() -> None:
    long, short = share_edges([box(0, 0, 10, 12), box(10.3, 3, 20, 9)], 0.5, 10.0, 1.0)
    assert long.normalize().simplify(0).equals(box(0, 0, 10, 12))
    assert short.equals(box(10, 3, 20, 9))
    assert (10.0, 3.0) in list(long.exterior.coords)


def test_an_overlap_goes_to_the_larger() -> None:
    a, b = share_edges([box(0, 0, 10, 12), box(9.8, 0, 20, 12)], 0.5, 10.0, 1.0)
    assert gap_and_overlap([a, b]) == (0.0, 0.0)
    assert b.area == 10.2 * 12 and a.area == 9.8 * 12


def test_an_alley_stays_open() -> None:
    houses = [box(0, 0, 10, 12), box(11, 0, 20, 12)]
    assert share_edges(houses, 0.5, 10.0, 1.0) == houses


def test_a_row_of_three_is_one_block() -> None:
    row = share_edges([box(0, 0, 6, 10), box(6.2, 0, 12, 10), box(11.9, 0, 18, 10)], 0.4, 10.0, 1.0)
    gap, overlap = gap_and_overlap(row)
    assert abs(gap) < 1e-9 and abs(overlap) < 1e-9
    assert all(polygon.is_valid for polygon in row)
