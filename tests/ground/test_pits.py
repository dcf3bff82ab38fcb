"""Cells that pass for ground: walls and holes, with a step and a ditch that must stay."""

from __future__ import annotations

import numpy as np

from eaves.ground.adaptive_tin import AdaptiveTin
from eaves.ground.toolkit.pits import find_strays
from eaves.model import Mask, Raster, Values

RULES = AdaptiveTin()


def strays_of(z: Values, objects: Mask) -> Mask:
    raster = Raster(z.astype(np.float32), 0.0, float(z.shape[0]), 1.0)
    return find_strays(raster, np.zeros(z.shape, np.float32), objects, np.ones(z.shape, bool), RULES)


def test_point_low_on_a_wall_is_a_pit() -> None:
    z, objects = np.zeros((9, 9)), np.zeros((9, 9), bool)
    z[:, 5:], objects[:, 5:] = 8.0, True
    z[4, 4] = 1.5
    assert np.argwhere(strays_of(z, objects)).tolist() == [[4, 4]]


def test_step_of_the_terrain_without_an_object_over_it_stays() -> None:
    z = np.zeros((9, 9))
    z[:, 5:] = 1.5
    assert not strays_of(z, np.zeros((9, 9), bool)).any()


def test_single_hole_is_a_pit_and_a_ditch_is_not() -> None:
    z = np.zeros((12, 12))
    z[3, 3] = -1.6
    z[:, 9] = -1.6
    assert np.argwhere(strays_of(z, np.zeros((12, 12), bool))).tolist() == [[3, 3]]


def test_ground_between_objects_alone_is_no_hole() -> None:
    z, objects = np.full((7, 7), 9.0), np.ones((7, 7), bool)
    z[3, 3], objects[3, 3] = 0.0, False
    assert not strays_of(z, objects).any()
