"""The output folder: one run at a time, never an input, and a manifest of what a run wrote."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from tests.conftest import build_files

import eaves
from eaves.flow import run
from eaves.flow.formats import classified_name
from eaves.flow.run import claim, open_run
from eaves.formats import InputError
from eaves.run import manifest
from eaves.run.manifest import (
    LOCK,
    MANIFEST,
    add_to_manifest,
    check_folder,
    end_manifest,
    lock_folder,
    read_manifest,
)


def test_a_folder_that_a_run_holds_is_refused__and_freed_by_its_end(tmp_path: Path) -> None:
    with lock_folder(tmp_path):
        with pytest.raises(InputError, match="another run is writing here"), lock_folder(tmp_path):
            pass
        assert (tmp_path / LOCK).exists()
    assert not list(tmp_path.iterdir())


def test_another_thread_is_refused_too(tmp_path: Path) -> None:
    with lock_folder(tmp_path), ThreadPoolExecutor(1) as pool, pytest.raises(InputError, match="wait for it"):
        pool.submit(lock_folder(tmp_path).__enter__).result()


HOLD = """
import sys, time
from pathlib import Path
from eaves.formats import InputError
from eaves.run.manifest import lock_folder
try:
    with lock_folder(Path(sys.argv[1])):
        print("mine", flush=True)
        time.sleep(float(sys.argv[2]))
except InputError:
    print("taken")
