"""An update of a hundredth of a survey: what stays, what it costs, and whether it is what a full build gives.

`python -m benchmarks.accuracy.update [FOLDER]`: a simulated town of two epochs in tiles of 250 m, of which a
window with a hundredth of its buildings is flown again; and Delft, of which every other pulse in such a
window comes as a new tile, and all pulses, shaken by 3 mm: nothing has changed there.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import shapely
from numpy.typing import NDArray

from benchmarks.scale.identical import write_part
from eaves.formats import read_polygons
from eaves.model.cloud import GRID_STEP
from eaves.pipeline import build
from eaves.run.store import Store
from eaves.simulate import Survey, later_survey, simulate_epochs, write_simulation
from eaves.upkeep.update import Updated, open_again, update
from eaves.upkeep.versions import lines_of

SEED, AREA_KM2, DENSITIES = 9301, 0.5, (4.0, 5.0)
TILE_M = 250.0
SHARE = 0.01
"""Of the buildings lie in the window."""
OUTPUTS = ("footprints", "models", "mask", "rasters", "classified")


@dataclass(frozen=True)
class Cost:
    """Processor time (s) of a full build, and of the update, with how long it took to read its points."""

    full: float
    update: float
    reading: float


def timed(work: Callable[[], Any]) -> tuple[Any, float]:
    """What came of it, and its processor time (s)."""
    before = time.process_time()
    answer = work()
    return answer, time.process_time() - before


def window_in(out: Path) -> tuple[float, float, float, float]:
    """West, south, east, north of a square in the middle of a run with `SHARE` of its buildings."""
    middles = shapely.get_coordinates(
        shapely.centroid(read_polygons(out / "footprints.gpkg", "footprints")[0])
    )
    middle = np.median(middles, axis=0)
    far = np.sort(np.abs(middles - middle).max(axis=1))
    half = float(far[max(1, round(SHARE * len(far)))])
    return (*(middle - half).tolist(), *(middle + half).tolist())


def inside(las: laspy.LasData, window: tuple[float, float, float, float]) -> NDArray[np.bool_]:
    """Which points lie in a window."""
    west, south, east, north = window
    x, y = np.asarray(las.x), np.asarray(las.y)
    return (x >= west) & (x < east) & (y >= south) & (y < north)


def write_tiles(las: laspy.LasData, folder: Path) -> None:
    """A file a square of `TILE_M` (m)."""
    place = np.column_stack([np.asarray(las.x) // TILE_M, np.asarray(las.y) // TILE_M]).astype(int)
    for column, row in np.unique(place, axis=0).tolist():
        write_part(las, (place == [column, row]).all(axis=1), folder / f"{column}_{row}.laz")


def write_merged(out: Path, like: laspy.LasData, path: Path) -> None:
    """The points that an update used, in one file."""
    run = open_again(out)
    store = Store(run.work_folder)
    blocks = store.blocks(run.side)
    records = [store.read_points(block) for block in blocks]
    xyz = np.concatenate(
        [
            some["xyz"] * GRID_STEP + np.array([*b.origin, 0.0])
            for some, b in zip(records, blocks, strict=True)
        ]
    )
    known = np.concatenate(records)
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.full(3, GRID_STEP), np.floor(xyz.min(axis=0))
    header.vlrs, header.global_encoding = like.header.vlrs, like.header.global_encoding
    las = laspy.LasData(header)
    las.x, las.y, las.z = xyz.T
    for name in ("return_number", "number_of_returns", "classification"):
        las[name] = known[name]
    path.parent.mkdir(parents=True, exist_ok=True)
    las.write(path)


def geometry(out: Path) -> dict[str, str]:
    """Id → all coordinates of a building's model, in whole millimetres."""
    with (out / "buildings.city.jsonl").open(encoding="utf-8") as file:
        corner = json.loads(file.readline())["transform"]["translate"]
    told = {}
    for name, line in lines_of(out / "buildings.city.jsonl").items():
        feature = json.loads(line)
        places = (np.array(feature["vertices"]).reshape(-1, 3) + np.array(corner) * 1000).astype(int).tolist()
        parts = [part.get("geometry", []) for part in feature["CityObjects"].values()]
        told[name] = json.dumps(
            [places, [[(one["lod"], one["boundaries"]) for one in part] for part in parts]]
        )
    return told


