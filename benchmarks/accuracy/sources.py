"""The five published systems, whole, as a user runs them: as published and derived, beside the default.

Run `EAVES_DATA=... python -m benchmarks.accuracy.sources [--chains NAME...] [--sets NAME...]`. Every row is
one `eaves build` of unclassified points in a process of its own; what it wrote is held against the reference.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.accuracy.detection import rates, top_of_cells
from benchmarks.table import commit_now, keep, kept_rows
from eaves.evaluate.detection import evaluate_detection, label_objects
from eaves.evaluate.images import burn_labels
from eaves.model import Raster
from eaves.model.cloud import BUILDING
from eaves.recipe.sources import SOURCES

COMMAND = "python -m benchmarks.accuracy.sources"
CHAINS = ("default", *SOURCES)
SETS: dict[str, tuple[str, ...]] = {
    "delft": ("delft/ahn3.laz",),
    "delft, footprints": ("delft/ahn3.laz",),
    "ign_urban": ("ign_urban/*.laz",),
    "ign_buildings": ("ign_buildings/*postValidation.laz",),
    "town": tuple(["points.laz"]),
    "town, blind": ("points.laz",),
    "amsterdam, blind": ("ahn3_ground/Amsterdam*.las",),
    "williams, blind": ("williams/williams.laz",),
    "ign_sparse, blind": ("ign_sparse/*.laz",),
    "vaihingen": ("vaihingen/*",),
    "woodford": ("woodford/*.la[sz]",),
}
NO_TRUTH = ("vaihingen", "woodford", "ign_buildings")
WINDOWS = {"woodford": "5210000,3905000,5211000,3906000"}
"""Bounds of what is used of a large set, in its own feet."""
HECTARES = "--area", "0.04"
TOWNS = {
    "town": (*HECTARES, "--density", "8", "--terrain", "hilly", "--trees", "2", "--seed", "941"),
    "town, blind": (*HECTARES, "--density", "4", "--terrain", "flat", "--trees", "1", "--seed", "9301"),
}
"""A wooded town on hills, document 3's own claim; and one that had no say in any default."""
Row = dict[str, object]


