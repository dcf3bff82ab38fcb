"""Buildings from the file's own classes: what belongs together, what is believed, what is empty."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from eaves.detect import detect_buildings
from eaves.detect.given_classes import GivenClasses
from eaves.model import Scene
from eaves.model.cloud import BUILDING, GROUND, UNCLASSIFIED
from eaves.model.scene import ROOF
from tests.detect.made_scenes import MadeScene, two_houses_and_a_tree

BRIDGE = 17


def classified(made: MadeScene, code_of: dict[int, int]) -> tuple[Scene, NDArray[np.int64]]:
    """The scene with the class of each object, and the object of each point (N,)."""
    scene, what = made.scene()
    codes = np.full(len(what), UNCLASSIFIED, np.uint8)
    codes[what == 0] = GROUND
    for number, code in code_of.items():
        codes[what == number] = code
    cloud = scene.cloud.with_(classification=codes)
    return Scene(cloud, scene.dtm, scene.dsm, scene.spacing, scene.height), what


def two_boxes(gap: float) -> MadeScene:
    """Two boxes whose corners are `gap` apart in x and in y."""
    made = MadeScene(density=12.0)
    made.box(10.0, 10.0, 20.0, 20.0, 5.0, 1)
    made.box(20.0 + gap, 20.0 + gap, 30.0, 30.0, 5.0, 2)
    return made


def test_each_house_of_class_6_is_a_region_and_nothing_else() -> None:
    scene, what = classified(two_houses_and_a_tree(), {1: BUILDING, 2: BUILDING})
    found = detect_buildings(scene, GivenClasses())
    assert found.count == 2
    assert (found.label[what == 1] == 1).all()
    assert (found.label[what == 2] == 2).all()
    assert not found.label[what <= 0].any()
    assert (found.score == 1.0).all()
    assert found.part is not None
    assert (found.part[what > 0] == ROOF).all()
    assert not found.part[what <= 0].any()


def test_boxes_that_touch_by_a_corner_are_one_region() -> None:
    scene, _ = classified(two_boxes(0.0), {1: BUILDING, 2: BUILDING})
    assert detect_buildings(scene, GivenClasses(cell=1.0)).count == 1


def test_boxes_two_metres_apart_are_two_regions() -> None:
    scene, what = classified(two_boxes(2.0), {1: BUILDING, 2: BUILDING})
    found = detect_buildings(scene, GivenClasses())
    assert found.count == 2
    assert len(np.unique(found.label[what == 1])) == len(np.unique(found.label[what == 2])) == 1


def test_points_of_several_building_classes_are_one_building() -> None:
    scene, what = classified(two_boxes(0.0), {1: BUILDING, 2: 67})
    found = detect_buildings(scene, GivenClasses(cell=1.0))
    assert found.count == 1
    assert (found.label[what > 0] == 1).all()


def test_other_classes_are_used_when_named() -> None:
    scene, what = classified(two_boxes(2.0), {1: BUILDING, 2: BRIDGE})
    assert detect_buildings(scene, GivenClasses()).count == 1
    found = detect_buildings(scene, GivenClasses(classes=(BRIDGE,)))
    assert found.count == 1
    assert (found.label[what == 2] == 1).all()
    assert not found.label[what == 1].any()


@pytest.mark.parametrize("kept", [0, 1, 2])
def test_no_class_6_or_hardly_any_gives_no_building(kept: int) -> None:
    scene, what = classified(two_houses_and_a_tree(), {})
    assert scene.cloud.classification is not None
    codes = scene.cloud.classification.copy()
    codes[np.flatnonzero(what == 1)[:kept]] = BUILDING
    few = Scene(scene.cloud.with_(classification=codes), scene.dtm, scene.dsm, scene.spacing, scene.height)
    assert detect_buildings(few, GivenClasses()).count == 0


def test_a_cloud_without_classes_has_no_building() -> None:
    scene, _ = two_houses_and_a_tree().scene()
    bare = Scene(scene.cloud.with_(classification=None), scene.dtm, scene.dsm, scene.spacing, scene.height)
    assert GivenClasses().label(bare).count == 0
