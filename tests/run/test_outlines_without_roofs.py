"""Points under a given outline are a roof's only where they are one."""

from __future__ import annotations

import numpy as np
import shapely

from eaves import RoofPlane
from eaves.buildings.owned import lacks_roof
from eaves.model import Block, Footprint, Raster
from eaves.model.results import BuildingPoints

PLAN = Footprint(shapely.box(0.0, 0.0, 6.0, 4.0))
SIDE = 0.5


def made(split: float, given: bool = True, ground: float = 0.0) -> BuildingPoints:
    """A building of 200 points, a share of which is not the last of its pulse, with ground seen in a share
    of the rows of its plan."""
    rng = np.random.default_rng(1)
    xyz = np.column_stack([rng.uniform((0, 0), (6, 4), (200, 2)), np.full(200, 3.0)])
    cells = np.zeros((8, 12), np.float32)
    cells[: round(8 * ground)] = 1.0
    raster = Raster(cells, 0.0, 4.0, SIDE)
    return BuildingPoints(
        owner_block=Block.at(0.0, 0.0, 240.0),
        xyz=xyz,
        point_id=np.arange(200),
        part=np.zeros(200, np.uint8),
        terrain=raster,
        spacing=0.3,
        score=1.0,
        given=PLAN if given else None,
        ground_seen=raster,
        not_last=np.arange(200) < 200 * split,
    )


def on_plane(share: float) -> list[RoofPlane]:
    """A level plane that holds the last points, a share of all."""
    return [RoofPlane((0.0, 0.0, 3.0), np.arange(round(200 * (1 - share)), 200), 0.0)]


def reason(building: BuildingPoints, share: float) -> str:
    return lacks_roof(building, np.arange(200), on_plane(share))


def test_points_that_end_their_pulses_on_planes_are_a_roof() -> None:
    assert reason(made(0.1), 0.9) == ""


def test_points_that_let_pulses_through_and_lie_on_no_plane_are_leaves() -> None:
    assert "leaves" in reason(made(0.45), 0.4)


def test_roof_half_under_a_crown_stays_a_roof() -> None:
    assert reason(made(0.3), 0.6) == ""


def test_rough_roof_whose_pulses_all_end_on_it_stays_a_roof() -> None:
    assert reason(made(0.0), 0.3) == ""


def test_outline_in_which_ground_is_seen_holds_no_roof() -> None:
    assert "ground was seen" in reason(made(0.0, ground=0.7), 1.0)


def test_detected_building_was_judged_before() -> None:
    assert reason(made(0.45, given=False, ground=0.7), 0.4) == ""
