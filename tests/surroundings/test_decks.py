"""Bridges are decks, neither ground nor building; dikes, terraces, roofs and gaps between strips are none."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pyogrio.raw
import pytest
from tests.conftest import build_in_blocks, write_laz

import eaves
from eaves.model import BRIDGE_DECK, GROUND, Grid, Mask
from eaves.simulate import scan_town, simulate_town, write_simulation
from eaves.surroundings.decks import find_decks

CELL = 1.5
SHAPE = 120, 120
ROWS, COLUMNS = np.indices(SHAPE).astype(float)
VALLEY = (COLUMNS >= 50) & (COLUMNS < 70)
DECK = VALLEY & (ROWS >= 40) & (ROWS < 44)


def decks_in(heights: Grid, roofs: Mask | None = None) -> Mask:
    noise = np.random.default_rng(5).normal(0.0, 0.02, SHAPE)
    none = np.zeros(SHAPE, bool) if roofs is None else roofs
    return np.isfinite(find_decks((heights + noise).astype(np.float32), CELL, none)[0])


def test_a_bridge_over_a_cutting_is_a_deck() -> None:
    found = decks_in(np.where(VALLEY & ~DECK, -6.0, 0.0))
    assert found[DECK].all()
    assert found[~DECK].mean() < 0.005


@pytest.mark.parametrize("angle", [10.0, 27.0, 45.0, 63.0])
def test_a_footbridge_two_cells_wide_is_a_deck_at_any_angle(angle: float) -> None:
    x, y = COLUMNS - 60, ROWS - 60
    along = x * np.cos(np.radians(angle)) + y * np.sin(np.radians(angle))
    across = y * np.cos(np.radians(angle)) - x * np.sin(np.radians(angle))
    river, deck = np.abs(along) < 25, np.abs(across) < 1.3
    found = decks_in(np.where(river & ~deck, -5.0, 0.0))
    assert found[river & deck].mean() > 0.9
    assert found[~deck & (np.abs(across) > 3.0)].mean() < 0.002


@pytest.mark.parametrize("depth", [1.0, 3.0])
def test_a_bridge_over_water_that_returns_nothing_is_a_deck(depth: float) -> None:
    bank = (COLUMNS >= 48) & (COLUMNS < 72) & ~VALLEY
    heights = np.where(VALLEY & ~DECK, np.nan, np.where(bank, -depth, 0.0))
    heights[DECK | (bank & (ROWS >= 40) & (ROWS < 44))] = 0.0
    found = decks_in(heights)
    assert found[DECK].all()
    assert found[~DECK & ~bank].mean() < 0.005


def test_neither_dike_terrace_roof_nor_gap_is_a_deck() -> None:
    dike = np.clip(4.0 - np.abs(COLUMNS - 60.0) * 0.75, 0.0, 3.0)  # one in two
    assert not decks_in(dike).any()
    terrace = np.where((COLUMNS > 40) & (ROWS > 40), 3.0, 0.0)
    assert not decks_in(terrace).any()
    row_of_houses = np.where((ROWS >= 50) & (ROWS < 57) & (COLUMNS > 20) & (COLUMNS < 100), 6.0, 0.0)
    assert not decks_in(row_of_houses).any()
    gaps = np.where(COLUMNS % 15 < 5, np.nan, 0.05 * CELL * ROWS)
    assert not decks_in(gaps).any()


def test_a_house_that_a_slope_carries_on_at_one_end_is_a_doubt_and_no_deck() -> None:
    slope = np.clip(0.3 * (60.0 - ROWS), 0.0, 6.0)
    house = (COLUMNS >= 55) & (COLUMNS < 60) & (ROWS >= 40) & (ROWS < 75)
    level, doubts = find_decks(np.where(house, 6.0, slope).astype(np.float32), CELL, np.zeros(SHAPE, bool))
    assert not np.isfinite(level).any()
    assert [doubt.reason.split(":")[0] for doubt in doubts] == ["a bridge or a building"]


@pytest.fixture(scope="module")
def survey(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A footbridge 4 m wide over a valley 150 m wide, and a house; three points in two square metres."""
    rng = np.random.default_rng(3)
    x, y = (rng.uniform(0.0, side, 45_000) for side in (300.0, 100.0))
    valley = np.abs(x - 150.0) < 75.0
    bridge = valley & (np.abs(y - 50.0 - 0.1 * (x - 150.0)) < 2.0)
    house = (np.abs(x - 30.0) < 8.0) & (np.abs(y - 80.0) < 6.0)
    z = np.where(valley & ~bridge, -8.0, 0.0) + np.where(house, 6.0, 0.0) + rng.normal(0.0, 0.02, len(x))
    path = tmp_path_factory.mktemp("bridge") / "bridge.laz"
    xyz = np.column_stack([x + 600_000.0, y + 5_000_000.0, z + 20.0])
    write_laz(path, xyz, 32631, user_data=np.where(bridge, 1, np.where(house, 2, 0)))
    return path


