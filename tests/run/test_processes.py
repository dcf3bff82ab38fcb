"""Processes end with the one that started them, keep to their memory, and say so in one line."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from eaves.formats import InputError
from eaves.run.memory import parse_memory, share_memory
from eaves.run.workers import Workers

BEGIN = (
    "import sys, time, os\nfrom tests.run.test_processes import report_and_wait\n"
    "from eaves.run.workers import Workers\n"
    "if __name__ == '__main__':\n"
    "    with Workers(2) as workers:\n"
    "        list(workers.run(report_and_wait, [sys.argv[1] + '/a', sys.argv[1] + '/b']))\n"
)


def report_and_wait(path: str) -> None:
    Path(path).write_text(str(os.getpid()))
    time.sleep(60)


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_workers_end_with_the_process_that_started_them(number: signal.Signals, tmp_path: Path) -> None:
    script = tmp_path / "begin.py"
    script.write_text(BEGIN)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    main = subprocess.Popen([sys.executable, script, tmp_path], env=environment)
    told = [tmp_path / "a", tmp_path / "b"]
    assert wait_until(lambda: all(path.exists() and path.read_text() for path in told))
    main.send_signal(number)
    main.wait()
    workers = [int(path.read_text()) for path in told]
    assert wait_until(lambda: not any(Path(f"/proc/{worker}").exists() for worker in workers), 20)


def wait_until(condition: object, seconds: float = 60) -> bool:
    end = time.monotonic() + seconds
    while not condition():  # type: ignore[operator]
        if time.monotonic() > end:
            return False
        time.sleep(0.05)
    return True


def fill(megabytes: int) -> int:
    return int(np.ones(megabytes * 2**17).sum())


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits of Linux")
def test_a_task_that_takes_too_much_memory_fails_alone_and_says_so() -> None:
    with Workers(1, memory=2**30) as workers:
        outcomes = sorted(workers.run(fill, [10, 4000, 20]), key=lambda one: one.index)
    assert [one.answer for one in outcomes] == [10 * 2**17, None, 20 * 2**17]
    assert "memory ran out" in str(outcomes[1].error) and "--resume" in str(outcomes[1].error)


def test_memory_is_shared_among_processes__fewer_where_it_is_short() -> None:
    assert parse_memory("4G") == 2**32 and parse_memory("1.5GiB") == 3 * 2**29 and parse_memory(None) is None
    assert share_memory(2**32, 2) == (2, 2**31)
    assert share_memory(2**30, 8) == (1, 2**30)
    assert share_memory(None, 3) == (3, None)
    for text in ("4X", "-1G", "nan", "10M"):
        with pytest.raises(InputError, match="--memory"):
            parse_memory(text)


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_an_abort_in_a_library_is_one_line_and_status_1() -> None:
    code = (
        "from eaves.cli.runs import report_aborts; import ctypes; report_aborts(); ctypes.CDLL(None).abort()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stderr.startswith("error: a library gave up") and done.stderr.count("\n") == 1
