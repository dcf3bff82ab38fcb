"""Memory and time as the area grows by 4 and by 16, and with two workers.

usage: python -m benchmarks.scale.growth [--density D]
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.table import keep
from eaves.simulate import scan_town, simulate_town, write_simulation

AREA_KM2 = 0.0576
"""One block."""


def build(points: Path, out: Path, jobs: int) -> tuple[float, dict[str, float]]:
    """Wall seconds and the figures of run.json."""
    words = [sys.executable, "-m", "eaves.cli", "build", str(points), "-o", str(out), "-q"]
    started = time.perf_counter()
    subprocess.run([*words, "--jobs", str(jobs)], check=True, capture_output=True)
    wall = time.perf_counter() - started
    figures: dict[str, float] = json.loads((out / "run.json").read_text(encoding="utf-8"))
    return wall, figures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--density", type=float, default=4.0)
    asked = parser.parse_args()
    rows: list[dict[str, object]] = []
    with tempfile.TemporaryDirectory() as name:
        for times in (1, 4, 16):
            place = Path(name) / str(times)
            town = simulate_town(AREA_KM2 * times, terrain="hilly", seed=12)
            points = write_simulation(scan_town(town, asked.density, seed=12), place)["points"]
            for jobs in (1, 2):
                wall, figures = build(points, place / f"out{jobs}", jobs)
                millions = figures["points"] / 1e6
                rows.append(
                    {
                        "area, blocks": times,
                        "M points": round(millions, 2),
                        "processes": jobs,
                        "wall s": round(wall, 1),
                        "wall s per M points": round(wall / millions, 1),
                        "peak of the largest process, MB": figures["peak_memory_mb"],
                        "buildings": figures["found"],
                    }
                )
                print(rows[-1], flush=True)
    keep("growth", "Memory and time as the area grows", rows, "python -m benchmarks.scale.growth")


if __name__ == "__main__":
    main()
