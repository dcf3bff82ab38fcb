"""Nothing follows from how much is loaded at once, and that costs what its points cost."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
import pyogrio.raw
import pytest
import shapely
from tests.conftest import write_laz

from eaves.methods import MethodChoice
from eaves.pipeline import build
from eaves.recipe.recipe import make_recipe
from eaves.simulate.scanner import scan_town
from eaves.simulate.town import simulate_town

SIDES = (120.0, 480.0, 960.0, 5000.0)
PLACE = np.array([600_100.0, 5_000_150.0, 0.0])
"""Corners of squares of any size run through the scene."""


def ground_of(path: Path, folder: Path, side: float, method: MethodChoice = None) -> np.ndarray:
    """Classes (N,) of the points as `eaves ground` finds them where squares of a side (m) are loaded."""
    out = folder / f"{side:g}.laz"
    recipe = replace(make_recipe({"ground": method}, lod="0"), detect=None)
    build(path, folder, recipe, outputs=("classified",), classified=out, block=side)
    return np.asarray(laspy.read(out).classification)


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A town of 250 m on terraces, one point a square metre."""
    scene = scan_town(simulate_town(0.0625, terrain="terraced", seed=2), density=1.0, seed=2)
    path = tmp_path_factory.mktemp("town") / "town.laz"
    write_laz(path, scene.cloud.xyz + PLACE, epsg=32631)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("method", ["adaptive_tin", "smooth_region"])
def test_the_ground_of_a_town_is_the_same_in_all_blocks(town: Path, tmp_path: Path, method: str) -> None:
    expected = ground_of(town, tmp_path, 240.0, method)
    assert 0.3 < (expected == 2).mean() < 0.8
    for side in SIDES if method == "adaptive_tin" else SIDES[-1:]:
        assert np.array_equal(ground_of(town, tmp_path, side, method), expected), side


def test_the_ground_of_a_survey_is_the_same_in_all_blocks(data: Path, tmp_path: Path) -> None:
    sample = np.loadtxt(data / "isprs_filter" / "samp41.txt")
    write_laz(tmp_path / "sample.laz", sample[:, :3], epsg=32632)
    expected = ground_of(tmp_path / "sample.laz", tmp_path, 240.0)
    assert ((expected == 2) != (sample[:, 3] == 0)).mean() < 0.05
    for side in SIDES:
        assert np.array_equal(ground_of(tmp_path / "sample.laz", tmp_path, side), expected), side


@pytest.mark.slow
def test_what_is_written_of_a_town_is_the_same_for_all_blocks(town: Path, tmp_path: Path) -> None:
    def written(side: float) -> list[bytes]:
        folder, outputs = tmp_path / f"{side:g}", ("footprints", "models", "classified")
        assert build(town, folder, make_recipe(lod="1.2"), outputs=outputs, block=side).found > 10
        return [(folder / name).read_bytes() for name in ("buildings.city.jsonl", "classified.laz")]

    expected = written(240.0)
    assert all(written(side) == expected for side in (60.0, 5000.0))


def test_a_wide_block_costs_what_its_points_cost(nine_roofs_file: Path, tmp_path: Path) -> None:
    def seconds(side: float) -> float:
        start = time.process_time()
        summary = build(nine_roofs_file, tmp_path / f"{side:g}", make_recipe(lod="0"), block=side)
        assert summary.found == 9
        return time.process_time() - start

    seconds(240.0)  # compiles
    assert seconds(5000.0) < 2.0 * seconds(240.0) + 1.0


@pytest.mark.slow
def test_houses_in_a_row_are_the_same_in_all_blocks(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    xy = rng.uniform((0.0, 0.0), (70.0, 40.0), (22_400, 2))
    inside = (np.abs(xy[:, 0] - 35.0) < 24.0) & (np.abs(xy[:, 1] - 20.0) < 4.5)
    lift = 0.5 * ((xy[:, 0] - 11.0) // 6.0 % 2)
    z = np.where(inside, 6.0 + lift + 0.8 * (4.5 - np.abs(xy[:, 1] - 20.0)), 0.0)
    points = np.column_stack([xy, z + rng.normal(0.0, 0.02, len(xy))])
    write_laz(tmp_path / "row.laz", points + [600_085.0, 5_000_190.0, 0.0], epsg=32631)

    def houses(side: float) -> list[str]:
        build(tmp_path / "row.laz", tmp_path / f"{side:g}", make_recipe(lod="0"), block=side)
        path = tmp_path / f"{side:g}" / "footprints.gpkg"
        return sorted(shapely.to_wkt(shapely.normalize(one), 3) for one in footprints_of(path))

    expected = houses(240.0)
    assert len(expected) == 8, "seams of blocks of 60 and 120 m run through the row"
    assert all(houses(side) == expected for side in (60.0, 120.0))


def footprints_of(path: Path) -> list[shapely.Geometry]:
    return list(shapely.from_wkb(pyogrio.raw.read(path, layer="footprints", columns=[])[2]))
