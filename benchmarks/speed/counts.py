"""How much work one run does, in numbers that no clock and no other program on the machine can change.

usage: python -m benchmarks.speed.counts [FILE…]       (by default EAVES_DATA/misc/delft_small.laz)

Modules that it imports, and of which a function ran; calls of the package's functions and of its compiled
kernels, for each building; and how many points each of a few steps handles, for each point there is.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from types import FrameType
from typing import Any

from benchmarks.table import keep

SOURCES = Path(__file__).parents[2] / "src/eaves"

HANDLED: Mapping[tuple[str, str], tuple[str, Callable[[Mapping[str, Any], Any], int]]] = {
    ("eaves.blocks.ground", "see_points"): ("read", lambda names, answer: len(answer[1])),
    ("eaves.run.points", "load_window"): ("read", lambda names, answer: len(answer.number)),
    ("eaves.blocks.block", "points"): ("read", lambda names, answer: len(answer)),
    ("eaves.blocks.block", "point_id"): ("read", lambda names, answer: len(answer)),
    ("eaves.model.cloud", "take"): (
        "copied",
        lambda names, answer: 0 if answer is names["self"] else len(answer),
    ),
    ("eaves.model.cloud", "canonical_order"): (
        "sorted",
        lambda names, answer: 0 if names.get("rising", True) else len(answer),
    ),
    ("eaves.ground.stage", "classify_ground"): ("ground", lambda names, answer: len(answer)),
    ("eaves.raster.surfaces", "scene_over"): ("rasters", lambda names, answer: len(answer.cloud)),
    ("eaves.detect.stage", "detect_buildings"): ("detect", lambda names, answer: len(answer.label)),
}
"""Module and function → the step, and the points that a call handled by its local names and its answer."""


def count_work(file: Path, *options: str) -> dict[str, float]:
    """What building a file by the command takes, counted in this process."""
    calls, points, ran = Counter[str](), Counter[str](), set[str]()

    def note(frame: FrameType, event: str, answer: Any) -> None:
        module, name = frame.f_globals.get("__name__", ""), frame.f_code.co_name
        if not module.startswith("eaves"):
            return
        if event == "call" and name != "<module>":
            ran.add(module)
            calls["kernel" if (module, name) == ("eaves.kernels", "__call__") else "python"] += 1
        elif event == "return" and (module, name) in HANDLED:
            step, count = HANDLED[module, name]
            points[step] += count(frame.f_locals, answer)

    from eaves.cli import app

    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        sys.argv = ["eaves", "build", str(file), "-o", str(out), "--jobs", "1", "--quiet", *options]
        sys.setprofile(note)
        try:
            app.main()
        except SystemExit as end:
            if end.code:
                raise
        finally:
            sys.setprofile(None)
        run = json.loads((out / "run.json").read_text(encoding="utf-8"))
    imported = {name for name in sys.modules if name.partition(".")[0] == "eaves"}
    found = max(run["found"], 1)
    return {
        "points": run["points"],
        "buildings": run["found"],
        "modules": sum(1 for _ in SOURCES.rglob("*.py")),
        "imported": len(imported),
        "ran": len(ran & imported),
        "calls a building": round(calls["python"] / found),
        "kernel calls a building": round(calls["kernel"] / found),
        **{step: round(points[step] / run["points"], 2) for step, _ in HANDLED.values()},
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    default = Path(os.environ.get("EAVES_DATA", "")) / "misc/delft_small.laz"
    parser.add_argument("files", nargs="*", type=Path, default=[default])
    parser.add_argument("--crs", help="of the files")
    wanted = parser.parse_args()
    rows = []
    for file in wanted.files:
        words = ("--crs", wanted.crs) if wanted.crs else ()
        rows.append({"data": file.stem, **count_work(file, *words)})
        print(rows[-1], flush=True)
    keep("counts", "How much work a run does", rows, "python -m benchmarks.speed.counts")


if __name__ == "__main__":
    main()
