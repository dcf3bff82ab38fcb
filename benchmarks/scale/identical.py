"""The same buildings, whatever the files, the order of points and who computes.

usage: python -m benchmarks.scale.identical [--area KM2] [--density D] [--jobs N]
(EAVES_DATA adds ign_urban and Delft)
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import laspy
import numpy as np

from benchmarks.table import keep
from eaves.pipeline import build
from eaves.run.options import RunOptions
from eaves.simulate import scan_town, simulate_town, write_simulation

SCHEDULER_PORT = 18786


def write_part(las: laspy.LasData, which: np.ndarray, path: Path) -> None:
    """Some points of a file as a file of their own."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = laspy.LasData(las.header)
    part.points = las.points[which].copy()
    part.write(path)


def split(las: laspy.LasData, folder: Path, columns: int, shift: float, shuffle: bool) -> Path:
    """The cloud in columns² files cut along a grid shifted by a share of its step."""
    folder.mkdir()
    x, y = np.asarray(las.x), np.asarray(las.y)
    order = np.random.default_rng(1).permutation(len(x)) if shuffle else np.arange(len(x))
    step = max(np.ptp(x), np.ptp(y)) / columns
    column = np.floor((x - x.min()) / step + shift).astype(int)
    row = np.floor((y - y.min()) / step + shift).astype(int)
    key = (column * 1000 + row)[order]
    for value in np.unique(key):
        write_part(las, order[key == value], folder / f"part_{value}.laz")
    return folder


def digest(out: Path) -> tuple[str, str]:
    """A hash of all models with ids, planes and attributes, to the millimetre; and one of class, building and
    plane of every point by place, empty where no points were written."""
    models = {}
    for path in out.glob("buildings.city.jsonl"):
        with path.open(encoding="utf-8") as file:
            frame = json.loads(next(file))
            scale, start = (np.array(frame["transform"][name]) for name in ("scale", "translate"))
            for line in file:
                found = json.loads(line)
                vertices = np.array(found["vertices"]).reshape(-1, 3)
                found["vertices"] = np.round(vertices + start / scale).astype(int).tolist()
                models[found["id"]] = hashlib.sha256(json.dumps(found).encode()).hexdigest()
    of_models = hashlib.sha256(json.dumps(sorted(models.items())).encode()).hexdigest()[:12]
    tables = [point_table(path) for path in sorted(out.glob("classified*.laz"))]
    if not tables:
        return of_models, ""
    table = np.concatenate(tables)
    return of_models, hashlib.sha256(table[np.lexsort(table.T)].tobytes()).hexdigest()[:12]


def point_table(path: Path) -> np.ndarray:
    """Place, class, building, plane and return of every point."""
    las = laspy.read(path)
    fields = (las.X, las.Y, las.Z, las.classification, las.building_id, las.plane_id, las.return_number)
    return np.column_stack([np.asarray(values, np.int64) for values in fields])


@contextmanager
def cluster(workers: int = 2) -> Iterator[tuple[str, *tuple[subprocess.Popen[bytes], ...]]]:
    """A Dask scheduler and its workers as processes on loopback: its address, and all of them."""
    address = f"tcp://127.0.0.1:{SCHEDULER_PORT}"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    words = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--no-dashboard"]
    started = [subprocess.Popen([*words, "--port", str(SCHEDULER_PORT)], **quiet)]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--host", "127.0.0.1"]
    started += [
        subprocess.Popen([*worker, "--nthreads", "1", "--no-nanny", "--no-dashboard"], **quiet)
        for _ in range(workers)
    ]
    try:
        yield address, *started
    finally:
        for process in reversed(started):
            process.terminate()
            try:
                process.wait(30)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


Way = tuple[str, float, int, tuple[str, str]]
"""Name, seconds, buildings and digest."""


def variants(points: Path, place: Path, given: RunOptions, jobs: int) -> Iterator[Way]:
    """Every way to run the same points: the first in one process, files cut otherwise in `jobs`."""
    las = laspy.read(points)
    folders = {
        "one file": points,
        "4 files": split(las, place / "four", 2, 0.0, False),
        "36 files": split(las, place / "many", 6, 0.0, False),
        "cut elsewhere": split(las, place / "other", 3, 0.37, False),
        "points shuffled": split(las, place / "shuffled", 2, 0.0, True),
    }
    del las

    def once(name: str, source: Path, **way: Any) -> Way:
        out = place / "out"
        shutil.rmtree(out, ignore_errors=True)
        started = time.perf_counter()
        summary = build(source, out, **{**given, **way})
        return name, time.perf_counter() - started, summary.found, digest(out)

    yield once("one file, serial", points)
    for name, source in folders.items():
        yield once(f"{name}, {jobs} processes", source, jobs=jobs)
    yield once("36 files, by tiles", folders["36 files"], jobs=jobs, per_tile=True)
    with cluster() as (address, *_):
        yield once("one file, Dask, 2 workers", points, scheduler=address)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--area", type=float, default=4.0, help="Of the town (km²); 0 for none.")
    parser.add_argument("--density", type=float, default=2.0)
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    rows: list[dict[str, object]] = []
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        jobs: list[tuple[str, Path, RunOptions]] = []
        if asked.area:
            town = simulate_town(asked.area, terrain="hilly", seed=11)
            points = write_simulation(scan_town(town, asked.density, seed=11), place / "town")["points"]
            jobs.append((f"town, {asked.area:g} km²", points, {}))
        data = os.environ.get("EAVES_DATA")
        if data:
            tiles = [laspy.read(path) for path in sorted(Path(data, "ign_urban").glob("*.laz"))]
            whole = laspy.LasData(tiles[0].header)
            whole.points = laspy.ScaleAwarePointRecord(
                np.concatenate([tile.points.array for tile in tiles]),
                tiles[0].point_format,
                tiles[0].points.scales,
                tiles[0].points.offsets,
            )
            whole.write(place / "ign.laz")
            jobs.append(("ign_urban", place / "ign.laz", RunOptions()))
            delft = Path(data, "delft")
            given = RunOptions(footprints=delft / "footprints.gpkg")
            jobs.append(("Delft, footprints given", delft / "ahn3.laz", given))
        for number, (data_name, source, options) in enumerate(jobs):
            (place / str(number)).mkdir()
            first = None
            for name, seconds, found, hashed in variants(source, place / str(number), options, asked.jobs):
                first = first or hashed
                same = hashed[0] == first[0] and hashed[1] in (first[1], "")
                rows.append(
                    {
                        "data": data_name,
                        "way": name,
                        "s": round(seconds, 1),
                        "buildings": found,
                        "models": hashed[0],
                        "points": hashed[1] or "not written",
                        "identical": "yes" if same else "NO",
                    }
                )
                print(rows[-1], flush=True)
    keep("identical", "The tiling cannot be seen in the result", rows, "python -m benchmarks.scale.identical")


if __name__ == "__main__":
    main()
