"""Our reader of LAZ files beside laspy's: coordinates, returns, classes and flags of all points.

`EAVES_DATA=... python -m benchmarks.speed.readers`: processor seconds of one process, in turns, the least of
`TURNS`.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
from laspy import DecompressionSelection as Selection

from benchmarks.table import keep
from eaves.formats.points.source import iter_chunks, open_source

FILES = ("autzen/autzen_full.laz", "woodford/woodford.laz")
TURNS = 5
CHUNK_POINTS = 1_000_000
FIELDS = Selection.XY_RETURNS_CHANNEL | Selection.Z | Selection.CLASSIFICATION | Selection.FLAGS


def read_with_eaves(path: Path) -> int:
    """Number of points read."""
    return sum(len(chunk) for chunk in iter_chunks(open_source(path)))


def read_with_laspy(path: Path) -> int:
    """Number of points read, with the same fields as arrays."""
    points = 0
    with laspy.open(path, laz_backend=laspy.LazBackend.Lazrs, decompression_selection=FIELDS) as file:
        for chunk in file.chunk_iterator(CHUNK_POINTS):
            xyz = np.column_stack([chunk.x, chunk.y, chunk.z])
            for field in ("return_number", "number_of_returns", "classification", "withheld"):
                np.array(chunk[field])
            points += len(xyz)
    return points


def seconds(work: Callable[[Path], int], path: Path) -> float:
    """Processor time (s) of reading a file."""
    before = time.process_time()
    work(path)
    return time.process_time() - before


def main() -> None:
    """Print and keep a row a file."""
    data, rows = Path(os.environ["EAVES_DATA"]), []
    for name in FILES:
        path = data / name
        turns = [[seconds(work, path) for work in (read_with_eaves, read_with_laspy)] for _ in range(TURNS)]
        eaves, others = np.min(turns, axis=0)
        rows.append(
            {
                "file": name,
                "points": read_with_eaves(path),
                "eaves, CPU s": round(float(eaves), 2),
                "laspy, CPU s": round(float(others), 2),
                "laspy / eaves": round(float(others / eaves), 2),
            }
        )
    keep(
        "read-speed",
        "Reading beside laspy",
        rows,
        "python -m benchmarks.speed.readers",
        "One process, in turns, the least of five. Ours reads besides: a run of a file's chunks for each "
        "process, records to copy into a classified file, and refuses sizes that memory could not hold.",
    )


if __name__ == "__main__":
    main()
