"""A hall wider than a block stands on the terrain, whatever the blocks are."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest
from tests.conftest import build_in_blocks, write_laz

import eaves

SIDE, HALL = 240.0, (60.0, 180.0)
PLACE = 600_000.0, 5_000_000.0


@pytest.fixture(scope="module")
def survey(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A hall of 120 by 120 m on a slope; one point a metre."""
    rng = np.random.default_rng(3)
    xy = np.stack(np.meshgrid(np.arange(0.5, SIDE), np.arange(0.5, SIDE)), axis=-1).reshape(-1, 2)
    xy += rng.uniform(-0.3, 0.3, xy.shape)
    hall = ((xy > HALL[0]) & (xy < HALL[1])).all(axis=1)
    z = np.where(hall, 30.0, 0.05 * xy[:, 0]) + rng.normal(0.0, 0.02, len(xy))
    path = tmp_path_factory.mktemp("hall") / "hall.laz"
    write_laz(path, np.column_stack([xy + PLACE, z]), 32631, user_data=hall)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("block", [60.0, pytest.param(240.0, marks=pytest.mark.slow)])
def test_a_hall_wider_than_a_block_is_one_building(survey: Path, tmp_path: Path, block: float) -> None:
    summary = build_in_blocks(block, survey, tmp_path, eaves.make_recipe(lod="0"))
    assert summary.found == 1
    las = laspy.read(tmp_path / "classified.laz")
    hall, classes = np.asarray(las.user_data) == 1, np.asarray(las.classification)
    assert (classes[hall] == 6).mean() > 0.97
    assert (classes[~hall] == 2).mean() > 0.99
