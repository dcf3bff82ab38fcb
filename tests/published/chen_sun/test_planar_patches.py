"""Planar patches: the five steps of Chen and Sun on scenes with exact truth."""

from __future__ import annotations

import numpy as np
import pytest

from eaves.detect import detect_buildings
from eaves.detect.toolkit.cells import Cells, side_near
from eaves.geometry.planes import sums_of
from eaves.published.chen_sun.planar_patches import PlanarPatches, merge_mutually
from tests.detect.made_scenes import MadeScene, two_houses_and_a_tree


@pytest.mark.parametrize("density", [2.0, 4.0, 8.0, 25.0])
def test_two_houses_are_found_and_the_tree_is_not(density: float) -> None:
    scene, what = two_houses_and_a_tree(density).scene()
    found = detect_buildings(scene, PlanarPatches())
    assert found.count == 2
    assert not (found.label[what < 0] > 0).any()
    for house in (1, 2):
        numbers, count = np.unique(found.label[what == house], return_counts=True)
        assert count[numbers > 0].max() > 0.9 * (what == house).sum()


def test_defaults_at_the_papers_density_are_the_papers_numbers() -> None:
    made = two_houses_and_a_tree(4.0)
    scene, _ = made.scene()
    assert 0.47 < scene.spacing < 0.53
    assert side_near(3.0 * 0.5) == PlanarPatches.as_published().cell == 1.5
    assert PlanarPatches.as_published().join_points == PlanarPatches().join_points == 10


def test_a_wall_is_no_roof() -> None:
    made = MadeScene(density=8.0)
    y = made.rng.uniform(10.0, 30.0, 2000)
    made.add(np.c_[np.full(2000, 20.2), y], made.rng.uniform(2.5, 8.0, 2000), 1)
    scene, _ = made.scene()
    assert detect_buildings(scene, PlanarPatches()).count == 0


def test_coplanar_patches_merge_to_one_and_a_step_stays_apart() -> None:
    x, y = np.meshgrid(np.arange(0.1, 8.0, 0.2), np.arange(0.1, 1.0, 0.2))
    z = np.where(x < 4.0, 0.1 * x, 5.0)
    group = np.floor(x).astype(int).ravel()
    sums = sums_of(np.c_[x.ravel(), y.ravel(), z.ravel()], group, 8)
    _, root = merge_mutually(sums, np.arange(7), np.arange(1, 8), 0.1)
    assert root.tolist() == [0, 0, 0, 0, 4, 4, 4, 4]


def test_cells_hold_their_points_and_a_margin() -> None:
    xyz = np.array([[0.1, 0.1, 1.0], [0.9, 0.2, 3.0], [5.5, 4.5, 2.0]])
    cells = Cells.of(xyz, 1.0)
    assert cells.shape == (7, 8)
    assert cells.count[cells.cell].tolist() == [2, 2, 1]
    assert cells.extreme(xyz[:, 2])[cells.cell].tolist() == [3.0, 3.0, 2.0]
    which, point = cells.points_of(cells.cell[[2, 0]])
    assert which.tolist() == [0, 1, 1]
    assert point.tolist() == [2, 0, 1]
    assert np.allclose(cells.centres(cells.cell[:1]), [[0.5, 0.5]])


def test_points_near_a_plane_are_its_own_in_cells_that_do_not_join__and_alone_as_published() -> None:
    """Step 4: a roof ends in a cell in which a quarter of the points, fewer than ten, lie on its plane."""
    made = MadeScene(density=4.0)
    made.box(30.0, 30.0, 45.0, 42.0, 6.0, 1)
    lone = np.c_[45.3 + 0.1 * np.arange(3.0), 36.1 + 0.3 * np.arange(3.0)]
    made.add(lone, np.full(3, 6.0), 2)
    for number, (x, y) in ((-1, (45.1, 36.0)), (-2, (37.0, 36.0))):  # beside the roof, and over it
        made.add(made.rng.uniform((x, y), (x + 1.3, y + 1.4), (9, 2)), made.rng.uniform(7.0, 9.0, 9), number)
    scene, what = made.scene()
    near = np.abs(scene.cloud.xyz[:, 2] - 6.0) < 0.05
    printed = detect_buildings(scene, PlanarPatches.as_published(), min_area=0.0, min_height=0.0)
    filled = detect_buildings(scene, PlanarPatches(cell=1.5))
    assert (printed.label[(what == 2) & near] > 0).all()
    assert not (printed.label[what < 0] > 0).any()
    assert (filled.label[what == -2] > 0).all()
    for found in (printed, filled):
        assert (found.label[what == 1] > 0).mean() > 0.9
