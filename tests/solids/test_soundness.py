"""The defects of a block are found, each beside a block that barely lacks it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

from eaves.geometry.rings import PLANARITY
from eaves.model import Solid
from eaves.solids.cutting import arrange
from eaves.solids.extrude import extrude
from eaves.solids.soundness import CLOSEST, FLATTEST_SHARE, LOWEST_WALL, find_defect


def block(slope: float = 0.25, east: float = 8.0) -> Solid:
    """A block 8 m × 4 m, 5 m high at its west end, under one slope."""
    plan = arrange(shapely.box(0.0, 0.0, east, 4.0), np.zeros((0, 4)))
    assert plan is not None
    (solid,) = extrude(plan, np.array([[slope, 0.0, 5.0]]), 0.0) or []
    return solid


def with_corner(solid: Solid, shift: tuple[float, float, float]) -> Solid:
    """The solid with the corner at its top's north-east moved."""
    number = int(np.argmax(solid.vertices @ [1.0, 1.0, 1e-3]))
    vertices = solid.vertices.copy()
    vertices[number] += shift
    return replace(solid, vertices=vertices)


@pytest.mark.parametrize("slope", [0.0, 0.25])
def test_plain_blocks_are_sound(slope: float) -> None:
    assert find_defect(block(slope)) == ""


@pytest.mark.parametrize("slope", [0.0, 0.25])
def test_roofs_bent_more_than_their_share_are_not_planar(slope: float) -> None:
    """One corner of four that is lifted by h leaves all of them h / 4 off their plane, upright."""
    upright = 4.0 * FLATTEST_SHARE * PLANARITY * np.hypot(1.0, slope)
    assert find_defect(with_corner(block(slope), (0.0, 0.0, 0.98 * upright))) == ""
    bent = with_corner(block(slope), (0.0, 0.0, 1.02 * upright))
    assert find_defect(bent) == "a roof face that is not planar"


def test_roofs_at_the_ground_are_found() -> None:
    low = -(5.0 - LOWEST_WALL) / 8.0
    assert find_defect(block(0.999 * low)) == ""
    assert find_defect(block(1.001 * low)) == "a roof that reaches the ground"


def test_plans_that_cross_themselves_are_found() -> None:
    crossed = block(0.0)
    corner = (crossed.vertices[:, :2] == [8.0, 4.0]).all(axis=1)
    crossed = replace(crossed, vertices=crossed.vertices - corner[:, None] * [10.0, 3.0, 0.0])
    assert find_defect(crossed) == "a face whose rings cross"


def test_corners_too_near_to_each_other_are_found() -> None:
    assert find_defect(block(0.0)) == ""
    narrow = block(0.0)
    narrow = replace(narrow, vertices=narrow.vertices * [0.9 * CLOSEST / 8.0, 1.0, 1.0])
    assert find_defect(narrow) == "corners too close to each other"
