"""What follows from `--block`: classes, buildings and time of one survey with 120 to 5,000 m loaded at once.

usage: python -m benchmarks.scale.blocks [FILE]      (Delft's where none is given; needs EAVES_DATA then)
"""

from __future__ import annotations

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
from numpy.typing import NDArray

from benchmarks.table import keep

SIDES = (240, 120, 480, 960, 5000)
"""Sides of what is loaded (m); the first is the default, against which the others are held."""


def run(source: Path, side: int, out: Path) -> tuple[NDArray[np.uint8], dict[str, Any], float]:
    """The classes (N,) of the points, run.json, and the processor time (s)."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    words = ["build", str(source), "-o", str(out), "--quiet", "--jobs", "1", "--block", str(side)]
    subprocess.run([sys.executable, "-m", "eaves", *words], check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    classes = np.asarray(laspy.read(out / "classified.laz").classification)
    told = json.loads((out / "run.json").read_text(encoding="utf-8"))
    return classes, told, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    source = Path(sys.argv[1] if len(sys.argv) > 1 else Path(os.environ["EAVES_DATA"]) / "delft" / "ahn3.laz")
    rows = []
    with tempfile.TemporaryDirectory() as place:
        usual, _, _ = run(source, SIDES[0], Path(place) / "first")
        for side in SIDES:
            classes, told, seconds = run(source, side, Path(place) / str(side))
            rows.append(
                {
                    "block m": side,
                    "ground differs %": 100 * float(((classes == 2) != (usual == 2)).mean()),
                    "building differs %": 100 * float(((classes == 6) != (usual == 6)).mean()),
                    "buildings": told["found"],
                    "LoD": " ".join(f"{lod}: {count}" for lod, count in told["by_lod"].items()),
                    "CPU s": round(seconds, 1),
                    "peak MB": told["peak_memory_mb"],
                }
            )
    command = "python -m benchmarks.scale.blocks" + (f" {source.name}" if len(sys.argv) > 1 else "")
    keep("blocks", f"What follows from --block: {source.name}", rows, command)


if __name__ == "__main__":
    main()
