"""A second run into a folder loses no person's work and no results of other inputs."""

from __future__ import annotations

import pickle
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from eaves import IncompleteRunError, InputError, Summary
from eaves.change.upkeep.update import update
from eaves.pipeline import build
from eaves.run.options import RunOptions
from tests.conftest import write_laz


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory, nine_roofs_file: Path) -> Path:
    """A run that is kept."""
    folder = tmp_path_factory.mktemp("kept") / "out"
    build(nine_roofs_file, folder, outputs=("footprints", "models"), keep=True)
    return folder


@pytest.fixture
def out(kept: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    return shutil.copytree(kept, tmp_path / "out")


def build_again(file: Path, out: Path, **options: bool) -> Summary:
    return build(file, out, **RunOptions(outputs=("footprints", "models"), keep=True, **options))  # type: ignore[typeddict-item]


def execute(path: Path, *commands: str) -> None:
    with closing(sqlite3.connect(path)) as database:
        for command in commands:
            database.execute(command).fetchall()
        database.commit()


def test_a_second_run_of_the_same_inputs_needs_no_word(nine_roofs_file: Path, out: Path) -> None:
    assert build_again(nine_roofs_file, out).found == 9


def test_edits_stay_unless_overwritten(nine_roofs_file: Path, out: Path, tmp_path: Path) -> None:
    with closing(sqlite3.connect(out / "footprints.gpkg")) as layer:
        (name,) = layer.execute("SELECT id FROM footprints").fetchone()
    (tmp_path / "verdicts.csv").write_text(f"id,verdict\n{name},no building\n")
    assert update(out, edits=tmp_path / "verdicts.csv").summary.found == 8
    before = (out / "edits.gpkg").read_bytes()
    with pytest.raises(InputError, match=r"out: holds edits of \d+ \w+ \d{4}; .* --overwrite"):
        build_again(nine_roofs_file, out)
    assert (out / "edits.gpkg").read_bytes() == before
    assert update(out).summary.found == 8
    assert build_again(nine_roofs_file, out, overwrite=True).found == 9
    assert not (out / "edits.gpkg").exists()


def test_a_column_that_a_person_added_stays(nine_roofs_file: Path, out: Path) -> None:
    execute(out / "footprints.gpkg", "ALTER TABLE footprints ADD COLUMN mine TEXT")
    with pytest.raises(InputError, match=r"footprints.gpkg: was changed since a run wrote it"):
        build_again(nine_roofs_file, out)


def test_a_value_of_the_same_length_stays(nine_roofs_file: Path, out: Path) -> None:
    execute(out / "footprints.gpkg", "UPDATE gpkg_contents SET last_change = '2001-01-01T00:00:00.000Z'")
    with pytest.raises(InputError, match=r"footprints.gpkg: was changed since"):
        build_again(nine_roofs_file, out)


def test_a_layer_that_was_only_shown_is_not_changed(nine_roofs_file: Path, out: Path) -> None:
    before = (out / "footprints.gpkg").read_bytes()
    execute(out / "footprints.gpkg", "PRAGMA journal_mode = WAL", "SELECT * FROM footprints")
    execute(out / "footprints.gpkg", "PRAGMA journal_mode = DELETE")
    assert (out / "footprints.gpkg").read_bytes() != before
    assert build_again(nine_roofs_file, out).found == 9


def test_a_run_of_another_input_stays(nine_roofs_file: Path, out: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.laz"
    write_laz(other, np.random.default_rng(1).uniform(0, [9, 9, 0.1], (200, 3)) + [90000, 440000, 0])
    with pytest.raises(InputError, match=rf"out: holds a run of {nine_roofs_file.name}"):
        build_again(other, out)
    assert build([nine_roofs_file, other], out, outputs=("footprints",)).found == 9  # more tiles are welcome
    with pytest.raises(InputError, match=r"out: holds a run of other.laz"):
        build_again(nine_roofs_file, out)


def test_inputs_that_moved_are_the_same(nine_roofs_file: Path, out: Path, tmp_path: Path) -> None:
    assert build_again(Path(shutil.copy(nine_roofs_file, tmp_path)), out).found == 9


def test_incomplete_results_cross_processes() -> None:
    failed = ("block 1 2: no", "block 1 3: no")
    summary = Summary(Path("out"), 1, 0, 0, {}, {}, {}, {}, 0.0, (), failed=failed)
    error = pickle.loads(pickle.dumps(IncompleteRunError(summary.failed, summary)))
    assert str(error).startswith("block 1 2: no (2 such in all); ")
    assert error.results == summary
