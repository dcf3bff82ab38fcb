"""Keys: everything that decides a result is in the key of its step."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
import shapely

from eaves import pipeline
from eaves.buildings import owned
from eaves.flow.corrected import EDITED
from eaves.flow.step import STEPS
from eaves.formats import InputError
from eaves.recipe.recipe import Recipe
from eaves.run.keys import key_of

FOLLOWING = {
    "sees_wide": "ground",
    "wide_buffer": "ground",
    "scene_buffer": "detect",
    "marks_vegetation": "vegetation",
    "marks_others": "others",
    "keeps_low": "lod",
}
"""What steps read of a recipe that follows from its fields."""


def test_every_parameter_is_read_by_a_step() -> None:
    read = {FOLLOWING.get(name, name) for step in (*STEPS, EDITED) for name in step.reads}
    of_run = {"generations", "snap_footprints", "blur", "classes_only", "side", "window", "fields"}
    assert {field.name for field in fields(Recipe)} == read - of_run


def test_a_key_tells_values_apart_to_the_last_bit() -> None:
    values = [
        *(np.zeros(3), np.zeros(3, np.float32), np.zeros((3, 1)), np.array([0.0, 0.0, -0.0])),
        *(
            None,
            "None",
            1,
            1.0,
            (1, 2),
            ((1,), 2),
            {"a": 1},
            shapely.box(0, 0, 1, 1),
            shapely.box(0, 0, 1, 2),
        ),
    ]
    assert len({key_of(value) for value in values}) == len(values)
    assert key_of(np.zeros(4)[::2]) == key_of(np.zeros(2))


@pytest.mark.slow
def test_another_level_finds_the_blocks_of_a_run_that_was_stopped(
    nine_roofs_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as change:
        change.setattr(pipeline, "write_outputs", lambda *words, **named: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            pipeline.build(nine_roofs_file, tmp_path, lod="1.2")
    kept = tmp_path / ".eaves-work"
    before = {path: path.stat().st_mtime_ns for path in kept.glob("regions/*.part")}
    made = []
    real = owned.building_pass
    monkeypatch.setattr(owned, "building_pass", lambda *words: made.append(1) or real(*words))
    summary = pipeline.build(nine_roofs_file, tmp_path, lod="1.3", resume=True, keep=True)
    assert summary.complete and summary.found == 9 and made
    assert {path: path.stat().st_mtime_ns for path in kept.glob("regions/*.part")} == before != {}


def test_what_another_version_left_is_refused_in_one_line(nine_roofs_file: Path, tmp_path: Path) -> None:
    (tmp_path / ".eaves-work").mkdir()
    (tmp_path / ".eaves-work" / "plan.json").write_text("{}")
    with pytest.raises(InputError, match="another version of eaves wrote; run without --resume"):
        pipeline.build(nine_roofs_file, tmp_path, resume=True)
    assert pipeline.build(nine_roofs_file, tmp_path, lod="0").complete
