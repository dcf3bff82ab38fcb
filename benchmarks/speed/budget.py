"""Where the processor time of `eaves build` goes, stage by stage, and what no program could do without.

usage: python -m benchmarks.speed.budget [NAME…]                      (needs EAVES_DATA)
       python -m benchmarks.speed.budget --against TREE [--turns 3] [NAME…]

Each run is one process (`--jobs 1`), so that its processor time is all of it. `--against` runs this tree and
another checkout in turns and keeps the ratio of their processor times: on a shared machine a time says
little, a ratio of neighbours in time something.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

import laspy
import numpy as np
from scipy.spatial import cKDTree

from benchmarks.table import keep

HERE = Path(__file__).resolve().parents[2]
GIVEN = ["--footprints", "{data}/delft/footprints.gpkg"]
ROOFER = ["--outputs", "footprints,models"]
RUNS: dict[str, tuple[str, list[str]]] = {
    "delft, both given": ("delft/ahn3.laz", ["--use-classes", *GIVEN]),
    "delft, both given, roofer's outputs": ("delft/ahn3.laz", ["--use-classes", *GIVEN, *ROOFER]),
    "delft, bare": ("delft/ahn3.laz", []),
    "ign_urban": ("ign_urban", []),
    "woodford (feet)": ("woodford/woodford.laz", ["--crs", "EPSG:3089"]),
    "autzen (feet)": ("autzen/autzen_full.laz", ["--crs", "{data}/autzen/srs.wkt"]),
}
TOWNS = {
    "town of 1 million at 4/m²": (1.0, 4.0, False),
    "town of 4 million at 10/m²": (4.0, 10.0, False),
    "town of half a million at 10/m², footprints given": (0.5, 10.0, True),
}
"""Millions of points, points a square metre, and whether its footprints are given."""
STAGES = (
    *("points", "floors", "large", "decks", "ground", "ground, in and out"),
    *("rasters", "detect", "regions, in and out"),
    *("outline", "units", "roof", "reconstruct", "validate", "buildings, in and out"),
)
"""As run.json names them; what writes files is summed up."""
MODELLING = ("outline", "units", "roof", "reconstruct", "validate", "party walls")
"""The stages of one building, whose ratios are kept, too."""


def run_alone(words: list[str], environment: dict[str, str], quiet: bool = False) -> tuple[float, float]:
    """Processor time (s) and peak memory (MB) of a process, which must succeed.

    Python may keep the modules it compiles, as an installed package has them: it compiled all of ours in
    every run (.6 s) where its own setting forbids that.
    """
    environment = {name: value for name, value in environment.items() if name != "PYTHONDONTWRITEBYTECODE"}
    silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL} if quiet else {}
    process = subprocess.Popen(words, env=environment, **silent)
    _, status, used = os.wait4(process.pid, 0)
    if status != 0:
        sys.exit(f"{' '.join(words)} ended with status {os.waitstatus_to_exitcode(status)}")
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1024


def measure(tree: Path, source: Path, options: list[str], data: Path, out: Path) -> dict[str, float]:
    """Processor time (s) of a build from a tree: by stage as its run.json has it, and of all of it."""
    words = [sys.executable, "-m", "eaves", "build", str(source), "-o", str(out), "--quiet", "--jobs", "1"]
    environment = {**os.environ, "PYTHONPATH": str(tree / "src")}
    started = time.perf_counter()
    spent, _ = run_alone([*words, *(word.format(data=data) for word in options)], environment)
    told: dict[str, Any] = json.loads((out / "run.json").read_text(encoding="utf-8"))
    stages = told["stage_cpu_seconds"]
    return {
        **stages,
        "all": spent,
        "wall": time.perf_counter() - started,
        "points": told["points"],
        "buildings": told["found"],
        "MB": told["peak_memory_mb"],
    }


def ratio_of(turns: list[tuple[dict[str, float], dict[str, float]]], part: str) -> float:
    """The median ratio of the processor times of one stage in two trees, over all turns."""
    return round(median(mine.get(part, 0.0) / max(other.get(part, 0.0), 1e-9) for mine, other in turns), 3)


def floors(source: Path) -> dict[str, float]:
    """Processor time (s) of what cannot be left out: decoding x, y, z, one neighbour search, one pass over
    them in memory."""
    times = {}
    start = time.process_time()
    paths = sorted(source.glob("*.la[sz]")) if source.is_dir() else [source]
    xyz = np.concatenate([np.asarray(laspy.read(path).xyz) for path in paths])
    times["laspy to x, y, z"] = time.process_time() - start
    start = time.process_time()
    cKDTree(xyz[:, :2], balanced_tree=False, compact_nodes=False).query(xyz[:, :2], k=8)
    times["8 neighbours"] = time.process_time() - start
    start = time.process_time()
    float(xyz.sum())
    times["one pass"] = time.process_time() - start
    return times


def row_of(name: str, taken: dict[str, float], floor: dict[str, float]) -> dict[str, object]:
    """One line of the table."""
    row: dict[str, object] = {
        "data": name,
        "points": int(taken["points"]),
        "buildings": int(taken["buildings"]),
    }
    known = 0.0
    for part in STAGES:
        row[part] = round(taken.get(part, 0.0), 2)
        known += taken.get(part, 0.0)
    writing = sum(seconds for part, seconds in taken.items() if part.startswith("write"))
    row["write"] = round(writing + taken.get("party walls", 0.0) + taken.get("summary", 0.0), 2)
    known += float(str(row["write"]))
    row["start and report"] = round(taken["all"] - known, 2)
    row["all"] = round(taken["all"], 2)
    row["M points a CPU s"] = round(taken["points"] / taken["all"] / 1e6, 3)
    row["peak MB"] = round(taken["MB"])
    row |= {f"floor: {what}": round(seconds, 2) for what, seconds in floor.items()}
    row["all to laspy"] = round(taken["all"] / max(floor["laspy to x, y, z"], 1e-9), 1)
    return row


def sources(names: list[str], data: Path, place: Path) -> dict[str, tuple[Path, list[str]]]:
    """The file and the options of each run."""
    chosen = names or [*RUNS, *TOWNS]
    found: dict[str, tuple[Path, list[str]]] = {}
    for name in chosen:
        if name in RUNS:
            file, options = RUNS[name]
            found[name] = (data / file, options)
        else:
            millions, density, given = TOWNS[name]
            town = place / f"town-{millions}"
            words = ["--area", str(millions / density), "--density", str(density), "--seed", "7", "--quiet"]
            subprocess.run([sys.executable, "-m", "eaves", "simulate", "-o", str(town), *words], check=True)
            options = ["--footprints", str(town / "reference.gpkg")] if given else []
            found[name] = (town / "points.laz", options)
    return found


def commit_of(tree: Path) -> str:
    """The short name of a checkout's commit, or of its folder where it is none."""
    words = ["git", "-C", str(tree), "rev-parse", "--short", "HEAD"]
    told = subprocess.run(words, capture_output=True, text=True)
    return told.stdout.strip() if told.returncode == 0 else tree.name


