"""What a newcomer reads: version, doctor, one line a step, no word that is not so."""

from __future__ import annotations

import json
import threading
from importlib.metadata import version
from pathlib import Path

import pytest

from eaves import kernels
from eaves.cli import app as cli
from eaves.flow import progress
from eaves.model.summary import Summary
from eaves.simulate import nine_roofs_on_a_slope, write_simulation


def run(monkeypatch: pytest.MonkeyPatch, *words: str | Path) -> int:
    """A command in this process; its exit status."""
    monkeypatch.setattr("sys.argv", ["eaves", *map(str, words)])
    with pytest.raises(SystemExit) as end:
        cli.main()
    return int(end.value.code or 0)


def test_version(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(monkeypatch, "--version") == 0
    assert capsys.readouterr().out == f"eaves {version('eaves')}\n"


def test_doctor_names_what_it_runs_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "doctor", "--no-test") == 0
    text = capsys.readouterr().out
    for word in ("numba", "GPKG yes", "PROJ", "cores", "compiled code is kept in", "extras: plots"):
        assert word in text


@pytest.mark.slow
def test_doctor_builds_nine_houses(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "doctor") == 0
    assert "9 of 9 buildings found, 9 modelled, 0 defects" in capsys.readouterr().out


def test_ground_of_a_simulated_scene_warns_of_nothing_and_speaks_of_no_building(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    files = write_simulation(nine_roofs_on_a_slope(density=2.0), tmp_path / "scene")
    assert run(monkeypatch, "ground", files["points"], "-o", tmp_path / "out", "--jobs", "1") == 0
    said = capsys.readouterr()
    assert "WARNING" not in said.err and "building" not in said.out + said.err
    assert "ground and noise classified" in said.out
    assert json.loads((tmp_path / "out" / "run.json").read_text())["methods"]["detect"] is None


def test_first_run_says_that_it_compiles_and_foresees_nothing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert progress.compiled_pieces() == 0
    (tmp_path / "loop.nbc").touch()
    seen: list[tuple[str, int, int]] = []
    shown = threading.Event()
    monkeypatch.setattr(progress, "POLL_S", 0.01)
    with progress.compilation_shown(True, lambda *words: (seen.append(words), shown.set())):  # type: ignore[func-returns-value]
        assert shown.wait(10)
    assert seen[0] == ("compiling", 1, progress.LOOPS)
    calls = kernels.listed_calls(kernels.LIST)
    assert abs(progress.LOOPS - len(calls)) <= 0.2 * len(calls)
    clock = iter([0.0, 100.0, 101.0])
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(clock))
    remaining = progress.Remaining(compiling=True)
    assert remaining.after("regions", 1, 2) is None
    assert remaining.after("write", 1, 2) is not None


def test_nothing_is_foreseen_from_reading_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([0.0, 10.0, 20.0])
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(clock))
    remaining = progress.Remaining()
    assert remaining.after("points", 1, 1) is None
    left = remaining.after("regions", 1, 2)
    assert left == pytest.approx(20.0 * (1 - 0.405) / 0.405)


def test_the_ground_alone_has_no_buildings_before_it(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([0.0, 10.0])
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(clock))
    remaining = progress.Remaining(shares=progress.GROUND_SHARES)
    assert remaining.after("regions", 9, 9) == pytest.approx(10.0 * 0.18 / 0.82)


def test_summary_of_a_build_counts_buildings() -> None:
    trust = {"high": 1, "low": 1}
    summary = Summary(Path("out"), 10, 2, 1, {"2.2": 1}, {"no_plane": 1}, {}, {}, 1.0, (), trust=trust)
    assert "2 buildings found = 1 modelled + 1 failed" in summary.as_text()
    assert "2 buildings: trust high 1, medium 0, low 1" in summary.as_text().splitlines()
