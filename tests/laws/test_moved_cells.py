"""What holds of detection wherever its cells begin: a town moved by a part of a cell, mirrored or shaken by
two millimetres has the same buildings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from eaves import make_scene
from eaves.detect import detect_buildings
from eaves.model import Mask, Points, Scene
from eaves.simulate import simulate_town
from eaves.simulate.scanner import scan_town

MOVES: dict[str, Callable[[Points], Points]] = {
    "moved by parts of a cell": lambda xyz: xyz + [0.13, 0.29, 0.0],
    "moved by half a cell": lambda xyz: xyz + [0.3, 0.3, 0.0],
    "mirrored": lambda xyz: xyz * [-1.0, 1.0, 1.0] + [0.37, 0.0, 0.0],
    "shaken by 2 mm": lambda xyz: xyz + np.random.default_rng(1).normal(0.0, 0.002, xyz.shape),
}
"""Ways to move points (N, 3)."""


@pytest.fixture(scope="module")
def scene() -> Scene:
    """A hectare of a town with trees, four points a square metre, its ground known."""
    cloud = scan_town(
        simulate_town(0.01, seed=5, terrain="hilly", style="mixed"), 4.0, 0.02, seed=5
    ).classified()
    return make_scene(cloud, cloud.bounds)


def found_in(scene: Scene, move: Callable[[Points], Points] = lambda xyz: xyz) -> Mask:
    """The points (N,) of buildings when all are moved and keep their heights over the terrain."""
    moved = replace(scene, cloud=scene.cloud.with_(xyz=move(scene.cloud.xyz)))
    return detect_buildings(moved).label > 0


@pytest.mark.parametrize("way", MOVES)
def test_the_points_of_buildings_stay__wherever_cells_begin(scene: Scene, way: str) -> None:
    before, after = found_in(scene), found_in(scene, MOVES[way])
    assert before.sum() > 1000
    assert (before & after).sum() >= 0.98 * (before | after).sum()