"""


def test_what_a_killed_process_left_is_no_lock(tmp_path: Path) -> None:
    words = [sys.executable, "-c", HOLD, str(tmp_path), "60"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None and holder.stdout.readline() == "mine\n"
        with pytest.raises(InputError), lock_folder(tmp_path):
            pass
        holder.kill()
    assert (tmp_path / LOCK).exists()
    with lock_folder(tmp_path):
        pass
    assert not list(tmp_path.iterdir())


def test_a_folder_that_many_claim_at_once_can_be_written(tmp_path: Path) -> None:
    with ThreadPoolExecutor(8) as threads:
        assert list(threads.map(claim, [tmp_path / "new"] * 400)) == [None] * 400
    assert not list((tmp_path / "new").iterdir())


def test_files_that_are_added_at_once_are_all_written_down(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    end_manifest(tmp_path, [])
    files = [tmp_path / f"{number}.obj" for number in range(24)]
    for file in files:
        file.write_text("# eaves")
    with ThreadPoolExecutor(8) as threads:
        list(threads.map(lambda file: add_to_manifest(tmp_path, [file]), files))
    assert read_manifest(tmp_path)["written"].keys() == {file.name for file in files}
    monkeypatch.setattr(manifest, "ADDING_S", 0.0)
    with lock_folder(tmp_path), pytest.raises(InputError, match="another run is writing here"):
        add_to_manifest(tmp_path, files)


def test_of_many_processes_one_takes_a_lock_that_was_left(tmp_path: Path) -> None:
    (tmp_path / LOCK).write_text('{"process": 12')
    words = [sys.executable, "-c", HOLD, str(tmp_path), "3"]
    started = [subprocess.Popen(words, stdout=subprocess.PIPE, text=True) for _ in range(4)]
    assert sorted(one.communicate()[0].strip() for one in started) == ["mine", "taken", "taken", "taken"]


def test_the_output_folder_is_never_that_of_an_input(one_roof_file: Path, tmp_path: Path) -> None:
    shutil.copy(one_roof_file, tmp_path / "x.laz")
    before = (tmp_path / "x.laz").read_bytes()
    link = tmp_path.parent / f"{tmp_path.name}-link"
    link.symlink_to(tmp_path)
    for out in (tmp_path, link, tmp_path / "." / "..", tmp_path):
        if out.resolve() != tmp_path.resolve():
            continue
        with pytest.raises(InputError, match="output folder"):
            build_files(tmp_path, out)
    with pytest.raises(InputError, match="overwritten"):
        build_files(tmp_path / "x.laz", tmp_path, outputs=("classified",), classified=link / "x.laz")
    assert [path.name for path in tmp_path.iterdir()] == ["x.laz"]
    assert (tmp_path / "x.laz").read_bytes() == before


def test_given_footprints_are_not_overwritten(one_roof_file: Path, tmp_path: Path) -> None:
    build_files(one_roof_file, tmp_path, lod="0")
    with pytest.raises(InputError, match="would be overwritten"):
        build_files(one_roof_file, tmp_path, footprints=tmp_path / "footprints.gpkg")


@pytest.mark.slow
def test_a_rerun_removes_its_own_old_files_and_nothing_else(one_roof_file: Path, tmp_path: Path) -> None:
    assert build_files(one_roof_file, tmp_path, lod="1.2", formats=("obj", "3dtiles", "geojson")).complete
    assert check_folder(tmp_path) == []
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "footprints.geojson").write_text("changed by hand")
    assert check_folder(tmp_path) == [
        f"{tmp_path / 'footprints.geojson'}: has 15 bytes, the run wrote "
        f"{read_manifest(tmp_path)['written']['footprints.geojson']['size']}"
    ]
    with pytest.raises(InputError, match=r"footprints.geojson: was changed since a run wrote it"):
        build_files(one_roof_file, tmp_path, lod="0", outputs=("footprints",))
    assert build_files(one_roof_file, tmp_path, lod="0", outputs=("footprints",), overwrite=True).complete
    assert {path.name for path in tmp_path.iterdir()} == {
        *("footprints.gpkg", "review.csv", "buildings.qgz", MANIFEST),
        *("notes.txt", "before-1"),
    }
    assert [path.name for path in (tmp_path / "before-1").iterdir()] == ["footprints.geojson"]
    assert (tmp_path / "before-1" / "footprints.geojson").read_text() == "changed by hand"
    assert check_folder(tmp_path) == []


@pytest.mark.parametrize("per_tile", [False, True])
def test_a_run_removes_what_was_left_half_written_under_its_names(
    per_tile: bool, one_roof_file: Path, tmp_path: Path
) -> None:
    for name in ("footprints.gpkg", MANIFEST, "mine.gpkg"):
        half = tmp_path / f".{name}.half" / name
        half.parent.mkdir()
        half.touch()
    words = {"outputs": ("footprints",), "lod": "0", "per_tile": per_tile}
    assert eaves.build(one_roof_file, tmp_path, **words).found == 1
    assert [path.name for path in tmp_path.glob(".*.half")] == [".mine.gpkg.half"]


def test_a_run_that_did_not_end_is_no_result(
    one_roof_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from eaves.flow import outputs

    assert build_files(one_roof_file, tmp_path, lod="0").complete
    monkeypatch.setattr(outputs, "write_run", lambda summary: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        build_files(one_roof_file, tmp_path, lod="0", formats=("geojson",))
    assert any("did not end" in line for line in check_folder(tmp_path))
    monkeypatch.undo()
    assert build_files(one_roof_file, tmp_path, lod="0", resume=True).complete
    assert check_folder(tmp_path) == []
    assert not (tmp_path / "footprints.geojson").exists()


def test_a_manifest_never_leads_out_of_its_folder(tmp_path: Path) -> None:
    out, other = tmp_path / "out", tmp_path / "other.txt"
    out.mkdir()
    other.write_text("keep")
    for name in ("../other.txt", str(other), "a/../../other.txt"):
        (out / MANIFEST).write_text(json.dumps({"complete": True, "written": {name: {}}}))
        end_manifest(out, [])
        assert other.read_text() == "keep"


@pytest.mark.parametrize("moment", ["points", "regions", "write"])
def test_an_input_that_changes_during_the_run_ends_it(
    one_roof_file: Path, tmp_path: Path, moment: str
) -> None:
    points = tmp_path / "x.laz"
    shutil.copy(one_roof_file, points)
    before = points.stat()

    def edit(step: str, done: int, total: int) -> None:
        if step == moment and points.stat().st_size == before.st_size:
            with points.open("rb+") as file:  # a byte in the middle, and the time set back
                file.seek(before.st_size // 2)
                (byte,) = file.read(1)
                file.seek(before.st_size // 2)
                file.write(bytes([byte ^ 1]))
            os.utime(points, ns=(before.st_atime_ns, before.st_mtime_ns))

    with pytest.raises(InputError, match="changed while the run was reading it"):
        build_files(points, tmp_path / "out", progress=edit, outputs=("footprints", "classified"))
    assert not (tmp_path / "out" / "classified.laz").exists()


def test_an_input_edited_in_secret_is_computed_anew_by_a_resumed_run(
    one_roof_file: Path, tmp_path: Path
) -> None:
    points, out = tmp_path / "x.laz", tmp_path / "out"
    shutil.copy(one_roof_file, points)
    before = points.stat()
    first = open_run(points, out).plan
    with points.open("rb+") as file:
        file.seek(before.st_size // 2)
        file.write(b"\0")
    os.utime(points, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert open_run(points, out).plan != first


def test_footprints_that_change_as_they_are_read_are_refused(
    one_roof_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = tmp_path / "given.geojson"
    ring = [[0, 0], [9, 0], [9, 9], [0, 0]]
    polygon = {"type": "Polygon", "coordinates": [ring]}
    text = json.dumps({"type": "Feature", "properties": {"id": "a"}, "geometry": polygon})
    given.write_text(text)
    read = run.read_footprints

    def read_and_edit(*arguments: object) -> object:
        answer = read(*arguments)  # type: ignore[arg-type]
        given.write_text(text.replace('"a"', '"b"'))
        return answer

    monkeypatch.setattr(run, "read_footprints", read_and_edit)
    with pytest.raises(InputError, match="changed while the run was reading it"):
        open_run(one_roof_file, tmp_path / "out", footprints=given, allow_empty=True)


def test_names_that_differ_by_case_only_get_a_number_and_long_ones_are_cut() -> None:
    taken: set[str] = set()
    names = [
        classified_name(Path(name), False, taken) for name in ("a/X.laz", "b/x.laz", "CON.laz", "x..laz")
    ]
    assert names == ["classified_X.laz", "classified_x-2.laz", "classified_CON.laz", "classified_x..laz"]
    long = [classified_name(Path(f"{'é' * 110}{k}.laz"), False, taken) for k in range(2)]
    assert len(set(long)) == 2
    assert max(len(os.fsencode(name)) for name in long) < 220


def test_results_of_an_earlier_form_are_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / MANIFEST).write_text(json.dumps({"version": "0.1.0", "found": 9}))
    with pytest.raises(InputError, match="listed no files in it; build again"):
        check_folder(tmp_path)
