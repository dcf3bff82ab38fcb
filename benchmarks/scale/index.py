"""Index and plan for a country: a million headers, and their tiles.

usage: python -m benchmarks.scale.index [--files N]

The files are LAZ of 1 km² with a header like AHN's, its records and the first point, and a hole as long as
their points would be: all that an index reads. The index is measured in a process of its own. A million files
take 16 GB of disk, or 6 GB of memory with TMPDIR in memory.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import pyproj

from benchmarks.table import keep
from eaves.flow.run import TILE_SIDE
from eaves.flow.tiles import inputs_meeting, plan_tiles
from eaves.formats.inputs import list_inputs
from eaves.run.index import index_inputs
from eaves.run.workers import peak_memory_mb

FILE_POINTS = 10_000_000
FILE_SIDE = 1000.0
FILE_BYTES = 50_000_000
TILES_TRIED = 200
REACH_M = 2000.0
"""Distance beyond a tile of the points that it is computed from, about."""
Figures = dict[str, object]


def make_headers(folder: Path, count: int) -> None:
    """So many files in a square country, side by side."""
    folder.mkdir()
    template = folder.parent / "template.laz"
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.full(3, 0.001), np.zeros(3)
    header.add_crs(pyproj.CRS.from_epsg(7415))
    las = laspy.LasData(header)
    las.x, las.y, las.z = np.zeros((3, 1))
    las.write(template)
    data = bytearray(template.read_bytes())
    start = int(np.frombuffer(data, "<u4", 1, 96)[0])
    side = int(np.ceil(np.sqrt(count)))
    for k in range(count):
        west, south = FILE_SIDE * (k % side), 300_000.0 + FILE_SIDE * (k // side)
        box = west + FILE_SIDE - 0.001, west, south + FILE_SIDE - 0.001, south, 40.0, -1.0
        data[179:227] = np.array(box).tobytes()
        data[247:255] = np.int64(FILE_POINTS).tobytes()
        data[start + 8 : start + 20] = (
            np.round(np.array([west + 1, south + 1, 2.0]) / 0.001).astype("<i4").tobytes()
        )
        with (folder / f"{k:07d}.laz").open("wb", buffering=0) as file:
            file.write(data)
            file.truncate(FILE_BYTES)


def timed(step: str, number: int, act: Callable[[], object]) -> Figures:
    """A row: wall and processor seconds of one step, and the peak memory so far."""
    started, busy = time.perf_counter(), time.process_time()
    answer = act()
    return {
        "step": step,
        "number": number,
        "s": round(time.perf_counter() - started, 2),
        "CPU s": round(time.process_time() - busy, 2),
        "peak MB": round(peak_memory_mb()),
        "answer": answer,
    }


def measure_index(folder: Path) -> list[Figures]:
    """Finding, indexing and planning."""
    before = timed("import", 0, lambda: "")
    found = timed("find the files", 0, lambda: list_inputs(folder))
    paths = found["answer"]
    assert isinstance(paths, list)
    found |= {"number": len(paths), "answer": ""}
    made = timed("index their headers", len(paths), lambda: index_inputs(paths, None, []))
    index = made["answer"]
    planned = timed("plan the tiles", len(paths), lambda: plan_tiles(index, TILE_SIDE))  # type: ignore[arg-type]
    tiles = planned["answer"]
    assert isinstance(tiles, list)
    some = tiles[:: max(1, len(tiles) // TILES_TRIED)]
    met = timed(
        "inputs of some tiles",
        len(some),
        lambda: [len(inputs_meeting(index, [tile.bounds.buffered(REACH_M)])) for tile in some],  # type: ignore[arg-type]
    )
    met["answer"] = f"{np.mean(met['answer']):.0f} files each"  # type: ignore[call-overload]
    return [before, found, made | {"answer": ""}, planned | {"answer": f"{len(tiles)} tiles"}, met]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", type=int, default=1_000_000)
    parser.add_argument("--measure", type=Path, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.measure:
        print(json.dumps(measure_index(asked.measure)))
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "files"
        make_headers(folder, asked.files)
        words = [sys.executable, "-m", "benchmarks.scale.index", "--measure", str(folder)]
        done = subprocess.run(words, capture_output=True, text=True, check=True)
        rows = json.loads(done.stdout.splitlines()[-1])
    command = f"python -m benchmarks.scale.index --files {asked.files}"
    keep("index", "Index and plan for a country", rows, command)


if __name__ == "__main__":
    main()
