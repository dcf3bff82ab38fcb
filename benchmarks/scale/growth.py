"""Memory and time as the area grows by 4 and by 16, and with two workers.

usage: python -m benchmarks.scale.growth [--density D] [--areas N N N] [--base N]   (Linux)

Towns of whole blocks are cut out of simulated ones: points on the far border would make blocks of their own.
Ratios are to the area `--base`: from four blocks on every area has the neighbours a block is computed with.
Each town is made, and each run measured, by a process of its own, for a process starts with the peak memory
of the one that starts it.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.table import keep
from eaves.run.workers import peak_memory_mb

SIDE = 240.0
"""Of a block (m)."""
CORNER = 2400.0, 4800.0
"""South-west corner (m) of every simulated town."""
RESET = Path("/proc/self/clear_refs")
"""Writing 5 into it makes the peak memory the present one."""
STAGES = ("points", "regions", "buildings", "write", "report")
Figures = dict[str, float]


def measure(points: Path, out: Path, jobs: int, blocks: int) -> None:
    """Run once in this process; the peak memory (MB) of this process by stage goes to `stages.json`."""

    from eaves.model import Bounds
    from eaves.pipeline import build

    peaks: Figures = {}

    def tell(stage: str, done: int, total: int) -> None:
        peaks[stage] = max(peaks.get(stage, 0.0), peak_memory_mb())
        RESET.write_text("5", encoding="ascii")

    side = SIDE * math.isqrt(blocks)
    window = Bounds(*CORNER, CORNER[0] + side, CORNER[1] + side)
    build(points, out, jobs=jobs, bounds=window, progress=tell)
    tell("report", 1, 1)
    (out / "stages.json").write_text(json.dumps(peaks), encoding="utf-8")


def run(points: Path, out: Path, jobs: int, blocks: int) -> tuple[float, float, Figures, Figures]:
    """Wall and CPU seconds of a run with all its processes, peaks by stage, and the figures of run.json."""
    words = [sys.executable, "-m", "benchmarks.scale.growth", "--measure", str(points), str(out)]
    started = time.perf_counter()
    process = subprocess.Popen([*words, str(jobs), str(blocks)], stderr=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, words)
    wall = time.perf_counter() - started
    stages: Figures = json.loads((out / "stages.json").read_text(encoding="utf-8"))
    figures: Figures = json.loads((out / "run.json").read_text(encoding="utf-8"))
    return wall, used.ru_utime + used.ru_stime, stages, figures


def make_town(blocks: int, density: float, place: Path) -> Path:
    """The points of a hilly town of so many blocks."""
    area = blocks * SIDE**2 / 1e6
    words = ["simulate", "-o", str(place), "--area", str(area), "--density", str(density), "-q"]
    more = ["--terrain", "hilly", "--seed", "12"]
    subprocess.run([sys.executable, "-m", "eaves.cli.app", *words, *more], check=True)
    return place / "points.laz"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--density", type=float, default=4.0)
    parser.add_argument("--areas", type=int, nargs="+", default=[1, 4, 16, 64], help="In blocks, squares.")
    parser.add_argument("--base", type=int, default=4, help="The area the others are held against.")
    parser.add_argument("--measure", nargs=4, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.measure:
        points, out, jobs, blocks = asked.measure
        return measure(Path(points), Path(out), int(jobs), int(blocks))
    runs: list[dict[str, float]] = []
    with tempfile.TemporaryDirectory() as name:
        for blocks in asked.areas:
            place = Path(name) / str(blocks)
            points = make_town(blocks, asked.density, place)
            if not runs:
                run(points, place / "warm", 1, blocks)  # compiles the kernels
            for jobs in (1, 2):
                wall, cpu, stages, figures = run(points, place / f"out{jobs}", jobs, blocks)
                peak = max(figures["peak_memory_mb"], *stages.values())
                told = {"area": blocks, "jobs": jobs, "wall": wall, "cpu": cpu, "peak": peak}
                told |= {"millions": figures["points"] / 1e6, "found": figures["found"]}
                runs.append(told | {stage: stages.get(stage, 0.0) for stage in STAGES})
                print({key: round(value, 2) for key, value in runs[-1].items()}, flush=True)
    keep(
        "growth",
        "Memory and time as the area grows",
        as_rows(runs, asked.base),
        "python -m benchmarks.scale.growth",
        f"The base is the area of {asked.base} blocks. By stage: the peak of the main process, which with "
        "one process does all the work; the peak of the largest counts the workers, too.",
    )


def as_rows(runs: list[dict[str, float]], base: int) -> list[dict[str, object]]:
    """The table; with one process time and memory are held against the area `base`, with two the time against
    one."""
    alone = {each["area"]: each for each in runs if each["jobs"] == 1}
    first = alone.get(base) or runs[0]
    rows: list[dict[str, object]] = []
    for each in runs:
        one = alone[each["area"]]
        speed, usual = (which["wall"] / which["millions"] for which in (each, first))
        row: dict[str, object] = {
            "area, blocks": int(each["area"]),
            "M points": round(each["millions"], 2),
            "buildings": int(each["found"]),
            "processes": int(each["jobs"]),
            "wall s": round(each["wall"], 1),
            "CPU s": round(each["cpu"], 1),
            "wall s per M points": round(speed, 1),
            "of the base's": f"{speed / usual:.2f}" if each is one else "",
            "times as fast as one": "" if each is one else f"{one['wall'] / each['wall']:.2f}",
            "peak of the largest process, MB": round(each["peak"]),
            "of the base's peak": f"{each['peak'] / first['peak']:.2f}" if each is one else "",
        }
        rows.append(row | {f"{stage}, MB": round(each[stage]) for stage in STAGES})
    return rows


if __name__ == "__main__":
    main()