def row_of(name: str, out: Path, done: Updated, cost: Cost, whole: Path | None) -> str:
    """A row of the table."""
    before, after = (
        lines_of(out / "buildings.city.jsonl"),
        lines_of(done.folder / "buildings.city.jsonl"),
    )
    versions = done.versions
    touched = {*versions.new, *versions.remodelled}
    others = set(before) - touched - {*versions.gone, *done.beside}
    same = sum(after.get(one) == before[one] for one in others)
    kept = sum(one in after for one in others)
    law = "–"
    if whole is not None:
        mine, full = geometry(done.folder), set(geometry(whole).values())
        law = f"{sum(mine[one] in full for one in touched)} of {len(touched)}"
    share, less = cost.update / cost.full, (cost.update - cost.reading) / cost.full
    cells = [
        name,
        len(before),
        f"{len(versions.remodelled)}, {len(versions.new)}, {len(versions.gone)}, {len(done.beside)}",
        f"{kept} of {len(others)}",
        f"{same} of {len(others)}",
        law,
        f"{cost.full:.1f} s",
        f"{cost.update:.1f} s, of it {cost.reading:.1f} s reading",
        f"{done.blocks[0]} of {done.blocks[1]}",
        f"{share:.1%}",
        f"{less:.1%}",
    ]
    return f"| {' | '.join(map(str, cells))} |"


def reading_of(done: Updated) -> float:
    """Processor time (s) of reading: the new points, and the inputs whose classified copies are written anew
    with these."""
    seconds = done.seconds
    return float(seconds.get("points", 0.0) + seconds.get("write classified", 0.0))


def shaken(las: laspy.LasData, noise: float = 0.003) -> laspy.LasData:
    """The same points, moved by noise (m) in each direction."""
    random = np.random.default_rng(SEED)
    for axis, step in zip("XYZ", las.header.scales, strict=True):
        counts = np.round(random.normal(0.0, noise / step, len(las))).astype(np.int32)
        las[axis] = np.array(las[axis]) + counts
    return las


def judge(name: str, place: Path, files: Path, later: laspy.LasData, every: int, law: bool) -> str:
    """Build a survey, update it in a window with every n-th pulse of a later scan, and compare."""
    out = place / "out"
    _, full = timed(lambda: build(str(files), out, keep=True, outputs=OUTPUTS, jobs=1))
    which = inside(later, window_in(out))
    if every > 1:
        pulses = np.unique(np.asarray(later.gps_time), return_inverse=True)[1]
        which &= pulses % every == 0
    write_part(later, which, place / "tile" / "tile.laz")
    done, spent = timed(lambda: update(out, place / "tile", place / "out2", date="2026-05-01"))
    whole = place / "whole" if law else None
    if whole is not None:
        write_merged(place / "out2", later, place / "merged" / "merged.laz")
        build(str(place / "merged"), whole, outputs=("footprints", "models"), jobs=1)
    return row_of(name, out, done, Cost(full, spent, reading_of(done)), whole)


def main(place: Path) -> None:
    """Print a row a survey."""
    head = ("survey", "buildings", "modelled again, new, gone, beside", "ids kept, of the others")
    head += (
        "lines kept, of the others",
        "geometry as by a full build",
        "full build",
        "update",
        "blocks",
        "share",
        "without reading",
    )
    print(f"| {' | '.join(head)} |\n{'|---' * len(head)}|")
    delft = Path(os.environ["EAVES_DATA"]) / "delft" / "ahn3.laz"
    print(judge("Delft", place / "delft", delft, laspy.read(delft), 2, law=True), flush=True)
    again = shaken(laspy.read(delft))
    print(judge("Delft, shaken by 3 mm", place / "shaken", delft, again, 1, law=False), flush=True)
    town = place / "town"
    epochs = simulate_epochs(AREA_KM2, "slope", seed=SEED, style="mixed", changed=0.3)
    old = Survey(DENSITIES[0]).scan(epochs.old, SEED)
    write_tiles(laspy.read(write_simulation(old, town / "old")["points"]), town / "tiles")
    new = later_survey(DENSITIES[1]).scan(epochs.new, SEED + 1000)
    later = laspy.read(write_simulation(new, town / "new")["points"])
    print(judge("simulated town", town, town / "tiles", later, 1, law=True), flush=True)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as folder:
            main(Path(folder))
