"""How much work a run does may not grow: counts, which are the same on any machine."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

COUNT = """
import json, pathlib, sys
from benchmarks.speed.counts import count_work
print(json.dumps(count_work(pathlib.Path(sys.argv[1]))))
"""
MOST = {
    "imported": 260,
    "ran": 200,
    "calls a building": 7000,
    "kernel calls a building": 250,
    "mapped": 3.0,
    "copied": 7.0,
    "sorted": 2.1,
    "ground": 1.0,
    "rasters": 1.0,
    "detect": 1.0,
}
"""Of a run over nine roofs in one block: modules, calls, and how often each point is handled."""


@pytest.fixture(scope="module")
def counts(nine_roofs_file: Path) -> dict[str, float]:
    words = [sys.executable, "-c", COUNT, str(nine_roofs_file)]
    done = subprocess.run(words, capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2])
    return dict(json.loads(done.stdout.splitlines()[-1]))


def test_all_nine_roofs_are_counted(counts: dict[str, float]) -> None:
    assert counts["buildings"] == 9


@pytest.mark.parametrize("what", MOST)
def test_a_run_does_no_more_work_than(what: str, counts: dict[str, float]) -> None:
    assert counts[what] <= MOST[what]