def run_chain(data: Path, name: str, chain: str, published: bool, out: Path) -> float:
    """Run `eaves build` on one set; the CPU seconds it took, of which reading and writing are a part."""
    inputs = [str(path) for pattern in SETS[name] for path in sorted(data.glob(pattern))]
    words = [sys.executable, "-m", "eaves", "build", *inputs, "-o", str(out), "--jobs", "1", "--quiet"]
    if chain != "default":
        words += ["--source", chain]
    if published:
        words.append("--as-published")
    if name in WINDOWS:
        words += ["--bounds", WINDOWS[name]]
    if name == "delft, footprints":
        words += ["--footprints", str(data / "delft/footprints.gpkg")]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(words, capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if not (out / "footprints.gpkg").exists():
        raise RuntimeError(f"{' '.join(words)}: {done.stderr[-400:]}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def reference_points(data: Path, name: str) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Points (N, 3) of the reference files and which of them are building (N,)."""
    files = [laspy.read(path) for pattern in SETS[name] for path in sorted(data.glob(pattern))]
    xyz = np.concatenate([np.asarray(file.xyz, np.float64) for file in files])
    return xyz, np.concatenate([np.asarray(file.classification) == BUILDING for file in files])


def against_classes(data: Path, name: str, out: Path) -> Row:
    """Area and point figures of the classified points written, against the vendor's class 6."""
    xyz, want = reference_points(data, name)
    written = [laspy.read(path) for path in sorted(out.glob("classified*.laz"))]
    written = written or [laspy.read(path) for path in sorted((out / "classified").glob("*.laz"))]
    place = np.concatenate([np.asarray(file.xyz, np.float64) for file in written])
    classes = np.concatenate([np.asarray(file.classification) for file in written])
    distance, nearest = cKDTree(place).query(xyz, distance_upper_bound=0.02)
    got = np.zeros(len(xyz), bool)
    got[np.isfinite(distance)] = classes[nearest[np.isfinite(distance)]] == BUILDING
    top = top_of_cells(xyz)
    figures = (*rates(got[top], want[top]), *rates(got, want)[1::-1])
    return dict(zip(("compl.", "corr.", "IoU", "point prec.", "point recall"), figures, strict=True))


def against_objects(data: Path, name: str, out: Path) -> Row:
    """Objects of class 6 over 10 m² found, found ones that are true, RMS of the outlines (m)."""
    xyz, want = reference_points(data, name)
    west, south = np.floor(xyz[:, :2].min(axis=0))
    cell = np.floor((xyz[:, :2] - [west, south]) / 0.5).astype(np.int64)
    shape = tuple((cell.max(axis=0) + 1)[::-1])
    true, seen = np.zeros(shape, bool), np.zeros(shape, bool)
    order = np.argsort(xyz[:, 2], kind="stable")
    row, column = cell[order, 1], cell[order, 0]
    true[row, column] = want[order]
    seen[row, column] = True
    return evaluate_objects(true, seen, read_polygons(out), west, south)


def evaluate_objects(
    true: NDArray[np.bool_], seen: NDArray[np.bool_], found: list[Any], west: float, south: float
) -> Row:
    """Per-object figures of polygons against cells (H, W), row 0 south, of half a metre."""
    north = south + 0.5 * true.shape[0]
    got = burn_labels(found, Raster(np.zeros(true.shape, np.float32), west, north, 0.5))
    score = evaluate_detection(got, label_objects(true[::-1]), 0.5, seen[::-1])
    over = score.objects_over[10.0]
    mask, wanted = got[seen[::-1]] > 0, true[::-1][seen[::-1]]
    return {
        "mask IoU": float((mask & wanted).sum() / (mask | wanted).sum()),
        "objects over 10 m²": f"{over.completeness:.2f}/{over.correctness:.2f}",
        "outline RMS": float(score.rms_m),
    }


def read_polygons(out: Path) -> list[Any]:
    """The footprints written, in the unit of the files."""
    frame = pyogrio.read_dataframe(out / "footprints.gpkg", layer="footprints")
    return [shapely.force_2d(shape) for shape in frame.geometry]


def of_models(out: Path) -> Row:
    """Buildings, those at LoD 2.2 by the chain's own method, their median distance to the points."""
    frame = pyogrio.read_dataframe(out / "footprints.gpkg", layer="footprints")
    if "lod" not in frame or not (frame.lod.astype(str) > "0").any():
        return {"buildings": len(frame)}
    fine = frame[(frame.lod == "2.2") & (frame.method != "prism")]
    return {
        "buildings": len(frame),
        "at LoD 2.2": f"{len(fine)}/{len(frame)}",
        "median RMSE of those": float(fine.rmse_m.median()),
    }


def measure(data: Path, name: str, chain: str, published: bool, keep_in: Path | None) -> Row:
    """One row of the table."""
    with tempfile.TemporaryDirectory() as folder:
        out = (keep_in or Path(folder)) / f"{name.replace(', ', '-')}-{chain}-{published}"
        seconds = run_chain(data, name, chain, published, out)
        row: Row = {"data": name, "chain": chain + (", as published" if published else "")}
        row |= {"compl.": None, "corr.": None, "IoU": None, "mask IoU": None}
        row |= {"point prec.": None, "point recall": None}
        row |= {"objects over 10 m²": None, "outline RMS": None}
        row |= {"buildings": None, "at LoD 2.2": None, "median RMSE of those": None}
        if name not in NO_TRUTH and "footprints" not in name:
            row |= against_classes(data, name, out) | against_objects(data, name, out)
        return row | of_models(out) | {"CPU s": round(seconds, 1), "commit": commit_now()}


def main() -> None:
    """Print and keep the table; rows that are not run are those of the newest one."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--chains", nargs="+", choices=CHAINS, default=CHAINS, metavar="NAME")
    options.add_argument("--sets", nargs="+", choices=SETS, default=list(SETS), metavar="NAME")
    options.add_argument("--keep-in", type=Path, help="Folder in which the runs stay.")
    chosen = options.parse_args()
    rows: list[Row] = []
    town = tempfile.TemporaryDirectory()
    for name in chosen.sets:
        if name in TOWNS:
            words = [sys.executable, "-m", "eaves", "simulate", "-o", f"{town.name}/{name}", "--quiet"]
            subprocess.run([*words, *TOWNS[name]], check=True)
    for name in chosen.sets:
        data = Path(town.name) / name if name in TOWNS else Path(os.environ["EAVES_DATA"])
        for chain in chosen.chains:
            for published in (False, True) if chain != "default" else (False,):
                if "footprints" in name and chain not in ("default", "xiao2014", "maas_vosselman"):
                    continue
                row = measure(data, name, chain, published, chosen.keep_in)
                print(json.dumps(row, ensure_ascii=False), flush=True)
                rows.append(row)
    run = {(row["data"], row["chain"]) for row in rows}
    others = [row for row in kept_rows("sources") if (row["data"], row["chain"]) not in run]
    names = list(SETS)
    rows = sorted([*rows, *others], key=lambda row: names.index(str(row["data"])))
    town.cleanup()
    keep("sources", "The published systems", rows, COMMAND, NOTE)


NOTE = """Each row is one `eaves build --source NAME [--as-published]` from unclassified points in bare files.
Completeness, correctness and IoU per area: the classified points written, cells of 0.5 m, a cell being its
highest point, against the vendor's class 6; mask IoU: the same for the footprints written, of all cells
that hold a point; objects: of the footprints written, completeness/correctness
over 10 m². At LoD 2.2: by the chain's own method, not by a prism it fell back to. CPU seconds of the whole
command, reading, writing and the start of Python included. As published: a number where the document
prints one, our default where it prints none, and no step of ours that can be switched off. The derived
defaults of the five detectors were chosen while looking at Delft, ign_urban and the hilly wooded town; all
other sets are blind tests of them."""


if __name__ == "__main__":
    main()
