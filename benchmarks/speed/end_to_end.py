"""`eaves build` as a user runs it, on real data: time, peak memory, buildings, validity.

usage: python -m benchmarks.speed.end_to_end [NAME…]      (needs EAVES_DATA)
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.table import keep
from eaves.run.manifest import read_facts

RUNS: dict[str, tuple[str, list[str]]] = {
    "delft, points only": ("delft/ahn3.laz", []),
    "delft, footprints given": ("delft/ahn3.laz", ["--footprints", "{data}/delft/footprints.gpkg"]),
    "delft, classes believed": ("delft/ahn3.laz", ["--use-classes"]),
    "delft, both": ("delft/ahn3.laz", ["--use-classes", "--footprints", "{data}/delft/footprints.gpkg"]),
    "ign_urban, 4 tiles": ("ign_urban", []),
    "lidR MixedConifer (no buildings)": ("misc/lidR_MixedConifer.laz", []),
    "lidR Topography (no buildings)": ("misc/lidR_Topography.laz", []),
    "autzen (feet)": ("autzen/autzen_full.laz", ["--crs", "{data}/autzen/srs.wkt"]),
}


def run(name: str, data: Path, out: Path) -> dict[str, object]:
    """One row: the figures of run.json with the wall time of the whole process."""
    source, options = RUNS[name]
    words = [sys.executable, "-m", "eaves.cli.app", "build", str(data / source), "-o", str(out), "--quiet"]
    started = time.perf_counter()
    done = subprocess.run(
        [*words, *(word.format(data=data) for word in options)], capture_output=True, text=True
    )
    wall = time.perf_counter() - started
    figures = read_facts(out)
    if "found" not in figures:
        return {"data": name, "exit status": done.returncode, "note": done.stderr.strip()[-80:]}
    checked = subprocess.run(
        [sys.executable, "-m", "eaves.cli.app", "validate", str(out / "buildings.city.jsonl")],
        capture_output=True,
        text=True,
    )
    modelled = max(figures["found"], 1)
    return {
        "data": name,
        "points": figures["points"],
        "found": figures["found"],
        "modelled": figures["modelled"],
        "failed": figures["failed"],
        "LoD 2.2 %": round(100 * figures["by_lod"].get("2.2", 0) / modelled, 1),
        "findings": len(checked.stdout.splitlines()) - 1,
        "wall s": round(wall, 1),
        "peak MB": figures["peak_memory_mb"],
        "exit status": done.returncode,
        "note": "",
    }


def main() -> None:
    folder = os.environ.get("EAVES_DATA")
    if not folder:
        sys.exit("EAVES_DATA names no folder with the benchmark data")
    wanted = sys.argv[1:] or list(RUNS)
    with tempfile.TemporaryDirectory() as place:
        rows = [run(name, Path(folder), Path(place) / str(number)) for number, name in enumerate(wanted)]
    keep("end-to-end", "The whole job, from files to files", rows, "python -m benchmarks.speed.end_to_end")


if __name__ == "__main__":
    main()
