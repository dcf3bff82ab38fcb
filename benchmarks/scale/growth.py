"""Memory and time as the area grows by 4 and by 16, and with two workers.

usage: python -m benchmarks.scale.growth [--density D] [--areas N N N]   (Linux, macOS)
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.table import keep
from eaves.simulate import scan_town, simulate_town, write_simulation

AREA_KM2 = 0.0576
"""One block."""


def build(points: Path, out: Path, jobs: int) -> tuple[float, float, dict[str, float]]:
    """Wall seconds, peak memory (MB) of the largest process, and the figures of run.json."""
    words = [sys.executable, "-m", "eaves.cli", "build", str(points), "-o", str(out), "-q"]
    started = time.perf_counter()
    process = subprocess.Popen([*words, "--jobs", str(jobs)], stderr=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)  # the largest of the process and all it waited for
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, words)
    wall = time.perf_counter() - started
    figures: dict[str, float] = json.loads((out / "run.json").read_text(encoding="utf-8"))
    return wall, max(used.ru_maxrss / 1e3, figures["peak_memory_mb"]), figures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--density", type=float, default=4.0)
    parser.add_argument("--areas", type=int, nargs="+", default=[1, 4, 16], help="In blocks.")
    asked = parser.parse_args()
    rows: list[dict[str, object]] = []
    alone: dict[int, tuple[float, float]] = {}
    with tempfile.TemporaryDirectory() as name:
        for times in asked.areas:
            place = Path(name) / str(times)
            town = simulate_town(AREA_KM2 * times, terrain="hilly", seed=12)
            points = write_simulation(scan_town(town, asked.density, seed=12), place)["points"]
            if not rows:
                build(points, place / "warm", 1)  # compiles the kernels
            for jobs in (1, 2):
                wall, peak, figures = build(points, place / f"out{jobs}", jobs)
                millions = figures["points"] / 1e6
                if jobs == 1:
                    alone[times] = wall, wall / millions
                first = alone[asked.areas[0]][1]
                rows.append(
                    {
                        "area, blocks": times,
                        "M points": round(millions, 2),
                        "processes": jobs,
                        "wall s": round(wall, 1),
                        "wall s per M points": round(wall / millions, 1),
                        "of the smallest area's": f"{wall / millions / first:.2f}" if jobs == 1 else "",
                        "times as fast as one": f"{alone[times][0] / wall:.2f}" if jobs > 1 else "",
                        "peak of the largest process, MB": round(peak),
                        "buildings": figures["found"],
                    }
                )
                print(rows[-1], flush=True)
    keep("growth", "Memory and time as the area grows", rows, "python -m benchmarks.scale.growth")


if __name__ == "__main__":
    main()
