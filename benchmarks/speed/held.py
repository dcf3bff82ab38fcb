"""What a build holds: anonymous memory of all its processes at its peak, and the bytes a point of its store.

usage: python -m benchmarks.speed.held FILE [--crs CRS]         (Linux)

With one process and with two, beside their processor time and the clock. The store is that of a run that
keeps it (`--keep`): the copies of records that others make are not in it.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

from benchmarks.table import keep

EVERY = 0.05
"""Seconds between two looks."""


def family(process: int) -> list[int]:
    """A process with all that it started."""
    found = [process]
    for children in Path(f"/proc/{process}/task").glob("*/children"):
        found += [one for child in children.read_text().split() for one in family(int(child))]
    return found


def anonymous_mb(process: int) -> float:
    """The memory of a process and all that it started which no file backs."""
    total = 0
    for one in family(process):
        for line in Path(f"/proc/{one}/status").read_text().splitlines():
            total += int(line.split()[1]) if line.startswith("RssAnon:") else 0
    return total / 1024


def measure(file: Path, options: list[str], jobs: int, out: Path) -> dict[str, float]:
    """One build: clock, processor time, peak of memory, and what its store weighs."""
    words = [sys.executable, "-m", "eaves", "build", str(file), "-o", str(out), "-q", "--keep"]
    before, peak = time.perf_counter(), 0.0
    running = subprocess.Popen([*words, "--jobs", str(jobs), *options])
    while running.poll() is None:
        with suppress(OSError):  # one ended while it was looked at
            peak = max(peak, anonymous_mb(running.pid))
        time.sleep(EVERY)
    if running.returncode:
        sys.exit(running.returncode)
    run = json.loads((out / "run.json").read_text(encoding="utf-8"))
    sizes = [path.stat().st_size for path in (out / ".eaves-work").rglob("*") if path.is_file()]
    return {
        "processes": jobs,
        "clock s": round(time.perf_counter() - before, 1),
        "CPU s of stages": round(sum(run["stage_cpu_seconds"].values()), 1),
        "anonymous MB": round(peak),
        "store, bytes a point": round(sum(sizes) / run["points"], 1),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--crs", help="of the file")
    wanted = parser.parse_args()
    options = ["--crs", wanted.crs] if wanted.crs else []
    rows = []
    for jobs in (1, 2):
        with tempfile.TemporaryDirectory() as folder:
            rows.append(
                {"data": wanted.file.stem, **measure(wanted.file, options, jobs, Path(folder) / "out")}
            )
        print(rows[-1], flush=True)
    keep("held", "What a build holds", rows, "python -m benchmarks.speed.held")


if __name__ == "__main__":
    main()
