"""Given footprints are repaired, clipped, snapped, and split a block; none is lost silently."""

from __future__ import annotations

import numpy as np
import shapely
from shapely import LineString, MultiPolygon, Point, Polygon, affinity, box

from eaves.footprints.addresses import split_block
from eaves.footprints.read import clip_footprints, repair_footprints
from eaves.footprints.snap import snap_footprints
from eaves.model import Bounds, Failure, Footprint

BOWTIE = Polygon([(0, 0), (10, 10), (10, 0), (0, 10)])


def test_a_bowtie_becomes_its_two_triangles() -> None:
    found = repair_footprints([BOWTIE], ["a"])
    assert [footprint.id for footprint in found] == ["a", "a-2"]
    assert all(footprint.polygon.is_valid and footprint.polygon.exterior.is_ccw for footprint in found)
    assert sum(footprint.polygon.area for footprint in found) == 50.0


def test_a_multipolygon_becomes_parts_with_ids_of_their_own_and_attributes_stay() -> None:
    shape = MultiPolygon([box(0, 0, 2, 2), box(5, 0, 9, 4)])
    found = repair_footprints([shape, box(20, 0, 24, 4)], ["7", "7"], [{"use": "shop"}, {}])
    assert [footprint.id for footprint in found] == ["7", "7-2", "7-3"]
    assert found[0].polygon.area == 16.0 and found[1].attributes == {"use": "shop", "given_part": 2}


def test_shapes_without_area_are_left_out_with_a_reason() -> None:
    shapes = [
        Polygon(),
        None,
        LineString([(0, 0), (3, 3)]),
        Point(1, 1),
        box(0, 0, 0.1, 0.1),
        box(0, 0, 5, 5),
    ]
    *failures, whole = repair_footprints(shapes, list("abcdef"))
    assert isinstance(whole, Footprint)
    assert [failure.reason.split("'")[1] for failure in failures] == list("abcde")


def test_clipping_marks_what_is_cut_and_reports_what_is_outside() -> None:
    given = repair_footprints([box(1, 1, 5, 5), box(8, 1, 14, 5), box(30, 1, 34, 5)], ["in", "cut", "out"])
    inside, cut, out = clip_footprints(given, Bounds(0, 0, 10, 10))
    assert inside is given[0]
    assert isinstance(cut, Footprint) and cut.polygon.area == 8.0 and cut.attributes["clipped"] is True
    assert isinstance(out, Failure) and "'out'" in out.reason


def test_snapped_footprints_reach_the_eaves_and_keep_their_party_wall() -> None:
    rng = np.random.default_rng(0)
    roof = box(0, 0, 20, 10)
    xy = rng.uniform([0, 0], [20, 10], (2000, 2))
    given = repair_footprints([box(0.4, 0.4, 9, 9.6), box(9, 0.4, 19.6, 9.6)], ["1", "2"])
    moved = [affinity.translate(footprint.polygon, 0.5, -0.3) for footprint in given]
    off = [footprint.with_(polygon=shape) for footprint, shape in zip(given, moved, strict=True)]
    snapped = snap_footprints(off, np.column_stack([xy, np.full(2000, 6.0)]), 10.0**-0.5)
    a, b = (footprint.polygon for footprint in snapped)
    assert a.intersection(b).area == 0.0 and a.intersection(b).length > 9.0
    whole = shapely.union_all([a, b])
    assert whole.intersection(roof).area / whole.union(roof).area > 0.975


def test_a_block_is_split_along_its_party_walls_without_gap_or_overlap() -> None:
    block = box(-0.5, -0.5, 20.5, 10.5)
    addresses = repair_footprints([box(0, 0, 8, 10), box(8, 0, 20, 10), box(40, 0, 50, 9)], ["1", "2", "3"])
    (one, two, none), rest = split_block(block, addresses)
    assert rest == []
    assert one is not None and two is not None and none is None
    assert abs(one.polygon.area + two.polygon.area - block.area) < 1e-6
    assert one.polygon.intersection(two.polygon).length > 10.9
    assert one.polygon.equals(box(-0.5, -0.5, 8, 10.5))


def test_what_no_address_covers_stays_a_building_of_its_own() -> None:
    block = box(-0.5, -0.5, 30.5, 10.5)
    addresses = repair_footprints([box(0, 0, 8, 10), box(8, 0, 20, 10)], ["1", "2"])
    (one, two), rest = split_block(block, addresses)
    assert one is not None and two is not None and len(rest) == 1
    assert two.polygon.equals(box(8, -0.5, 20, 10.5)) and rest[0].equals(box(20, -0.5, 30.5, 10.5))
    assert split_block(box(50, 50, 60, 60), addresses) == ([None, None], [box(50, 50, 60, 60)])


def test_a_narrow_address_is_held_when_most_of_it_is_in_the_block() -> None:
    addresses = repair_footprints([box(0, 0, 8, 10), box(8, 0, 9.6, 10), box(9.6, 0, 18, 10)], list("123"))
    found, rest = split_block(box(-0.5, -0.5, 18.5, 10.5), addresses)
    assert rest == [] and found[1] is not None and found[1].polygon.equals(box(8, -0.5, 9.6, 10.5))
    found, _ = split_block(box(-0.5, -0.5, 8.7, 10.5), addresses)
    assert found[0] is not None and found[1:] == [None, None]


def test_walls_that_nearly_meet_leave_no_tiny_edges() -> None:
    block = box(0, 0, 20, 10.003)
    shapes = [box(0, 0, 10, 5), box(10.001, 0, 20, 5.002), box(0, 5, 10.002, 10), box(10.002, 5.002, 20, 10)]
    found, rest = split_block(block, repair_footprints(shapes, list("1234")))
    parts = [part.polygon for part in found if part is not None]
    assert len(parts) == 4 and rest == []
    assert abs(shapely.union_all(parts).area - block.area) < 0.05
    for part in parts:
        xy = shapely.get_coordinates(part)
        assert np.hypot(*np.diff(xy, axis=0).T).min() > 0.015


def test_a_footprint_of_twenty_thousand_corners_has_fewer_and_the_same_place() -> None:
    circle = Point(0, 0).buffer(9.0, quad_segs=5_000)
    (found,) = repair_footprints([circle])
    assert shapely.get_num_coordinates(found.polygon) < 1000
    assert shapely.hausdorff_distance(found.polygon, circle) < 0.003


def test_a_footprint_with_too_many_courtyards_is_left_with_them() -> None:
    courts = [box(3 * x, 3 * y, 3 * x + 1.5, 3 * y + 1.5).exterior for x in range(30) for y in range(30)]
    (found,) = repair_footprints([Polygon(box(-1, -1, 91, 91).exterior, courts)])
    assert len(found.polygon.interiors) == 900
