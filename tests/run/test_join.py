"""Regions become buildings: hand-made seams whose answer is known."""

from __future__ import annotations

import numpy as np
import shapely

from eaves.buildings.gather import Seam, assign_footprints, join_regions
from eaves.model import Block, Footprint

WEST, EAST, FAR = Block(0, 0), Block(1, 0), Block(5, 5)


def seam(block: Block, count: int, shared: dict[int, int], inside: list[int]) -> Seam:
    """A block with `count` regions; `shared` maps point ids near the border to labels."""
    held = np.zeros(count + 1, bool)
    held[inside] = True
    ids, labels = np.array(list(shared), np.int64), np.array(list(shared.values()), np.int32)
    return Seam(block, count, ids, labels, held, held.astype(np.uint8))


def test_regions_that_share_a_point_are_one_building() -> None:
    plans = join_regions([seam(WEST, 2, {100: 2}, [1, 2]), seam(EAST, 1, {100: 1}, [1])])
    assert [(plan.owner_block, len(plan.buildings)) for plan in plans] == [(WEST, 2)]
    assert plans[0].buildings[1].regions == ((WEST, 2), (EAST, 1))


def test_regions_that_share_none_stay_apart() -> None:
    plans = join_regions([seam(WEST, 1, {100: 1}, [1]), seam(EAST, 1, {101: 1}, [1])])
    assert [len(plan.buildings) for plan in plans] == [1, 1]


def test_a_region_seen_only_from_the_neighbour_is_no_building_of_this_block() -> None:
    plans = join_regions([seam(WEST, 1, {100: 1}, []), seam(EAST, 1, {100: 1}, [1])])
    assert [plan.owner_block for plan in plans] == [EAST]
    assert plans[0].buildings[0].regions == ((EAST, 1),)


def test_a_row_over_three_blocks_is_one_building_in_any_order() -> None:
    seams = [
        seam(WEST, 1, {1: 1}, [1]),
        seam(EAST, 1, {1: 1, 2: 1}, [1]),
        seam(Block(2, 0), 1, {2: 1}, [1]),
    ]
    assert len(join_regions(seams)) == 1
    straight, turned = join_regions(seams)[0], join_regions(seams[::-1])[0]
    assert straight.buildings[0].regions == turned.buildings[0].regions


def test_no_regions_no_buildings() -> None:
    assert join_regions([seam(WEST, 0, {}, [])]) == []
    assert join_regions([]) == []


def test_a_given_footprint_is_at_home_in_one_block_and_sees_all_it_covers() -> None:
    across = Footprint(shapely.box(200, 10, 250, 20), id="a")
    far = Footprint(shapely.box(1e6, 0, 1e6 + 9, 9), id="b")
    plans = assign_footprints([across, far], [WEST, EAST, FAR], WEST)
    assert [getattr(one.failure, "code", None) for plan in plans for one in plan.buildings] == [
        None,
        "outside",
    ]
    plan = plans[0].buildings[0]
    assert {block for block, _ in plan.regions} == {WEST, EAST}
    assert plan.given is not None
    west = plan.given.polygon.bounds[0] + plan.given.origin[0]
    assert west == 200
