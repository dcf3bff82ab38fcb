"""The published detectors on scenes with exact truth, and their formulas on exact surfaces."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eaves.detect import Detector, detect_buildings
from eaves.detect.consensus import Consensus
from eaves.detect.toolkit.surface_grid import grow_back, nearest_surface, opened_by_area, share_around
from eaves.geometry.planes import local_planes
from eaves.model.scene import NOISE, TREE, WALL
from eaves.published.chen_sun.planar_patches import PlanarPatches
from eaves.published.maas_vosselman.height_texture import HeightTexture, local_texture
from eaves.published.ren_fcs.detection import Contours, quadratic_gradient, sobel_height
from eaves.published.roof_attributes.detection import RoofAttributes, micro_normals, roughness
from eaves.published.xiao2014.normal_echo import NormalEcho
from eaves.recipe.recipe import make_recipe, sources
from tests.detect.made_scenes import MadeScene, two_houses_and_a_tree

EVERY: list[type[Detector]] = [Contours, RoofAttributes, HeightTexture, NormalEcho]


@pytest.mark.parametrize("cls", EVERY)
@pytest.mark.parametrize("density", [4.0, 12.0])
def test_two_houses_are_found_and_the_tree_is_not(cls: type[Detector], density: float) -> None:
    scene, what = two_houses_and_a_tree(density).scene()
    found = detect_buildings(scene, cls())
    assert found.count == 2
    assert (found.label[what < 0] > 0).mean() < 0.05
    for house in (1, 2):
        assert (found.label[what == house] > 0).mean() > 0.9


@pytest.mark.parametrize("cls", EVERY)
def test_without_returns_the_houses_are_still_found(cls: type[Detector]) -> None:
    scene, what = two_houses_and_a_tree(8.0).scene(returns=False)
    found = detect_buildings(scene, cls())
    assert all((found.label[what == house] > 0).mean() > 0.9 for house in (1, 2))


@pytest.mark.parametrize("cls", EVERY)
def test_bare_land_has_no_building(cls: type[Detector]) -> None:
    scene, _ = MadeScene(density=6.0).scene()
    assert detect_buildings(scene, cls()).count == 0


def plane(a: float, b: float, side: float) -> np.ndarray:
    """Heights (8, 9) of z = ax + by, row 0 north."""
    row, column = np.mgrid[0:8, 0:9]
    return a * column * side - b * row * side


def test_micro_normals_are_those_of_the_plane() -> None:
    normal = micro_normals(plane(0.5, -0.25, 0.7), 0.7)[1:, :-1]
    exact = np.array([-0.5, 0.25, 1.0]) / np.sqrt(1 + 0.25 + 0.0625)
    assert np.allclose(normal, exact)


def test_roughness_is_half_the_twist() -> None:
    assert np.allclose(roughness(plane(0.5, -0.25, 1.0))[1:, :-1], 0.0)
    row, column = np.mgrid[0:5, 0:5]
    assert np.allclose(roughness(0.3 * row * column)[1:, :-1], 0.15)


def test_planes_have_no_quadratic_gradient_and_no_texture() -> None:
    surface = plane(0.8, 0.3, 0.5)
    assert np.allclose(quadratic_gradient(surface)[1:-1, 1:-1], 0.0)
    assert np.allclose(local_texture(surface)[1:-1, 1:-1], 0.0, atol=1e-6)


def test_the_quadratic_gradient_of_a_bowl_is_exact() -> None:
    row, column = np.mgrid[0:7, 0:7]
    bowl = 0.5 * (0.2 * column**2 + 0.1 * row**2) + 0.05 * row * column
    exact = np.sqrt(0.2**2 + 0.1**2 + 2 * 0.05**2)
    assert np.allclose(quadratic_gradient(bowl)[1:-1, 1:-1], exact)


def test_the_texture_of_noise_is_its_deviation() -> None:
    noise = np.random.default_rng(2).normal(0.0, 0.3, (200, 200))
    assert np.sqrt((local_texture(noise) ** 2).mean()) == pytest.approx(0.3 * np.sqrt(6 / 9), rel=0.03)


def test_sobel_measures_the_step() -> None:
    step = np.zeros((6, 6))
    step[:, 3:] = 4.0
    assert sobel_height(step)[3].max() == pytest.approx(4.0)


def test_growth_stops_at_steps_and_at_the_rim() -> None:
    surface = np.zeros((5, 9))
    surface[:, 6:] = 5.0
    core = np.zeros((5, 9), bool)
    core[2, 2] = True
    allowed = np.ones((5, 9), bool)
    grown = grow_back(core, allowed, surface, 1.0, 20)
    assert grown[:, :6].all()
    assert not grown[:, 6:].any()
    assert grow_back(core, allowed, surface, 1.0, 1).sum() == 5


def test_shares_around_are_counted_among_the_cells_that_matter() -> None:
    among = np.zeros((9, 9), bool)
    among[:, 2:] = True
    mask = np.zeros((9, 9), bool)
    mask[:, :4] = True
    share = share_around(mask, among, 3)
    assert share[4, 0] == 0.0
    assert share[4, 2] == 1.0
    assert share[4, 3] == pytest.approx(2 / 3)


def test_opening_by_area_keeps_the_large() -> None:
    mask = np.zeros((6, 6), bool)
    mask[0, :2], mask[3:5, 3:5] = True, True
    assert opened_by_area(mask, 3).sum() == 4


def test_the_nearest_surface_keeps_the_jump() -> None:
    made = MadeScene(density=2.0)
    made.box(20.0, 20.0, 40.0, 40.0, 9.0, 1)
    scene, _ = made.scene()
    grid = nearest_surface(scene, 0.5)
    assert grid is not None
    heights = grid.surface[np.isfinite(grid.surface)]
    assert ((np.abs(heights) < 0.2) | (np.abs(heights - 9.0) < 0.2)).all()


def test_normals_are_those_of_a_plane_and_a_ball_is_curved() -> None:
    rng = np.random.default_rng(3)
    flat = np.c_[rng.uniform(0, 10, (800, 2)), np.zeros(800)]
    flat[:, 2] = 0.5 * flat[:, 0]
    near = local_planes(flat, 16, 16)
    assert np.allclose(near.normals[:, 2], 1 / np.sqrt(1.25), atol=1e-3)
    assert near.curvature.max() < 1e-3
    assert np.median(local_planes(rng.normal(0, 1, (800, 3)), 16, 16).curvature) > 0.08


def test_curvature_is_equation_3_on_a_cloud_of_known_eigenvalues() -> None:
    """λ₀/(λ₀+λ₁+λ₂) of eigenvalues 0.04, 1 and 4: 0.0079; the same of their roots would be 0.063."""
    deviation = np.array([0.2, 1.0, 2.0])
    corners = np.stack(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0]), -1).reshape(-1, 3) * deviation
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    near = local_planes(corners @ turn.T + [4_310.0, 9_170.0, 850.0], 8, 8)
    assert np.allclose(near.eigenvalues, deviation**2)
    assert np.allclose(near.curvature, 0.04 / 5.04)


def test_walls_and_trees_are_kept_as_parts() -> None:
    made = two_houses_and_a_tree(12.0)
    y = made.rng.uniform(35.0, 45.0, 900)
    made.add(np.c_[np.full(900, 34.98), y], made.rng.uniform(1.2, 5.5, 900), 3)
    scene, what = made.scene()
    found = detect_buildings(scene, NormalEcho())
    assert found.part is not None
    assert (found.part[what == 3] == WALL).mean() > 0.8
    assert np.isin(found.part[what < 0], (WALL, TREE, NOISE)).mean() > 0.7
    assert (found.part[what < 0] == TREE).mean() > 0.2
    assert (found.label[what == 3] > 0).mean() > 0.7


HARD = {
    "one": np.array([[5.0, 5.0, 9.0]]),
    "two": np.array([[5.0, 5.0, 9.0], [6.0, 5.0, 9.0]]),
    "collinear": np.c_[np.linspace(5, 25, 60), np.full(60, 5.0), np.full(60, 9.0)],
    "upright": np.c_[np.full((60, 2), 5.0), np.linspace(3, 25, 60)],
    "duplicate": np.tile([[5.0, 5.0, 9.0]], (60, 1)),
}


@pytest.mark.parametrize("points", list(HARD))
@pytest.mark.parametrize("cls", [*EVERY, PlanarPatches, Consensus])
@pytest.mark.parametrize("land", [True, False])
def test_hard_points_give_no_building_and_no_traceback(cls: type[Detector], points: str, land: bool) -> None:
    made = MadeScene(density=2.0 if land else 0.0, size=30.0)
    made.add(HARD[points][:, :2], HARD[points][:, 2], 1)
    scene, _ = made.scene()
    assert detect_buildings(scene, cls()).count == 0


def test_gradient_density_is_of_a_segment_as_published_and_of_a_window_by_default() -> None:
    """A house that a much larger crown touches is one segment with it."""
    made = MadeScene(density=12.0, size=60.0)
    made.box(30.0, 30.0, 40.0, 40.0, 6.0, 1)
    crown = made.scatter(40.0, 24.0, 58.0, 46.0)
    made.add(crown, made.rng.uniform(3.0, 14.0, len(crown)), -1)
    scene, what = made.scene()
    house = what == 1
    printed = detect_buildings(scene, RoofAttributes.as_published())
    ours = detect_buildings(scene, RoofAttributes())
    assert (ours.label[house] > 0).mean() > 0.8
    assert (printed.label[house] > 0).mean() < 0.2


@pytest.mark.parametrize("late", [False, True])
def test_the_operators_follow_one_another_as_printed__or_open_last(late: bool) -> None:
    """A wing narrower than the opening is none of the opened groups as printed, and one by default."""
    made = MadeScene(density=12.0)
    made.box(20.0, 20.0, 32.0, 32.0, 6.0, 1)
    made.box(32.0, 24.5, 44.0, 27.5, 6.0, 2)
    scene, _ = made.scene()
    steps: dict[str, Any] = {}
    detect_buildings(scene, RoofAttributes(late_opening=late, min_width=5.0), debug=steps.__setitem__)
    groups = steps["opened groups"]
    row, column = groups.cell_of(np.array([[38.0, 26.0], [26.0, 26.0]]))
    assert groups.values[row, column].tolist() == [late, True]


@pytest.mark.parametrize("published", [False, True])
def test_the_limits_of_a_run_are_off_as_published(published: bool) -> None:
    for source in sources():
        assert (make_recipe(source=source, published=published).smallest == (0.0, 0.0)) == published
