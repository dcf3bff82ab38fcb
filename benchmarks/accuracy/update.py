"""An update of a hundredth of a survey: what stays, what it costs, and whether it is what a full build gives.

`python -m benchmarks.accuracy.update [FOLDER]`: a simulated town of two epochs in tiles of 250 m, of which a
window with a hundredth of its buildings is flown again; and Delft, of which every other pulse in such a
window comes as a new tile.

`python -m benchmarks.accuracy.update FOLDER large`: a town of 3 km² in tiles of 500 m, of which windows with
several shares of the buildings are flown again, in one place and in four. What is in FOLDER/large is used
again: the points take five minutes to make, the full build six. `larger`: one of 2.5 km² with its mirror
image east of it, 5 km²; the points take seven minutes, the full build eleven.

`python -m benchmarks.accuracy.update FOLDER edits`: ten edits on Delft, by `eaves update`, start included.
"""

from __future__ import annotations

import json
import os
import shutil
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

from benchmarks.speed.budget import run_alone
from eaves.change.edits import FLAT_ROOF, FOOTPRINT, NO_BUILDING, PARTY_WALLS, Edit, write_edits
from eaves.change.upkeep.kept import open_kept
from eaves.change.upkeep.update import Updated, update
from eaves.change.upkeep.versions import lines_of
from eaves.formats import read_polygons
from eaves.model.cloud import GRID_STEP
from eaves.pipeline import build
from eaves.run.store import Store
from eaves.simulate import Survey, later_survey, simulate_epochs, write_simulation

SEED, AREA_KM2, DENSITIES = 9301, 0.5, (4.0, 5.0)
TILE_M = 250.0
SHARE = 0.01
"""Of the buildings lie in the window."""
LARGE_DENSITIES, LARGE_TILE_M = (2.5, 3.0), 500.0
LARGE = {"large": (9302, 3.0, False), "larger": (9303, 2.5, True)}
"""Seed and area (km²) of the large towns, and whether the mirror image of one lies beside it."""
PARTS = ((0.0025, 1), (0.01, 1), (0.01, 4), (0.04, 1))
"""Of the large town: the share of its buildings, and in how many places."""
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


def windows_in(out: Path, share: float = SHARE, places: int = 1) -> list[tuple[float, float, float, float]]:
    """West, south, east, north of a square in the middle of a run with so much of its buildings; or of four,
    each in the middle of a quarter, with that much together."""
    middles = shapely.get_coordinates(
        shapely.centroid(read_polygons(out / "footprints.gpkg", "footprints")[0])
    )
    low, high = middles.min(axis=0), middles.max(axis=0)
    quarters = [low + (high - low) * [x, y] for x in (0.25, 0.75) for y in (0.25, 0.75)]
    found = []
    for middle in quarters if places == 4 else [np.median(middles, axis=0)]:
        far = np.sort(np.abs(middles - middle).max(axis=1))
        half = float(far[max(1, round(share * len(far) / places))])
        found.append((*(middle - half).tolist(), *(middle + half).tolist()))
    return found


def inside(las: laspy.LasData, window: tuple[float, float, float, float]) -> NDArray[np.bool_]:
    """Which points lie in a window."""
    west, south, east, north = window
    x, y = np.asarray(las.x), np.asarray(las.y)
    return (x >= west) & (x < east) & (y >= south) & (y < north)


def write_part(las: laspy.LasData, which: NDArray[np.bool_], path: Path) -> None:
    """Some points of a file in one of their own."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = laspy.LasData(las.header)
    part.points = las.points[which].copy()
    part.write(path)


def write_tiles(las: laspy.LasData, folder: Path, side: float = TILE_M) -> None:
    """A file a square of a side (m)."""
    place = np.column_stack([np.asarray(las.x) // side, np.asarray(las.y) // side]).astype(int)
    for column, row in np.unique(place, axis=0).tolist():
        write_part(las, (place == [column, row]).all(axis=1), folder / f"{column}_{row}.laz")


def write_merged(out: Path, like: laspy.LasData, path: Path) -> None:
    """The points that an update used, in one file."""
    run = open_kept(out)
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
        lines_of(done.summary.folder / "buildings.city.jsonl"),
    )
    versions = done.versions
    touched = {*versions.new, *versions.remodelled}
    others = set(before) - touched - {*versions.gone, *done.beside}
    same = sum(after.get(one) == before[one] for one in others)
    kept = sum(one in after for one in others)
    law = "–"
    if whole is not None:
        mine, full = geometry(done.summary.folder), set(geometry(whole).values())
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
    seconds = done.summary.seconds
    return float(seconds.get("read", 0.0) + seconds.get("write classified", 0.0))


def judge(name: str, place: Path, files: Path, later: laspy.LasData, every: int, law: bool) -> str:
    """Build a survey, update it in a window with every n-th pulse of a later scan, and compare."""
    out = place / "out"
    _, full = timed(lambda: build(str(files), out, keep=True, outputs=OUTPUTS, jobs=1))
    which = inside(later, windows_in(out)[0])
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


def with_mirror_image(las: laspy.LasData, east: int) -> laspy.LasData:
    """A scan with its mirror image east of a line, in the file's own whole numbers."""
    whole = laspy.LasData(las.header)
    whole.points = laspy.ScaleAwarePointRecord.zeros(2 * len(las.points), header=las.header)
    whole.points.array[:] = np.concatenate([las.points.array, las.points.array])
    x = whole.points.array["X"]
    x[len(las.points) :] = 2 * east - x[len(las.points) :]
    return whole


