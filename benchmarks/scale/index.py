"""Index, plan and merge for a country: a million headers, their tiles, and what the tiles wrote.

usage: python -m benchmarks.scale.index [--files N] [--tiles N] [--rows N]

The files are LAZ of 1 km² with a header like AHN's, its records and the first point, and a hole as long as
their points would be: all that an index reads. The merge is measured on tiles of so many made-up footprints.
Index and merge are measured in a process each. A million files take 16 GB of disk, or 6 GB of memory with
TMPDIR in memory.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import pyproj
import shapely

from benchmarks.table import keep
from eaves.flow.merge import merge_footprints
from eaves.flow.run import Run
from eaves.flow.tiles import TileTasks, plan_tiles
from eaves.formats.inputs import list_inputs
from eaves.formats.vectors.geopackage import Row, write_geopackage
from eaves.model import CoordinateSystem
from eaves.recipe.recipe import make_recipe
from eaves.run.index import index_inputs
from eaves.run.partition import Window
from eaves.run.workers import peak_memory_mb

FILE_POINTS = 10_000_000
FILE_SIDE = 1000.0
FILE_BYTES = 50_000_000
TASKS_TRIED = 200
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


def make_tiles(folder: Path, count: int, rows: int) -> list[Path]:
    """Folders of tiles with a GeoPackage of so many footprints each, all alike."""
    shapes = [shapely.box(20.0 * k, 0.0, 20.0 * k + 10, 10.0) for k in range(rows)]
    about = {"id": "b354_1863_101_77", "number": 1, "score": 0.93, "area_m2": 100.0, "lod": "2.2"}
    about |= {
        name: 12.34 for name in ("h_ground", "h_eaves", "h_ridge", "volume_m3", "roof_area_m2", "rmse_m")
    }
    faces = [Row(shapely.force_3d(shape, 3.0), {"building_id": "b", "slope_deg": 31.0}) for shape in shapes]
    first = folder / "template.gpkg"
    write_geopackage(
        first, [Row(shape, about) for shape in shapes], [f for face in faces for f in (face, face)]
    )
    places = [folder / f"{k}_0" for k in range(count)]
    for place in places:
        place.mkdir()
        shutil.copy(first, place / "footprints.gpkg")
    return places


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
    planned = timed("plan the tiles", len(paths), lambda: plan_tiles(index, 240.0))  # type: ignore[arg-type]
    tiles = planned["answer"]
    assert isinstance(tiles, list)
    run = Run(folder, make_recipe(), index, Window(), {})  # type: ignore[arg-type]
    some = tiles[:: max(1, len(tiles) // TASKS_TRIED)]
    sent = timed(
        "tasks of some tiles", len(some), lambda: [len(task.numbers) for task in TileTasks(run, some)]
    )
    sent["answer"] = f"{np.mean(sent['answer']):.0f} files each"  # type: ignore[call-overload]
    return [before, found, made | {"answer": ""}, planned | {"answer": f"{len(tiles)} tiles"}, sent]


def measure_merge(folder: Path, rows: int) -> list[Figures]:
    """Merging what the tiles wrote."""
    places = sorted(place for place in folder.iterdir() if place.is_dir())
    whole = folder / "footprints.gpkg"
    return [
        timed(
            f"merge tiles of {rows} footprints",
            len(places),
            lambda: merge_footprints(whole, places, CoordinateSystem()),
        )
        | {"answer": f"{whole.stat().st_size / 1e6:.0f} MB" if whole.exists() else ""}
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", type=int, default=1_000_000)
    parser.add_argument("--tiles", type=int, default=2000)
    parser.add_argument("--rows", type=int, default=150)
    parser.add_argument("--measure", choices=("index", "merge"))
    parser.add_argument("--folder", type=Path)
    asked = parser.parse_args()
    if asked.measure:
        measured = (
            measure_index(asked.folder)
            if asked.measure == "index"
            else measure_merge(asked.folder, asked.rows)
        )
        print(json.dumps(measured))
        return
    rows: list[Figures] = []
    with tempfile.TemporaryDirectory() as name:
        make_headers(Path(name) / "files", asked.files)
        (Path(name) / "tiles").mkdir()
        make_tiles(Path(name) / "tiles", asked.tiles, asked.rows)
        for what, folder in (("index", "files"), ("merge", "tiles")):
            words = [sys.executable, "-m", "benchmarks.scale.index", "--measure", what]
            words += ["--rows", str(asked.rows)]
            done = subprocess.run(
                [*words, "--folder", str(Path(name) / folder)], capture_output=True, text=True, check=True
            )
            rows += json.loads(done.stdout.splitlines()[-1])
    command = (
        f"python -m benchmarks.scale.index --files {asked.files} --tiles {asked.tiles} --rows {asked.rows}"
    )
    keep("index", "Index, plan and merge for a country", rows, command)


if __name__ == "__main__":
    main()
