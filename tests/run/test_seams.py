"""Vertical steps between files: said where there is one, with its metres, and not on slopes or at walls."""

from __future__ import annotations

import json
import logging
from itertools import pairwise
from pathlib import Path

import laspy
import numpy as np
import pytest
from tests.conftest import build_in_blocks, but_first

from eaves.blocks.seams import compare_heights, find_steps, shared_places
from eaves.model import Block, Points
from eaves.simulate import nine_roofs_on_a_slope, write_simulation

BLOCK = Block(0, 0, 240.0)


def ground(west: float, east: float, seed: int, slope: float = 0.0, density: float = 4.0) -> Points:
    """Points of a plane that rises to the east, with 3 cm of noise."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform((west, 0), (east, 240), (round((east - west) * 240 * density), 2))
    return np.column_stack([xy, slope * xy[:, 0] + rng.normal(0.0, 0.03, len(xy))])


@pytest.mark.parametrize("slope", [0.0, 0.4])
@pytest.mark.parametrize(("west", "density"), but_first([(60.0, 1.0), (100.0, 4.0), (101.5, 20.0)]))
@pytest.mark.parametrize("lift", but_first([0.0, 0.3, -43.0], 2))
def test_a_step_is_found_on_any_slope(lift: float, west: float, density: float, slope: float) -> None:
    """Of files that overlap, adjoin, or leave a gap."""
    first, second = ground(0, 100, 1, slope), ground(west, 200, 2, slope, density) + (0, 0, lift)
    steps = find_steps([compare_heights(BLOCK, {3: [first], 7: [second]})])
    if not lift:
        assert not steps
        return
    [(metres, a, b, places)] = steps
    assert (a, b) == (3, 7) and places > 50
    assert metres == pytest.approx(lift, abs=0.02)


def test_a_kerb_and_a_wall_along_part_of_a_seam_are_no_steps() -> None:
    first, second = ground(0, 100, 1), ground(100, 200, 2)
    second[:, 2] += 0.12 + np.where(second[:, 1] < 80, 2.0, 0.0)
    assert not find_steps([compare_heights(BLOCK, {0: [first], 1: [second]})])


def test_a_field_of_crops_is_no_step() -> None:
    first, second = ground(0, 100, 1), ground(60, 200, 2)
    second[:, 2] += np.random.default_rng(3).uniform(0.0, 4.0, len(second))
    assert not find_steps([compare_heights(BLOCK, {0: [first], 1: [second]})])


def test_only_boxes_that_meet_share_places() -> None:
    boxes = np.array([(0.0, 0, 100, 240), (100, 0, 200, 240), (208, 0, 240, 240)])
    assert shared_places(boxes[:1], BLOCK) is None
    assert shared_places(boxes[1:], BLOCK) is None
    west, south, east, north = shared_places(boxes[:2], BLOCK) or ()
    assert (west, east) == (94.0, 106.0) and south < 0 and north > 240


@pytest.fixture(scope="module")
def quarters(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Four tiles of a scene, the third one .4 m too high; seams that lie on those of blocks, too."""
    folder = tmp_path_factory.mktemp("quarters")
    las = laspy.read(write_simulation(nine_roofs_on_a_slope(), folder / "scan")["points"])
    x, y = np.asarray(las.x), np.asarray(las.y)
    columns, rows = ((low := values.min(), (low + values.max()) / 2, np.inf) for values in (x, y))
    paths = []
    for west, east in pairwise(columns):
        for south, north in pairwise(rows):
            part = laspy.LasData(las.header)
            part.points = las.points[(x >= west) & (x < east) & (y >= south) & (y < north)].copy()
            if len(paths) == 2:
                part.points["Z"] += round(0.4 / las.header.scales[2])
            paths.append(folder / f"tile_{len(paths)}.laz")
            part.write(paths[-1])
    return paths


@pytest.mark.slow
@pytest.mark.parametrize("tiles", [False, True])
def test_the_run_says_both_files_and_metres(
    tiles: bool, quarters: list[Path], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING, "eaves")
    summary = build_in_blocks(
        60.0, quarters, tmp_path / "out", tile_blocks=2, outputs=("footprints",), per_tile=tiles
    )
    remarks = json.loads((tmp_path / "out/run.json").read_text(encoding="utf-8"))["remarks"]
    [said] = [remark for remark in remarks if "vertical step" in remark]
    assert "tile_2.laz lies 0.4" in said and "1 more pairs of files differ" in said
    assert said in caplog.text and said in str(summary)