def make_large(place: Path, seed: int, area_km2: float, mirrored: bool) -> None:
    """Two epochs of a town: `tiles`, and all points of the later one."""
    epochs = simulate_epochs(area_km2, "slope", seed=seed, style="mixed", changed=0.3)
    old = Survey(LARGE_DENSITIES[0]).scan(epochs.old, seed)
    points = laspy.read(write_simulation(old, place / "old")["points"])
    new = later_survey(LARGE_DENSITIES[1]).scan(epochs.new, seed + 1000)
    later = laspy.read(write_simulation(new, place / "new")["points"])
    if mirrored:
        east = int(points.points.array["X"].max())
        points, later = with_mirror_image(points, east), with_mirror_image(later, east)
    write_tiles(points, place / "tiles", LARGE_TILE_M)
    later.write(place / "later.laz")


def judge_large(place: Path) -> None:
    """Print a row for each of `PARTS` of the large town that a folder is called after."""
    if not (place / "later.laz").exists():
        make_large(place, *LARGE[place.name])
    if not (place / "full.json").exists():
        tiles = str(place / "tiles")
        _, full = timed(lambda: build(tiles, place / "out", keep=True, outputs=OUTPUTS, jobs=1))
        (place / "full.json").write_text(json.dumps({"full": full}), encoding="utf-8")
    full = json.loads((place / "full.json").read_text(encoding="utf-8"))["full"]
    later = laspy.read(place / "later.laz")
    for share, places in PARTS:
        name = f"{share:.2%} in {places}"
        which = np.zeros(len(later.points), bool)
        for window in windows_in(place / "out", share, places):
            which |= inside(later, window)
        write_part(later, which, place / name / "tile" / "tile.laz")
        done, spent = timed(
            lambda folder=place / name: update(
                place / "out", folder / "tile", folder / "out2", date="2026-05-01"
            )
        )
        cost = Cost(full, spent, reading_of(done))
        print(row_of(f"{place.name} town, {name}", place / "out", done, cost, None), flush=True)
        print({step: round(value, 1) for step, value in done.summary.seconds.items()}, file=sys.stderr)


def judge_edits(place: Path) -> None:
    """Print the processor time (s) of `eaves update` with ten edits on Delft, several times."""
    out, edits = place / "out", place / "edits.gpkg"
    if not out.exists():
        build(str(Path(os.environ["EAVES_DATA"]) / "delft" / "ahn3.laz"), out, keep=True, jobs=1)
        polygons, _, rows, system = read_polygons(out / "footprints.gpkg", "footprints")
        some = [(one, row["id"]) for one, row in zip(polygons, rows, strict=True) if one.area > 40.0]
        some = some[:: len(some) // 10][:10]
        west, south, east, north = some[9][0].bounds
        halves = (
            shapely.box(west, south, (west + east) / 2, north),
            shapely.box((west + east) / 2, south, east, north),
        )
        told = [Edit(FLAT_ROOF, *one) for one in some[:4]] + [Edit(NO_BUILDING, *one) for one in some[4:7]]
        told += [Edit(FOOTPRINT, one.buffer(0.3, join_style="mitre"), name) for one, name in some[7:9]]
        told += [Edit(PARTY_WALLS, some[9][0].intersection(half), some[9][1]) for half in halves]
        write_edits(edits, told, system)
        shutil.copytree(out, place / "kept")
    for _ in range(3):
        shutil.rmtree(out)
        shutil.copytree(place / "kept", out)
        words = [sys.executable, "-m", "eaves", "update", str(out), "--edits", str(edits)]
        spent, _ = run_alone(words, dict(os.environ))
        steps = json.loads((out / "run.json").read_text(encoding="utf-8"))["stage_cpu_seconds"]
        print(f"{spent:.1f} s; {steps}", flush=True)


def main(place: Path, what: str = "") -> None:
    """Print a row a survey."""
    if what == "edits":
        judge_edits(place / "edits")
        return
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
    if what in LARGE:
        judge_large(place / what)
        return
    delft = Path(os.environ["EAVES_DATA"]) / "delft" / "ahn3.laz"
    print(judge("Delft", place / "delft", delft, laspy.read(delft), 2, law=True), flush=True)
    town = place / "town"
    epochs = simulate_epochs(AREA_KM2, "slope", seed=SEED, style="mixed", changed=0.3)
    old = Survey(DENSITIES[0]).scan(epochs.old, SEED)
    write_tiles(laspy.read(write_simulation(old, town / "old")["points"]), town / "tiles")
    new = later_survey(DENSITIES[1]).scan(epochs.new, SEED + 1000)
    later = laspy.read(write_simulation(new, town / "new")["points"])
    print(judge("simulated town", town, town / "tiles", later, 1, law=True), flush=True)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]), *sys.argv[2:3])
    else:
        with tempfile.TemporaryDirectory() as folder:
            main(Path(folder))
