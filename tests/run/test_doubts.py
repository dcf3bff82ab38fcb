"""Doubts of the detector reach the file of the block that they lie in."""

from __future__ import annotations

from pathlib import Path

import pytest

from eaves.model import Block
from eaves.run.block import block_pass
from eaves.run.block_file import BlockFile, save_block
from eaves.run.recipe import make_recipe
from eaves.simulate import nine_roofs_on_a_slope


def test_a_doubt_is_kept_by_the_block_it_lies_in(tmp_path: Path) -> None:
    truth = nine_roofs_on_a_slope(density=4.0)
    middle = truth.cloud.xyz[:, 0].mean()
    cut = truth.cloud.take(truth.cloud.xyz[:, 0] < middle)  # the rim of the data runs through three roofs
    block = Block.at(*cut.origin, 240.0)
    result = block_pass(cut, block, make_recipe())
    assert {doubt.stage for doubt in result.doubts} == {"detect"}
    assert any("rim of the data" in doubt.reason for doubt in result.doubts)
    save_block(tmp_path / "block.npz", result)
    with BlockFile(tmp_path / "block.npz", block) as file:
        found = file.metadata().doubts
    for read, written in zip(found, result.doubts, strict=True):
        assert read.x == pytest.approx(written.x)
        assert read.reason == written.reason
