"""Buildings that new points only confirm, on houses of which everything is known."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from eaves.model import BuildingModel
from eaves.simulate import nine_roofs_on_a_slope
from eaves.upkeep.versions import is_confirmed, overlapping_groups

ORIGIN = (84_960.0, 446_880.0)


@pytest.fixture(scope="module")
def house() -> BuildingModel:
    """A house with a pitched roof, far from the origin of the world."""
    model = nine_roofs_on_a_slope(density=1.0).buildings[1].model()
    return model.with_(footprint=model.footprint.with_(origin=ORIGIN))


def moved(model: BuildingModel, east: float, up: float) -> BuildingModel:
    """A model (m) beside where it was."""
    solids = {
        lod: tuple(replace(solid, vertices=solid.vertices + [east, 0.0, up]) for solid in parts)
        for lod, parts in model.solids.items()
    }
    plan = shapely.transform(model.footprint.polygon, lambda xy: xy + [east, 0.0])
    return model.with_(footprint=model.footprint.with_(polygon=plan), solids=solids)


@pytest.mark.parametrize(
    ("east", "up", "confirmed"),
    [(0.0, 0.0, True), (0.1, 0.05, True), (0.0, 0.2, True), (0.0, 0.3, False), (2.0, 0.0, False)],
)
def test_a_roof_within_the_noise_is_confirmed(
    house: BuildingModel, east: float, up: float, confirmed: bool
) -> None:
    assert is_confirmed([house], [moved(house, east, up)]) is confirmed


def test_another_origin_and_order_change_nothing(house: BuildingModel) -> None:
    beside = moved(house, 40.0, 1.0)
    elsewhere = moved(house, -240.0, 0.0)
    elsewhere = elsewhere.with_(footprint=elsewhere.footprint.with_(origin=(ORIGIN[0] + 240.0, ORIGIN[1])))
    assert is_confirmed([house, beside], [beside, elsewhere])
    assert not is_confirmed([house, beside], [house])


def test_a_wider_outline_is_a_change(house: BuildingModel) -> None:
    for deep, confirmed in ((0.4, True), (3.0, False)):
        plan = shapely.buffer(house.footprint.polygon, deep, join_style="mitre")
        longer = house.with_(footprint=house.footprint.with_(polygon=plan))
        assert is_confirmed([house], [longer]) is confirmed


def test_groups_are_joined_by_ground_and_by_blocks() -> None:
    box = shapely.box
    earlier = [box(0, 0, 4, 9), box(4, 0, 8, 9), box(50, 0, 60, 9)]
    fresh = [box(0, 0, 5, 9), box(5, 0, 8, 9), box(50, 0, 60, 9)]
    blocks = ["a", "a", "", "b", "b", ""]
    groups = sorted(overlapping_groups(earlier, fresh, blocks))
    assert groups == [([0, 1], [0, 1]), ([2], [2])]
    apart = sorted(overlapping_groups(earlier[2:], [box(80, 0, 90, 9)], ["", ""]))
    assert apart == [([], [0]), ([0], [])]
    assert np.all([len(group) == 2 for group in groups])
