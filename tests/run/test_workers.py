"""Every task gets its outcome, also when it fails or its process dies."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eaves.run.workers import Outcome, Workers, attempt


def run(work: Callable[[Any], Any], tasks: Sequence[Any], jobs: int) -> list[Outcome]:
    with Workers(jobs) as workers:
        return list(workers.run(work, tasks))


def half(value: int) -> int:
    if value < 0:
        raise ValueError(f"{value} is negative")
    return value // 2


def die_once(folder: str) -> str:
    """Kill the own process the first time, answer the second time."""
    mark = Path(folder) / "died"
    if not mark.exists():
        mark.touch()
        os._exit(9)
    return "alive"


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_failing_task_does_not_stop_the_others(jobs: int) -> None:
    outcomes = sorted(run(half, [4, -1, 6], jobs), key=lambda outcome: outcome.index)
    assert [outcome.answer for outcome in outcomes] == [2, None, 3]
    assert outcomes[1].error == "ValueError: -1 is negative"


def die(value: int) -> int:
    if value == 0:
        os._exit(9)
    return value


def test_the_tasks_of_a_killed_process_are_tried_again(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("a", "b", "c")]
    for folder in folders:
        folder.mkdir()
    for folder in folders[1:]:
        (folder / "died").touch()
    outcomes = list(run(die_once, [str(folder) for folder in folders], jobs=2))
    assert [outcome.answer for outcome in outcomes] == ["alive"] * 3


def test_only_the_task_that_kills_its_process_fails() -> None:
    outcomes = sorted(run(die, [1, 0, 2, 3], jobs=2), key=lambda outcome: outcome.index)
    assert [outcome.answer for outcome in outcomes] == [1, None, 2, 3]
    assert "killed" in (outcomes[1].error or "")


@pytest.mark.skipif(sys.platform != "linux", reason="getrusage is right elsewhere")
def test_peak_memory_is_the_process_own__not_that_of_the_one_that_started_it() -> None:
    large = np.ones(50_000_000)
    code = "from eaves.run.workers import peak_memory_mb; print(peak_memory_mb())"
    told = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    assert 5 < float(told) < 100 < large.nbytes / 1e6


def test_an_interrupt_within_a_kernel_is_not_a_failed_task() -> None:
    def interrupted_kernel(task: int) -> None:
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as error:
            raise SystemError("returned a result with an exception set") from error

    with pytest.raises(KeyboardInterrupt):
        attempt(interrupted_kernel, 0, 1)
