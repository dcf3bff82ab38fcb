"""Points lie where the pulses met the town, and know what they met."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely

from eaves.model import Bounds
from eaves.simulate import DEVELOPMENT_SCENES, JUDGING_SCENES, Flight, Scanner, scan_town, simulate_town
from eaves.simulate.objects.exact import ExactBuilding, ExactScene
from eaves.simulate.objects.houses import gable, make_building, shifted_masses
from eaves.simulate.objects.surfaces import (
    BLOCK,
    MARGIN,
    Foliage,
    ScannedSurfaces,
    Terrain,
    building_surfaces,
)
from eaves.simulate.ray_grid import index_town
from eaves.simulate.scanner import PENCIL, Receiver, gaussian_beam, trace_pulses
from eaves.simulate.town import Town

SIDE = 60.0
EXACT = Scanner(noise=0.0, strip_offset=0.0, outliers=0.0)


def level_ground(height: float = 5.0) -> Terrain:
    count = int(SIDE + 2 * MARGIN)
    heights, water = np.full((count + 1, count + 1), height), np.zeros((count, count), bool)
    return Terrain(heights, water, -MARGIN, -MARGIN)


def town_of(*buildings: ExactBuilding, foliage: Foliage | None = None) -> Town:
    bounds = Bounds(0.0, 0.0, SIDE, SIDE)
    return Town(bounds, level_ground(), buildings, ScannedSurfaces.of([], 0), foliage or Foliage.none())


def house(overhang: float = 0.0) -> ExactBuilding:
    return make_building(shifted_masses(gable(16, 10, 0.8), 30, 30, 11.0, 0.4), 1, 1, "gable", 5.0, overhang)


def leaves(loss: float) -> Foliage:
    body = np.array([[30.0, 30.0, 10.0, 8.0, 8.0, 2.0, 1.0, 0.0, loss]])
    return Foliage(body, np.array([BLOCK], np.int32), np.array([5], np.uint8))


def test_grid_finds_what_every_triangle_one_by_one_finds() -> None:
    town = town_of(house(0.5))
    grid, surfaces = town.ray_grid(), building_surfaces(town.buildings[0])
    rng = np.random.default_rng(1)
    target = np.column_stack([rng.uniform(15, 45, (400, 2)), np.full(400, 8.0)])
    origins = target + np.column_stack([rng.uniform(-300, 300, (400, 2)), np.full(400, 700.0)])
    directions = (target - origins) / np.linalg.norm(target - origins, axis=1, keepdims=True)
    ranges, labels, echoes = trace_pulses(grid, origins, directions, 0.0, PENCIL, Receiver(0.1, 0.0), 0)
    assert (echoes == 1).all()
    nearest = (5.0 - origins[:, 2]) / directions[:, 2]
    for corners in surfaces.corners:
        one, two = corners[1] - corners[0], corners[2] - corners[0]
        p = np.cross(directions, two)
        det = p @ one
        det = np.where(np.abs(det) < 1e-12, np.nan, det)
        u = ((origins - corners[0]) * p).sum(axis=1) / det
        q = np.cross(origins - corners[0], one)
        v = (directions * q).sum(axis=1) / det
        t = q @ two / det
        nearest = np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (t < nearest), t, nearest)
    assert np.abs(ranges[:, 0] - nearest).max() < 1e-6
    assert set(grid.labels[labels[:, 0], 0]) == {2, 6}


@pytest.mark.parametrize("pattern", ["lines", "zigzag", "ellipse", "random"])
def test_roof_points_lie_on_their_plane(pattern: str) -> None:
    scene = scan_town(town_of(house()), 8.0, 0.0, pattern, scanner=EXACT)  # type: ignore[arg-type]
    for number, face in scene.faces.items():
        inner = shapely.buffer(face.polygon, -0.5)
        xyz = scene.cloud.xyz[scene.plane == number]
        xyz = xyz[shapely.contains_xy(inner, xyz[:, 0], xyz[:, 1])]
        assert len(xyz) > 100
        assert np.abs(xyz[:, 2] - face.height_at(xyz)).max() < 2e-3
    assert set(np.unique(scene.building)) == {0, 1}


@pytest.mark.parametrize("pattern", ["lines", "zigzag", "ellipse", "random"])
def test_density_is_what_was_asked_for(pattern: str) -> None:
    scene = scan_town(town_of(), 6.0, pattern=pattern)  # type: ignore[arg-type]
    loose = 0.15 if pattern == "ellipse" else 0.05  # circles crowd at the rim of the strip
    assert len(scene.cloud) / SIDE**2 == pytest.approx(6.0, rel=loose)


def test_noise_is_what_was_asked_for() -> None:
    scene = scan_town(town_of(), 6.0, 0.05, scanner=Scanner(strip_offset=0.0, outliers=0.0))
    assert scene.cloud.xyz[:, 2].std() == pytest.approx(0.05, rel=0.1)


def test_slanting_pulses_see_walls_and_leave_shadows() -> None:
    slanting = scan_town(town_of(house()), 8.0, 0.0, scanner=EXACT, flight=Flight(half_angle_deg=30))
    steep = scan_town(town_of(house()), 8.0, 0.0, "random", scanner=EXACT)
    on_wall = (slanting.building > 0) & (slanting.plane == 0)
    assert on_wall.sum() > 50
    assert not ((steep.building > 0) & (steep.plane == 0)).any()
    distance = shapely.distance(
        shapely.boundary(slanting.buildings[0].footprint), shapely.points(slanting.cloud.xyz[on_wall][:, :2])
    )
    assert np.quantile(distance, 0.95) < 0.3


def test_beam_at_an_edge_gives_two_returns() -> None:
    scene = scan_town(town_of(house(0.5)), 20.0, 0.0, scanner=EXACT)
    of = scene.cloud.number_of_returns
    assert of is not None
    assert scene.cloud.return_number is not None
    several = scene.cloud.xyz[(of > 1) & (scene.cloud.return_number == 1)]
    edge = shapely.boundary(scene.buildings[0].footprint)
    assert len(several) > 20
    assert np.quantile(shapely.distance(edge, shapely.points(several[:, :2])), 0.9) < 1.0


def test_leaves_let_part_of_the_pulses_through() -> None:
    thin, dense = (scan_town(town_of(foliage=leaves(loss)), 10.0, scanner=EXACT) for loss in (0.3, 6.0))

    def below(scene: ExactScene) -> float:
        inner = Bounds(24, 24, 36, 36).contains(scene.cloud.xyz)
        return float(np.mean(scene.truth_class[inner] == 2))

    assert 0.1 < below(dense) < below(thin) < 0.9
    assert thin.cloud.number_of_returns is not None and thin.cloud.number_of_returns.max() >= 3


def test_returns_of_a_pulse_are_counted_from_the_top() -> None:
    scene = scan_town(town_of(foliage=leaves(0.5)), 10.0, scanner=EXACT)
    number, of = scene.cloud.return_number, scene.cloud.number_of_returns
    assert number is not None and of is not None and (number <= of).all() and (number >= 1).all()
    follows = (number[1:] == number[:-1] + 1) & (of[1:] == of[:-1])
    assert (np.diff(scene.cloud.xyz[:, 2])[follows] < 0).all()


def test_outliers_are_few_and_labelled() -> None:
    scene = scan_town(town_of(house()), 8.0, scanner=Scanner(outliers=1e-3))
    wrong = np.isin(scene.truth_class, (7, 18))
    assert wrong.sum() == round(1e-3 * len(scene.cloud))
    assert (scene.cloud.xyz[scene.truth_class == 7, 2] < 5.0).all()
    assert (scene.cloud.xyz[scene.truth_class == 18, 2] > 15.0).all()
    assert (scene.building[wrong] == 0).all() and (scene.plane[wrong] == 0).all()


def test_strips_overlap_and_differ_in_height() -> None:
    scene = scan_town(town_of(), 4.0, 0.0, scanner=Scanner(strip_offset=0.1, outliers=0.0))
    assert scene.strip is not None
    heights = [scene.cloud.xyz[scene.strip == strip, 2].mean() for strip in np.unique(scene.strip)]
    assert len(heights) >= 2 and np.ptp(heights) > 0.005


def test_same_seed_gives_the_same_points_and_another_seed_others() -> None:
    town = simulate_town(0.01, seed=4)
    one, two, other = (scan_town(town, 2.0, seed=seed) for seed in (1, 1, 2))
    assert np.array_equal(one.cloud.xyz, two.cloud.xyz) and np.array_equal(one.plane, two.plane)
    assert not np.array_equal(one.cloud.xyz[:100], other.cloud.xyz[:100])


def test_empty_town_has_ground_only() -> None:
    scene = scan_town(town_of(), 2.0, scanner=EXACT)
    assert set(np.unique(scene.truth_class)) == {2}


def test_beam_holds_the_whole_energy() -> None:
    assert gaussian_beam()[1].sum() == pytest.approx(1.0)


def test_grid_without_anything_traces_the_terrain() -> None:
    grid = index_town(level_ground(), ScannedSurfaces.of([], 0), Foliage.none())
    down = np.array([[0.0, 0.0, -1.0]])
    ranges, _, echoes = trace_pulses(grid, np.array([[30.0, 30.0, 105.0]]), down, 0.0, PENCIL, Receiver(), 0)
    assert echoes[0] == 1 and ranges[0, 0] == pytest.approx(100.0)


def test_files_are_the_same_for_the_same_seed(tmp_path: Path) -> None:
    from eaves.simulate import write_simulation

    for name in ("one", "two"):
        scene = scan_town(simulate_town(0.01, seed=4), 1.0, seed=4)
        write_simulation(scene, tmp_path / name, {"seed": 4})
    files = sorted(path.name for path in (tmp_path / "one").iterdir())
    assert files == ["points.laz", "reference.city.json", "reference.gpkg", "simulation.json"]
    for name in files:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_judging_scenes_share_no_seed_with_others() -> None:
    judged, open_to_all = {s.seed for s in JUDGING_SCENES}, {s.seed for s in DEVELOPMENT_SCENES}
    assert len(judged) == len(JUDGING_SCENES) and not judged & open_to_all and min(judged) > 9000


@pytest.mark.parametrize("pattern", ["lines", "zigzag", "ellipse", "random"])
def test_scan_too_thin_to_hit_anything_is_empty(pattern: str) -> None:
    scene = scan_town(town_of(), 1e-5, pattern=pattern)  # type: ignore[arg-type]
    assert len(scene.cloud) <= 4 and len(scene.plane) == len(scene.cloud)


def test_density_and_noise_that_cannot_be_are_refused() -> None:
    with pytest.raises(ValueError, match="density must be above 0"):
        scan_town(town_of(), 0.0)
    with pytest.raises(ValueError, match="noise must be at least 0"):
        scan_town(town_of(), 1.0, -0.1)
