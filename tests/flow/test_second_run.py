"""A second run into a folder loses no person's work and no results of other inputs."""

from __future__ import annotations

import os
import pickle
import shutil
import sqlite3
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eaves
from eaves import IncompleteRunError, InputError, Summary
from eaves.exports import export_run
from eaves.flow.edits import read_edits
from eaves.model import CoordinateSystem
from eaves.run.manifest import check_folder
from eaves.run.options import RunOptions
from eaves.upkeep.update import update
from tests.conftest import build_files, write_laz


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory, nine_roofs_file: Path) -> Path:
    """A run that is kept."""
    folder = tmp_path_factory.mktemp("kept") / "out"
    build_files(nine_roofs_file, folder, outputs=("footprints", "models"), keep=True)
    return folder


@pytest.fixture
def out(kept: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    return shutil.copytree(kept, tmp_path / "out")


def build_again(file: Path, out: Path, **options: Any) -> Summary:
    return build_files(file, out, **RunOptions(outputs=("footprints", "models"), keep=True, **options))  # type: ignore[typeddict-item]


MODELS = "buildings.city.jsonl"
FAR_HALF = (85010.0, 447000.0, 85200.0, 447300.0)
HALF = (84900.0, 447000.0, 85010.0, 447300.0)
"""Bounds that hold some of the nine roofs."""


def execute(path: Path, *commands: str) -> None:
    with closing(sqlite3.connect(path)) as database:
        for command in commands:
            database.execute(command).fetchall()
        database.commit()


def test_a_second_run_of_the_same_inputs_needs_no_word(nine_roofs_file: Path, out: Path) -> None:
    assert build_again(nine_roofs_file, out).found == 9


@pytest.mark.slow
def test_edits_stay_unless_overwritten(nine_roofs_file: Path, out: Path, tmp_path: Path) -> None:
    with closing(sqlite3.connect(out / "footprints.gpkg")) as layer:
        (name,) = layer.execute("SELECT id FROM footprints").fetchone()
    (tmp_path / "verdicts.csv").write_text(f"id,verdict\n{name},no building\n")
    assert update(out, edits=tmp_path / "verdicts.csv").found == 8
    before = (out / "edits.gpkg").read_bytes()
    with pytest.raises(InputError, match=r"edits.gpkg: holds edits of \d+ \w+ \d{4}; .* --overwrite"):
        build_again(nine_roofs_file, out)
    assert (out / "edits.gpkg").read_bytes() == before
    assert update(out).found == 8
    before = (out / "edits.gpkg").read_bytes()
    assert build_again(nine_roofs_file, out, overwrite=True).found == 9
    assert not (out / "edits.gpkg").exists()
    assert (out / "before-1" / "edits.gpkg").read_bytes() == before


@pytest.mark.slow
def test_edits_are_carried_to_a_new_build__and_those_without_a_building_are_named(
    nine_roofs_file: Path, out: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with closing(sqlite3.connect(out / "footprints.gpkg")) as layer:
        names = [name for (name,) in layer.execute("SELECT id FROM footprints")]
    verdicts = f"id,verdict\n{names[0]},no building\n{names[1]},flat roof\n"
    (tmp_path / "verdicts.csv").write_text(verdicts)
    assert update(out, edits=tmp_path / "verdicts.csv").found == 8
    right = (out / MODELS).read_text()
    edits = read_edits(out / "edits.gpkg", CoordinateSystem())
    for options in ({"keep": True}, {}):
        assert eaves.build(nine_roofs_file, out, outputs=("footprints", "models"), **options).found == 8
        assert (out / MODELS).read_text() == right
        again = read_edits(out / "edits.gpkg", CoordinateSystem())
        assert [(one.id, one.verdict, one.source) for one in again] == [
            (one.id, one.verdict, one.source) for one in edits
        ]
        assert check_folder(out) == [] and not (out / "before-1").exists()
    with caplog.at_level("WARNING", "eaves"):
        half = eaves.build(nine_roofs_file, out, outputs=("footprints", "models"), bounds=FAR_HALF)
    assert half.found < 8
    assert f"edit: no building of '{names[0]}': there is no such building" in caplog.text
    assert len(read_edits(out / "edits.gpkg", CoordinateSystem())) == 2
    assert eaves.build(nine_roofs_file, out, outputs=("footprints", "models"), overwrite=True).found == 9
    assert (out / "before-1" / "edits.gpkg").exists() and not (out / "edits.gpkg").exists()


CHANGES = {
    "ALTER TABLE footprints ADD COLUMN mine TEXT": "footprints.mine is new",
    "ALTER TABLE footprints DROP COLUMN lod": "footprints.lod is gone",
    "CREATE TABLE notes (mine TEXT)": "notes is new",
    "DROP TABLE attributes": "attributes is gone",
    "DELETE FROM footprints WHERE fid = 9": "footprints has 8 rows, not 9",
    "UPDATE layer_styles SET styleQML = 'mine' WHERE id = 2": "layer_styles.styleQML has other values",
    "UPDATE attributes SET roofType = 'mine' WHERE fid = 9": "attributes.roofType has other values",
}
"""Change of a person → how it is told."""


@pytest.mark.parametrize("change", CHANGES, ids=CHANGES.values())
def test_what_a_person_changed_in_a_layer_stays__and_is_told(
    change: str, nine_roofs_file: Path, out: Path
) -> None:
    execute(out / "footprints.gpkg", change)
    told = rf"footprints.gpkg: was changed since a run wrote it \({CHANGES[change]}\); take .* eaves update"
    with pytest.raises(InputError, match=told):
        build_again(nine_roofs_file, out)


def test_a_value_of_the_same_length_stays(nine_roofs_file: Path, out: Path) -> None:
    execute(out / "footprints.gpkg", "UPDATE gpkg_contents SET last_change = '2001-01-01T00:00:00.000Z'")
    with pytest.raises(InputError, match=r"footprints.gpkg: was changed since"):
        build_again(nine_roofs_file, out)


def test_a_change_with_the_clock_set_back_is_seen(nine_roofs_file: Path, out: Path) -> None:
    (out / "review.csv").write_text("mine")
    os.utime(out / "review.csv", (0, 0))
    with pytest.raises(InputError, match=r"review.csv: was changed since"):
        build_again(nine_roofs_file, out)


def test_all_that_a_person_made_is_listed__and_kept_in_a_folder_of_its_own_each_time(
    nine_roofs_file: Path, out: Path
) -> None:
    for number in (1, 2):
        execute(out / "footprints.gpkg", "ALTER TABLE footprints ADD COLUMN mine TEXT")
        (out / "buildings.obj").write_text("a drawing")
        (out / "notes.txt").write_text("mine")
        before = (out / "footprints.gpkg").read_bytes()
        with pytest.raises(
            InputError,
            match=rf"(?=.*footprints.gpkg)(?=.*buildings.obj).*\(and of 1 more: .* before-{number}",
        ):
            build_again(nine_roofs_file, out, formats=("obj",))
        assert build_again(nine_roofs_file, out, formats=("obj",), overwrite=True).found == 9
        kept = out / f"before-{number}"
        assert {path.name for path in kept.iterdir()} == {"footprints.gpkg", "buildings.obj"}
        assert (kept / "footprints.gpkg").read_bytes() == before
        assert (kept / "buildings.obj").read_text() == "a drawing"
        assert (out / "notes.txt").read_text() == "mine"
    assert check_folder(out) == []


def test_what_a_person_saves_while_a_run_computes_is_kept(nine_roofs_file: Path, out: Path) -> None:
    def save(step: str, done: int, total: int) -> None:
        if step == "buildings" and not (out / "before-1").exists():
            (out / "review.csv").write_text("mine")

    assert build_files(nine_roofs_file, out, progress=save, outputs=("footprints",)).found == 9
    assert (out / "before-1" / "review.csv").read_text() == "mine"
    assert check_folder(out) == []


def test_columns_of_a_layer_whose_edits_are_taken_are_kept(nine_roofs_file: Path, out: Path) -> None:
    execute(out / "footprints.gpkg", "ALTER TABLE footprints ADD COLUMN mine TEXT")
    before = (out / "footprints.gpkg").read_bytes()
    assert update(out).found == 9
    assert (out / "before-1" / "footprints.gpkg").read_bytes() == before


def test_an_export_keeps_what_bears_its_name(out: Path) -> None:
    (out / "buildings.obj").write_text("a drawing")
    export_run(out, ["obj"])
    assert (out / "before-1" / "buildings.obj").read_text() == "a drawing"
    export_run(out, ["obj"])
    assert not (out / "before-2").exists()


@pytest.mark.parametrize("by", ["build", "update"])
def test_a_reader_sees_the_old_or_the_new_file(
    by: str, nine_roofs_file: Path, out: Path, tmp_path: Path
) -> None:
    with closing(sqlite3.connect(out / "footprints.gpkg")) as layer:
        (name,) = layer.execute("SELECT id FROM footprints").fetchone()
    (tmp_path / "verdicts.csv").write_text(f"id,verdict\n{name},no building\n")
    query = "SELECT count(*), total(last_insert_rowid()) FROM footprints"
    execute(out / "footprints.gpkg", "PRAGMA journal_mode = WAL")
    with closing(sqlite3.connect(out / "footprints.gpkg")) as reader, (out / MODELS).open() as table:
        first = table.readline()
        old = reader.execute(query).fetchone()
        if by == "build":
            assert build_again(nine_roofs_file, out, bounds=HALF).found < 9
        else:
            assert update(out, edits=tmp_path / "verdicts.csv").found == 8
        assert reader.execute(query).fetchone() == old
        assert first and len(table.readlines()) == 9
    with closing(sqlite3.connect(out / "footprints.gpkg")) as later:
        assert later.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        assert later.execute(query).fetchone() < old


@pytest.mark.slow
def test_a_layer_that_another_program_is_changing_is_kept(nine_roofs_file: Path, out: Path) -> None:
    execute(out / "footprints.gpkg", "PRAGMA journal_mode = WAL")
    with closing(sqlite3.connect(out / "footprints.gpkg")) as editor:
        editor.execute("PRAGMA wal_autocheckpoint = 0")
        editor.execute("ALTER TABLE footprints ADD COLUMN mine TEXT")
        editor.commit()
        assert (out / "footprints.gpkg-wal").stat().st_size
        with pytest.raises(InputError, match=r"footprints.gpkg: was changed since"):
            build_again(nine_roofs_file, out)
        assert build_again(nine_roofs_file, out, overwrite=True).found == 9
        editor.execute("ALTER TABLE footprints ADD COLUMN more TEXT")
        editor.commit()
    for folder, columns in ((out, set()), (out / "before-1", {"mine", "more"})):
        with closing(sqlite3.connect(folder / "footprints.gpkg")) as layer:
            assert layer.execute("PRAGMA integrity_check").fetchone() == ("ok",)
            names = {row[1] for row in layer.execute("PRAGMA table_info(footprints)")}
            assert names & {"mine", "more"} == columns


ALPHABETS = (
    "latin ελληνικά кириллица հայերեն ქართული עברית العربية ܣܘܪܝܝܐ ދިވެހި हिन्दी বাংলা ਪੰਜਾਬੀ ગુજરાતી ଓଡ଼ିଆ "
    "தமிழ் తెలుగు ಕನ್ನಡ മലയാളം සිංහල ไทย ລາວ བོད་ཡིག မြန်မာ አማርኛ ᏣᎳᎩ ᓀᐦᐃᔭᐍᐏᐣ ᚱᚢᚾᛖ ខ្មែរ ᠮᠣᠩᠭᠣᠯ ひらがな カタカナ "
    "한국어 漢字 ꦗꦮ ᮞᮥᮔ᮪ᮓ ᬩᬮᬶ ⵜⵉⴼⵉⵏⴰⵖ ߒߞߏ ᱥᱟᱱᱛᱟᱲᱤ 𐌲𐌿𐍄"
)
"""Words in forty alphabets."""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has neither such links nor such devices")
def test_a_folder_of_links_devices_and_all_alphabets_is_left_as_it_is(
    nine_roofs_file: Path, tmp_path: Path
) -> None:
    names = ALPHABETS.split()
    assert len(set(names)) == 40
    inputs, out, far = tmp_path / "in", tmp_path / "out", tmp_path / "far"
    for folder in (inputs, out, far):
        folder.mkdir()
    for name in names:
        (out / f"{name}.gpkg").write_text(name)
    shutil.copy(nine_roofs_file, inputs / f"{names[32]}.laz")
    os.mkfifo(inputs / "pipe.laz")
    os.symlink(inputs / "none.laz", inputs / "broken.laz")
    (far / "secret").write_text("far away")
    os.symlink(far / "secret", out / "footprints.gpkg")
    os.symlink(far, out / "steps")
    os.mkfifo(out / "review.csv")
    os.symlink("/dev/null", out / "buildings.qgz")
    (out / MODELS).mkdir()
    words = {"outputs": ("footprints", "models"), "allow_failures": True}
    with pytest.raises(InputError, match=r"was not written by eaves"):
        build_files(inputs / f"{names[32]}.laz", out, **words)
    assert build_files(inputs / f"{names[32]}.laz", out, overwrite=True, **words).found == 9
    assert check_folder(out) == []
    assert (far / "secret").read_text() == "far away" and len(list(far.iterdir())) == 1
    assert all((out / f"{name}.gpkg").read_text() == name for name in names)
    assert {path.name for path in (out / "before-1").iterdir()} == {
        *("footprints.gpkg", "review.csv", "buildings.qgz", MODELS)
    }
    summary = build_files(inputs, tmp_path / "whole", **words)  # pipes and broken links are no inputs
    assert summary.found == 9


@pytest.mark.slow
def test_a_layer_that_was_only_shown_is_not_changed(nine_roofs_file: Path, out: Path) -> None:
    before = (out / "footprints.gpkg").read_bytes()
    execute(out / "footprints.gpkg", "PRAGMA journal_mode = WAL", "SELECT * FROM footprints")
    execute(out / "footprints.gpkg", "PRAGMA journal_mode = DELETE")
    assert (out / "footprints.gpkg").read_bytes() != before
    assert build_again(nine_roofs_file, out).found == 9


def test_a_run_of_another_input_stays(nine_roofs_file: Path, out: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.laz"
    write_laz(other, np.random.default_rng(1).uniform(0, [9, 9, 0.1], (200, 3)) + [90000, 440000, 0])
    told = rf"out: holds a run of {nine_roofs_file.name}; add a later scan of its area by eaves update"
    with pytest.raises(InputError, match=told):
        build_again(other, out)
    assert (
        build_files([nine_roofs_file, other], out, outputs=("footprints",)).found == 9
    )  # more tiles are welcome
    with pytest.raises(InputError, match=r"out: holds a run of other.laz"):
        build_again(nine_roofs_file, out)


@pytest.mark.slow
def test_inputs_that_moved_are_the_same(nine_roofs_file: Path, out: Path, tmp_path: Path) -> None:
    assert build_again(Path(shutil.copy(nine_roofs_file, tmp_path)), out).found == 9


def test_incomplete_results_cross_processes() -> None:
    failed = ("block 1 2: no", "block 1 3: no")
    summary = Summary(Path("out"), 1, 0, 0, {}, {}, {}, {}, 0.0, (), failed=failed)
    error = pickle.loads(pickle.dumps(IncompleteRunError(summary.failed, summary)))
    assert str(error).startswith("block 1 2: no (2 such in all); ")
    assert error.results == summary
