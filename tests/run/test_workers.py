"""Every task gets its outcome, also when it fails or its process dies."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eaves.run.memory import LEAST
from eaves.run.workers import Outcome, Workers, attempt


def run(
    work: Callable[[Any], Any], tasks: Sequence[Any], jobs: int, memory: int | None = None
) -> list[Outcome]:
    with Workers(jobs, memory=memory) as workers:
        return sorted(workers.run(work, tasks), key=lambda outcome: outcome.index)


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
    outcomes = run(half, [4, -1, 6], jobs)
    assert [outcome.answer for outcome in outcomes] == [2, None, 3]
    assert outcomes[1].error == "ValueError: -1 is negative"


def die(value: int) -> int:
    if value == 0:
        os._exit(9)
    return value


def die_beside(starter: int) -> bool:
    """Whether this is the process that started the others; the others die."""
    if os.getpid() != starter:
        os._exit(9)
    return True


def test_the_tasks_of_a_killed_process_are_tried_again(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("a", "b", "c")]
    for folder in folders:
        folder.mkdir()
    for folder in folders[1:]:
        (folder / "died").touch()
    outcomes = run(die_once, [str(folder) for folder in folders], 2, 2 * LEAST)
    assert [outcome.answer for outcome in outcomes] == ["alive"] * 3


@pytest.mark.slow
def test_only_the_task_that_kills_its_process_fails() -> None:
    outcomes = run(die, [1, 0, 2, 3, 4, 5], 2, 2 * LEAST)
    assert [outcome.answer for outcome in outcomes] == [1, None, 2, 3, 4, 5]
    assert "killed" in (outcomes[1].error or "")


def test_a_process_that_dies_takes_no_task_of_the_one_that_started_it() -> None:
    outcomes = run(die_beside, [os.getpid()] * 4, 2)
    assert [outcome.index for outcome in outcomes] == [0, 1, 2, 3]
    assert all(outcome.answer or "killed" in (outcome.error or "") for outcome in outcomes)


def pid_after_a_while(seconds: float) -> int:
    time.sleep(seconds)
    return os.getpid()


@pytest.mark.slow
def test_the_process_that_starts_others_is_one_of_them__not_where_memory_is_limited() -> None:
    assert os.getpid() in {outcome.answer for outcome in run(pid_after_a_while, [0.01] * 8, 2)}
    assert len({outcome.answer for outcome in run(pid_after_a_while, [1.0] * 4, 3)}) == 3
    assert os.getpid() not in {outcome.answer for outcome in run(pid_after_a_while, [0.01] * 4, 2, 2 * LEAST)}


def test_large_tasks_and_large_answers_cross_in_a_pipe() -> None:
    outcomes = run(bytes.upper, [b"a" * 2_000_000] * 6, 1, LEAST)
    assert [len(outcome.answer) for outcome in outcomes] == [2_000_000] * 6


def test_a_task_that_cannot_be_sent_fails_and_says_so() -> None:
    outcomes = run(callable, [len, lambda: None], 1, LEAST)
    assert outcomes[0].answer and "pickle" in (outcomes[1].error or "")


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
