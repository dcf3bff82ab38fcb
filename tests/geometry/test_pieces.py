"""Pieces without an owner go to the neighbour with the longest border."""

import shapely
from shapely import Polygon

from eaves.geometry.rings import owned_by_neighbours


def test_a_sliver_goes_along_its_side__not_across_its_tip() -> None:
    house, neighbour = shapely.box(0, 4, 5, 5), shapely.box(9, 0, 12, 5)
    sliver = Polygon([(5, 4.999), (9, 5), (5, 5)])
    beside = Polygon([(5, 0), (9, 0), (9, 5), (5, 4.999)])
    assert owned_by_neighbours([house, sliver, beside, neighbour], [0, -1, -1, 1], 2) == [0, 1, 1, 1]


def test_what_touches_no_owner_keeps_none() -> None:
    assert owned_by_neighbours([shapely.box(0, 0, 1, 1), shapely.box(3, 0, 4, 1)], [0, -1], 1) == [0, -1]
