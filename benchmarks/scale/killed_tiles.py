"""A hundred tiles of a drawn town, killed twice and resumed, and on Dask: is anything twice, or missing?

A small town lies across the corner of four tiles of a run, in a file for each; it is repeated in as many
tiles as are asked for. Held against the same command undisturbed are, byte by byte (`faults.contents`), the
run that is killed twice and resumed, the run of a Dask cluster of four workers, and that of one piece. The
memory is that of the largest process, of few and of all tiles.

usage: python -m benchmarks.scale.killed_tiles [--copies N ...] [--folder FOLDER]
"""

from __future__ import annotations

import argparse
import json
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import laspy
import numpy as np

from benchmarks.scale.faults import contents
from benchmarks.scale.identical import cluster, write_part
from benchmarks.survey_variants import survey_of
from benchmarks.table import as_markdown
from eaves.model import BLOCK_SIDE
from eaves.simulate import scan_town, simulate_town

AREA_KM2, DENSITY, NOISE, SEED = 0.03, 3.0, 0.03, 9401
TILE_M = 16.0 * BLOCK_SIDE
CORNER = np.array([30, 1400])
"""Of four tiles of a run: its column and row, for the first town."""
TOWNS_A_ROW = 5
KILLED_AT = (0.35, 0.5)
"""Shares of the time of the undisturbed run after which it, and the one that resumes it, are killed."""
DASK_WORKERS = 4
VECTORS = (".gpkg", ".jsonl", ".csv")
"""Of files that lie in one place whatever the order of work; rasters lie tile by tile."""


def write_towns(place: Path, copies: int) -> None:
    """Write the town so many times, each with its corner two tiles from the next."""
    place.mkdir(parents=True)
    scene = scan_town(simulate_town(AREA_KM2, style="mixed", seed=SEED), DENSITY, NOISE, seed=SEED)
    survey_of("town", scene).write(place / "town.laz")
    las = laspy.read(place / "town.laz")
    (place / "town.laz").unlink()
    las.header.vlrs.clear()  # copies beside each other have no place on Earth
    middle = np.round(np.array([np.mean(las.x), np.mean(las.y)]))
    xy = np.column_stack([las.x, las.y]) - middle
    offset = las.header.offsets[:2].copy()
    for copy in range(copies):
        corner = (CORNER + [copy % TOWNS_A_ROW * 2, copy // TOWNS_A_ROW * 2]) * TILE_M
        las.points.offsets[:2] = las.header.offsets[:2] = offset + corner - middle
        for quarter in range(4):
            east, north = quarter % 2, quarter // 2
            here = ((xy >= 0.0) == [east, north]).all(axis=1)
            write_part(las, here, place / f"{copy}_{quarter}.laz")


def start(tiles: Path, out: Path, *options: str) -> subprocess.Popen[bytes]:
    """A run of the command."""
    command = [sys.executable, "-m", "eaves", "build", str(tiles), "-o", str(out), "--quiet"]
    return subprocess.Popen([*command, *options], start_new_session=True)


def build(place: Path, copies: int) -> dict[str, object]:
    """The undisturbed run of so many towns, in `place`."""
    write_towns(place / "tiles", copies)
    began = time.perf_counter()
    status = start(place / "tiles", place / "right", "--per-tile", "--jobs", "2").wait()
    run = json.loads((place / "right" / "run.json").read_text(encoding="utf-8"))
    return {
        "tiles": run["tiles"],
        "points": run["points"],
        "buildings": run["found"],
        "status": status,
        "undisturbed (s)": round(time.perf_counter() - began),
        "largest process (MB)": run["peak_memory_mb"],
    }


def differing(right: Path, other: Path, suffixes: tuple[str, ...] = ("",)) -> str:
    """Number of the files of two runs, of some suffixes, that are not the same bytes, of how many."""
    ours, theirs = (
        {name: digest for name, digest in contents(out).items() if name.endswith(suffixes)}
        for out in (right, other)
    )
    return f"{sum(ours.get(name) != theirs.get(name) for name in ours | theirs)} of {len(ours)}"


def disturb(place: Path, seconds: float) -> dict[str, object]:
    """Kill the run twice, resume it; build on Dask, and in one piece; what differs."""
    tiles, right = place / "tiles", place / "right"
    outputs = ("--outputs", "footprints,models")
    for share in KILLED_AT:
        process = start(tiles, place / "killed", "--per-tile", "--resume", "--jobs", "2")
        time.sleep(share * seconds)
        subprocess.run(["pkill", "-9", "-s", str(process.pid)], check=False)
        assert process.wait() == -signal.SIGKILL, "it had ended before it was killed"
    resumed = start(tiles, place / "killed", "--per-tile", "--resume", "--jobs", "2").wait()
    with cluster(DASK_WORKERS) as (address, *_):
        dask = start(tiles, place / "dask", "--per-tile", "--scheduler", address).wait()
        clustered = start(tiles, place / "dask-whole", "--scheduler", address, *outputs).wait()
    whole = start(tiles, place / "whole", "--jobs", "2", *outputs).wait()
    return {
        "statuses": f"{resumed}, {dask}, {clustered}, {whole}",
        "other bytes, killed and resumed": differing(right, place / "killed"),
        "other bytes, Dask": differing(right, place / "dask"),
        "other bytes, Dask in one piece": differing(place / "whole", place / "dask-whole"),
        "other bytes, tiles and one piece": differing(right, place / "whole", VECTORS),
    }


def main(place: Path, copies: Sequence[int]) -> None:
    """Build few towns, then all of them; disturb the last."""
    rows = [build(place / str(count), count) for count in copies]
    print(as_markdown(rows), flush=True)
    print(as_markdown([disturb(place / str(copies[-1]), float(str(rows[-1]["undisturbed (s)"])))]))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--copies", type=int, nargs="+", default=[1, 6, 25])
    parser.add_argument("--folder", type=Path)
    asked = parser.parse_args()
    given = asked.folder or Path(tempfile.mkdtemp())
    main(given, asked.copies)
    if asked.folder is None:
        shutil.rmtree(given)