@pytest.mark.slow
def test_a_footbridge_is_no_building_whatever_the_blocks_are(survey: Path, tmp_path: Path) -> None:
    found = []
    for block in (60.0, 240.0):
        folder = tmp_path / f"{block:.0f}"
        summary = build_in_blocks(block, survey, folder, eaves.make_recipe(lod="0"))
        assert summary.found == 1
        found.append(np.asarray(laspy.read(folder / "classified.laz").classification))
    assert (found[0] == found[1]).mean() > 0.999
    kind = np.asarray(laspy.read(survey).user_data)
    assert (found[1][kind == 1] == 17).mean() > 0.97
    assert (found[1][kind == 0] == 17).mean() < 0.01
    assert (found[1][kind == 2] == 6).mean() > 0.97


@pytest.mark.slow
def test_no_output_changes_another(survey: Path, tmp_path: Path) -> None:
    written = []
    for name, outputs in (("all", ("footprints", "models", "mask", "classified")), ("one", ("footprints",))):
        assert eaves.build(survey, tmp_path / name, outputs=outputs).found == 1
        _, _, shapes, columns = pyogrio.raw.read(tmp_path / name / "footprints.gpkg", layer="footprints")
        written.append((shapes.tolist(), repr([column.tolist() for column in columns])))
    assert written[0] == written[1]


@pytest.mark.slow
def test_without_classes_of_their_own_decks_stay_what_they_were(survey: Path, tmp_path: Path) -> None:
    recipe = eaves.make_recipe(lod="0", classes=(2, 6))
    eaves.build(survey, tmp_path, recipe)
    classes = np.asarray(laspy.read(tmp_path / "classified.laz").classification)
    assert set(np.unique(classes)) <= {1, 2, 6, 7, 18}


@pytest.mark.slow
def test_echoes_that_came_late_make_no_deck_of_the_ground_over_them(tmp_path: Path) -> None:
    """Clusters of up to 20 points, .2 to 5 m and more under the ground: .5 % of a drawn town."""
    scene = scan_town(simulate_town(0.015, seed=7), 8.0, 0.03, seed=7)
    las = laspy.read(write_simulation(scene, tmp_path / "in")["points"])
    xyz, rng = np.column_stack([las.x, las.y, las.z]), np.random.default_rng(5)
    ground, late = xyz[np.asarray(las.classification) == GROUND], np.zeros((0, 3))
    while len(late) < 0.005 * len(xyz):
        size, depth = int(rng.integers(1, 21)), 0.2 + rng.gamma(1.6, 1.0)
        off = np.column_stack([rng.uniform(-1.0, 1.0, (size, 2)), -depth - rng.uniform(0.0, 0.4, size)])
        late = np.vstack([late, ground[rng.integers(len(ground))] + off])
    points = np.vstack([xyz, late])
    eaves.build(points, tmp_path / "out", outputs=("classified",), jobs=1, crs="metres")
    classes = np.asarray(laspy.read(tmp_path / "out" / "classified.laz").classification)
    assert len(classes) == len(points) and not (classes == BRIDGE_DECK).any()
