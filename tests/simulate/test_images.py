"""What matching makes of images of a town: the surface itself, and what each parameter takes from it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
from tests.conftest import but_first
from tests.simulate.test_scanner import house, leaves, town_of

import eaves
from eaves.model import BUILDING
from eaves.simulate import Matching, match_images, scan_town, simulate_town, write_simulation
from eaves.simulate.images import RANGES
from eaves.simulate.objects.exact import ExactScene

COLOURS = ("red", "green", "blue")


def fit_error(scene: ExactScene) -> float:
    """What planes fitted to pieces of 3 × 4 m of roofs leave (m), in the median."""
    left, xyz = [], scene.cloud.xyz
    for number, face in scene.faces.items():
        inner = shapely.buffer(face.polygon, -1.5)
        on = xyz[scene.plane == number]
        on = on[shapely.contains_xy(inner, on[:, 0], on[:, 1])]
        _, piece = np.unique(np.floor(on[:, :2] / (3.0, 4.0)), axis=0, return_inverse=True)
        for one in range(piece.max(initial=-1) + 1):
            some = on[piece.ravel() == one]
            if len(some) > 40:
                terms = np.column_stack([some[:, :2] - some[:, :2].mean(axis=0), np.ones(len(some))])
                fitted = terms @ np.linalg.lstsq(terms, some[:, 2], rcond=None)[0]
                left.append(float(np.sqrt(np.mean((some[:, 2] - fitted) ** 2))))
    return float(np.median(left))


def test_without_blur_and_noise_it_is_the_surface() -> None:
    town = town_of(house(0.5))
    scene, height = match_images(town, Matching(), 1), np.full(0, 0.0)
    for number, face in scene.faces.items():
        on = scene.cloud.xyz[scene.plane == number]
        assert len(on) > 100 and shapely.contains_xy(shapely.buffer(face.polygon, 1e-6), *on[:, :2].T).all()
        height = np.append(height, on[:, 2] - face.height_at(on))
    assert np.abs(height).max() < 1e-3
    assert np.abs(scene.cloud.xyz[scene.building == 0, 2] - 5.0).max() < 1e-3


def test_crowns_are_closed_and_flat_where_their_leaves_end() -> None:
    scene = match_images(town_of(foliage=leaves(0.3)), Matching(), 1)
    crown = (np.abs(scene.cloud.xyz[:, :2] - 30.0) < 8.0).all(axis=1)
    assert (scene.truth_class[crown] == 5).all() and (scene.truth_class[~crown] == 2).all()
    assert np.abs(scene.cloud.xyz[crown, 2] - 12.0).max() < 1e-3


def test_density_is_what_was_asked_for_and_every_point_is_a_single_return() -> None:
    scene = match_images(town_of(), Matching(density=7.0), 1)
    assert len(scene.cloud) / 3600.0 == pytest.approx(7.0, rel=0.02)
    assert scene.cloud.number_of_returns is not None and (scene.cloud.number_of_returns == 1).all()
    assert scene.strip is None and scene.time_s is None


def test_blur_keeps_the_volume_and_makes_walls_slopes() -> None:
    sharp, blurred = (match_images(town_of(house()), Matching(blur=blur), 1).cloud.xyz for blur in (0.0, 2.0))
    assert np.array_equal(sharp[:, :2], blurred[:, :2])
    assert blurred[:, 2].sum() == pytest.approx(sharp[:, 2].sum(), rel=2e-3)
    assert np.mean((blurred[:, 2] > 6.0) & (blurred[:, 2] < 10.0)) > 0.03
    assert np.mean((sharp[:, 2] > 6.0) & (sharp[:, 2] < 10.0)) == 0.0


def test_errors_have_the_deviations_that_were_asked_for() -> None:
    alone = match_images(town_of(), Matching(noise=0.05), 1).cloud.xyz[:, 2]
    shared = match_images(town_of(), Matching(ripple=0.2), 1).cloud.xyz[:, 2]
    assert alone.std() == pytest.approx(0.05, rel=0.05)
    assert shared.std() == pytest.approx(0.2, rel=0.1)


@pytest.mark.slow
def test_planes_of_rough_roofs_leave_a_third_of_a_metre_and_more() -> None:
    town = simulate_town(0.0225, seed=1, style="village")
    assert 0.33 < fit_error(match_images(town, "rough", 1)) < 0.47


def test_no_point_lies_beside_walls_where_they_are_hidden() -> None:
    town = town_of(house())
    scene = match_images(town, Matching(density=20.0, hidden=1.0), 1)
    on_ground = scene.cloud.xyz[scene.building == 0]
    distance = shapely.distance(town.buildings[0].footprint, shapely.points(on_ground[:, :2]))
    around = shapely.buffer(town.buildings[0].footprint, 1.0).area - town.buildings[0].footprint.area
    assert np.sum(distance < 1.0) < 0.3 * 20.0 * around
    assert np.mean(distance > 2.5) > 0.5


def test_a_gap_between_crown_and_wall_is_filled() -> None:
    crown = leaves(2.5)
    crown.bodies[0, :2] = 30.0, 46.0
    town = town_of(house(), foliage=crown)
    gap = match_images(town, Matching(melted=6.0), 1)
    filled = gap.truth_class == 1
    plan = match_images(town, Matching(), 1)
    assert filled.any() and not (plan.truth_class == 1).any()
    assert (gap.cloud.xyz[filled, 2] > 8.0).all()
    assert np.array_equal(gap.cloud.xyz[~filled], plan.cloud.xyz[~filled])


@pytest.mark.parametrize("kind", but_first(RANGES))
def test_the_same_seed_gives_the_same_bytes_and_colours_in_range(kind: str, tmp_path: Path) -> None:
    for name in ("one", "two"):
        scene = match_images(simulate_town(0.01, seed=4, style="village"), kind, 4)  # type: ignore[arg-type]
        write_simulation(scene, tmp_path / name)
    for path in (tmp_path / "one").iterdir():
        assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes()
    for colour in COLOURS:
        values = scene.cloud.fields[colour]
        assert values.min() >= 0 and values.max() <= 65535 and (values % 257 == 0).all()
        assert np.ptp(values) > 20_000
    back = eaves.read(tmp_path / "one" / "points.laz", fields=COLOURS)
    assert back.point_id is not None
    for colour in COLOURS:
        assert np.array_equal(back.fields[colour], scene.cloud.fields[colour][back.point_id])


def test_a_roof_has_one_material_and_leaves_are_green() -> None:
    scene = match_images(town_of(house(), foliage=leaves(2.5)), Matching(density=20.0), 2)
    colour = np.column_stack([scene.cloud.fields[name] for name in COLOURS])
    share = colour / colour.sum(axis=1, keepdims=True)
    assert share[scene.truth_class == BUILDING].std(axis=0).max() < 0.02
    assert (share[scene.truth_class == 5].argmax(axis=1) == 1).mean() > 0.9


def test_another_seed_gives_other_points() -> None:
    one, other = (match_images(town_of(house()), "good", seed).cloud.xyz for seed in (1, 2))
    assert not np.array_equal(one[:100], other[:100])


def test_village_has_yards_and_steep_ground_is_steep() -> None:
    town = simulate_town(0.04, seed=3, terrain="steep", style="village")
    ends = town.terrain.heights[[0, 0, -1, -1], [0, -1, 0, -1]]
    assert 0.08 < np.ptp(ends) / (np.sqrt(2.0) * 260.0) < 0.21
    scene = scan_town(town, 2.0, seed=3)
    assert (scene.truth_class == 1).sum() > 20


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="density must be above 0"):
        Matching(density=0.0)
    with pytest.raises(ValueError, match="blur must be at least 0 m"):
        Matching(blur=-1.0)
    with pytest.raises(ValueError, match="one of smooth, rough, good, holes"):
        match_images(town_of(), "sharp", 1)  # type: ignore[arg-type]
