"""A full disk ends a run with one line, and the next one goes on where it stopped."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from tests.conftest import build_in_blocks, but_first
from tests.run.test_long_buildings import features

from eaves.flow import outputs
from eaves.formats import InputError
from eaves.formats.whole_files import DiskFullError
from eaves.run import points as partition
from eaves.run.manifest import read_facts
from eaves.run.store import Store

build = partial(build_in_blocks, 60.0)

FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
SQLITE_FULL = RuntimeError("failed to execute insert : database or disk is full")
"""What the GeoPackage driver says."""


@pytest.fixture(scope="module")
def right(nine_roofs_file: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, object]:
    out = tmp_path_factory.mktemp("right")
    build(nine_roofs_file, out)
    return features([out / "buildings.city.jsonl"])


def full_from(
    call: int, real: Callable[..., Any], error: Exception = FULL, step: str | None = None
) -> Callable[..., Any]:
    """A function that fails from its n-th call on, or that for a step, as on a disk that is filling."""
    calls = []

    def fails(*words: Any, **named: Any) -> Any:
        calls.extend([1] * (step is None or words[1] == step))
        if len(calls) >= call:
            raise error
        return real(*words, **named)

    return fails


@pytest.mark.parametrize("stage", but_first(["buildings", "points", "regions", "footprints", "models"]))
def test_a_run_on_a_full_disk_is_finished_by_the_next(
    stage: str,
    nine_roofs_file: Path,
    right: dict[str, object],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    place, name, call, error = {
        "points": (partition.SliceWriter, "append", 2, FULL),
        "regions": (Store, "save", 3, FULL),
        "buildings": (Store, "save", 2, FULL),
        "footprints": (outputs, "write_geopackage", 1, SQLITE_FULL),
        "models": (outputs, "write_cityjson_seq", 1, FULL),
    }[stage]
    monkeypatch.setattr(
        place, name, full_from(call, getattr(place, name), error, stage if place is Store else None)
    )
    with pytest.raises(DiskFullError, match=r"the disk is full.*--resume") as told:
        build(nine_roofs_file, tmp_path)
    assert "\n" not in str(told.value)
    assert not list(tmp_path.glob("*.laz")) and "found" not in read_facts(tmp_path)
    assert not [
        path for path in tmp_path.iterdir() if path.name.startswith(".") and path.name != ".eaves-work"
    ]
    monkeypatch.undo()
    done = list((tmp_path / ".eaves-work").glob("regions/*"))
    computed = count_blocks(monkeypatch)
    assert build(nine_roofs_file, tmp_path, resume=True).complete
    assert features([tmp_path / "buildings.city.jsonl"]) == right
    assert bool(done) == (stage not in ("points",))
    if stage not in ("points", "regions"):
        assert not computed


def count_blocks(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Counts the blocks computed from now on."""
    real, computed = Store.save, list[int]()

    def counted(store: Store, step: str, *words: Any) -> None:
        computed.extend([1] * (step == "regions"))
        real(store, step, *words)

    monkeypatch.setattr(Store, "save", counted)
    return computed


def test_a_disk_too_small_for_the_points_is_refused_before_they_are_read(
    nine_roofs_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("eaves.flow.refusals.shutil.disk_usage", lambda path: SimpleNamespace(free=100_000))
    with pytest.raises(
        InputError, match=r"out: its disk has 0\.1 MB free, and [\d,]+ points take .* MB .*--per-tile"
    ):
        build(nine_roofs_file, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no limit on the size of files")
def test_the_command_line_reports_it_in_one_line_and_exits_with_1(
    nine_roofs_file: Path, tmp_path: Path
) -> None:
    """A limit on the size of a file is a full disk to the one who writes."""
    code = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000)); "
        "from eaves.cli.app import main; main()"
    )
    words = ["build", str(nine_roofs_file), "-o", str(tmp_path / "out"), "--jobs", "1", "-q"]
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, timeout=240)
    assert done.returncode == 1, done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert "the disk is full" in done.stderr
