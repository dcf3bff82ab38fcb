"""How fast points are read: a real survey as LAZ, and the same points uncompressed.

Run `EAVES_DATA=... python -m benchmarks.speed.read`.
"""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path

import laspy
import numpy as np

from benchmarks.table import keep
from eaves.formats import iter_chunks, open_source

COMMAND = "python -m benchmarks.speed.read"
TARGET = 1.5
RUNS = 3


def measure(name: str, path: Path, crs: str) -> dict[str, object]:
    """One row: the median of some runs by processor time, opening included."""
    runs = []
    for _ in range(RUNS):
        wall, processor = time.perf_counter(), time.process_time()
        points = sum(map(len, iter_chunks(open_source(path, crs))))
        runs.append((time.process_time() - processor, time.perf_counter() - wall, points))
    processor, wall, points = sorted(runs)[RUNS // 2]
    return {
        "file": name,
        "points": points,
        "CPU seconds": processor,
        "seconds": wall,
        "million points per CPU second": points / processor / 1e6,
        "target": TARGET,
    }


def rival(path: Path) -> dict[str, object]:
    """The same points through laspy's own chunks, coordinates scaled."""
    wall, processor = time.perf_counter(), time.process_time()
    points = 0
    with laspy.open(path) as reader:
        for chunk in reader.chunk_iterator(300_000):
            points += len(np.column_stack([chunk.x, chunk.y, chunk.z]))
    processor, wall = time.process_time() - processor, time.perf_counter() - wall
    return {
        "file": "the LAZ file, by laspy",
        "points": points,
        "CPU seconds": processor,
        "seconds": wall,
        "million points per CPU second": points / processor / 1e6,
        "target": None,
    }


def main() -> None:
    """Print and keep the table."""
    folder = Path(os.environ["EAVES_DATA"]) / "autzen"
    compressed, crs = folder / "autzen_full.laz", str(folder / "srs.wkt")
    rows = [measure("Autzen, LAZ", compressed, crs), rival(compressed)]
    with tempfile.TemporaryDirectory() as place:
        plain = Path(place) / "autzen.las"
        laspy.read(compressed).write(plain)
        rows.append(measure("Autzen, LAS", plain, crs))
    keep(
        "read-speed",
        "Reading points",
        rows,
        COMMAND,
        f"Median of {RUNS} runs by processor time; laspy once. Whole file, all points, metres.",
    )


if __name__ == "__main__":
    main()