def main() -> None:
    folder = os.environ.get("EAVES_DATA")
    if not folder:
        sys.exit("EAVES_DATA names no folder with the benchmark data")
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join([*RUNS, *TOWNS]))
    parser.add_argument("--against", type=Path, help="another checkout, run in turns with this one")
    parser.add_argument("--turns", type=int, default=3)
    wanted = parser.parse_args()
    data = Path(folder)
    with tempfile.TemporaryDirectory() as temporary:
        place = Path(temporary)
        rows, turns = [], []
        for number, (name, (source, options)) in enumerate(sources(wanted.names, data, place).items()):
            if wanted.against is None:
                measure(HERE, source, options, data, place / f"{number}-warm")
                taken = measure(HERE, source, options, data, place / f"{number}")
                rows.append(row_of(name, taken, floors(source)))
                continue
            ratios, parts = [], []
            for turn in range(wanted.turns):
                mine = measure(HERE, source, options, data, place / f"{number}-{turn}-a")
                other = measure(wanted.against.resolve(), source, options, data, place / f"{number}-{turn}-b")
                ratios.append(mine["all"] / other["all"])
                parts.append((mine, other))
            turns.append(
                {"data": name, "turns": wanted.turns, "ratio": round(median(ratios), 3)}
                | {"least": round(min(ratios), 3), "most": round(max(ratios), 3)}
                | {part: ratio_of(parts, part) for part in MODELLING}
            )
            print(turns[-1], flush=True)
    if turns:
        keep(
            "budget-turns",
            f"Processor time of two checkouts in turns, this to {commit_of(wanted.against)}",
            turns,
            "python -m benchmarks.speed.budget --against TREE",
        )
    if rows:
        keep("budget", "Where the processor time goes", rows, "python -m benchmarks.speed.budget")


if __name__ == "__main__":
    main()
