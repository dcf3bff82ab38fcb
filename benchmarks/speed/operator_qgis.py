"""The same edits by QGIS's own tools and `eaves update`: steps counted, edits made in the layer by GDAL.

QGIS itself does not run here. What its tools leave in the layer is written by GDAL, as QGIS does; the steps
are those of its manual (3.34, "Editing", "Advanced digitizing"). A step is a click, a key, or a drag.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import shapely

ONCE = (("open the project", 1), ("choose the layer `footprints`", 1), ("Toggle Editing", 1))
FIND = (("its row in the table of `review`", 1), ("Zoom to Feature", 1))
STEPS = {
    "edge moved": (("Vertex Tool (kept)", 0), ("click on the edge", 1), ("click where it goes", 1)),
    "delete": (("Select Features (kept)", 0), ("click on it", 1), ("Delete Selected", 1)),
    "split": (("Split Features", 1), ("two clicks", 2), ("right click", 1), ("back to the tool before", 1)),
    "join": (
        ("Select Features", 1),
        ("two clicks with shift", 2),
        ("Merge Selected Features", 1),
        ("Take attributes from selection", 1),
        ("OK", 1),
    ),
    "finer roof": (("Identify Features", 1), ("click on it", 1), ("its form", 1), ("the verdict, chosen", 2)),
}
LAST = (("Save Layer Edits", 1), ("`eaves update OUT` in a terminal", 1), ("reload the layers", 1))
SEE = (("find it again", 1),)


def steps() -> list[dict[str, object]]:
    """The steps of each kind of edit."""
    parts = {
        "once, before": ONCE,
        "each building, found": FIND,
        **STEPS,
        "update, and reload": LAST,
        "seen": SEE,
    }
    return [
        {
            "what": what,
            "steps": sum(count for _, count in some),
            "which": ", ".join(f"{n} ({k})" for n, k in some),
        }
        for what, some in parts.items()
    ]


def kept_changes(done: Sequence[str]) -> list[str]:
    """The changes of one building that stay: what was undone is not made in QGIS."""
    kinds = [what for what in done if what in STEPS]
    if "undone" in done:
        kinds.remove("finer roof")
    return kinds


def counted(done: Sequence[str]) -> int:
    """The steps of the changes of one building in QGIS, found and seen again."""
    made = sum(count for what in kept_changes(done) for _, count in STEPS[what])
    return made + sum(count for _, count in (*FIND, *SEE))


def done_alike(
    folder: Path, corrected: Path, edits: Sequence[Any], made: Sequence[Any], place: Path
) -> Iterator[dict[str, object]]:
    """The edits of some buildings of a review made in the layer of a copy of the run, and updated: once for
    all, and for each of the first three by itself."""
    names = {stem(one.id) for one in made}
    actions = {edit.action for edit in edits if stem(edit.id) in names}  # neighbours change with them
    mine = [edit for edit in edits if edit.action in actions]
    wait, cpu, alike = updated(folder, corrected, mine, place)
    once = sum(count for _, count in (*ONCE, *LAST))
    waits = [wait[1] for one in made for wait in one.waits]
    cost = sum(wait[2] for one in made for wait in one.waits)
    pressed = sum(one.actions for one in made)

    def row(
        way: str, actions: int, waited: float, seen: object, cpu: float, alike: object
    ) -> dict[str, object]:
        """A way of making the changes: its actions, and the seconds that they take."""
        return {
            "run": folder.name,
            "way": way,
            "buildings": len(made),
            "actions": actions,
            "actions a building": round(actions / max(len(made), 1), 1),
            "waited in all (s)": round(waited, 1),
            "seen after, median (s)": seen,
            "CPU in all (s)": round(cpu, 1),
            "outlines alike": alike,
        }

    middle = round(float(np.median(waits)), 2) if waits else None
    yield row("table", pressed, sum(waits), middle, cost, None)
    steps_made = once + sum(counted(one.done) for one in made)
    yield row("QGIS, one update for all", steps_made, wait, round(wait, 1), cpu, alike)
    single = [updated(folder, corrected, own(mine, one.id), place) for one in made[:3]]
    if single:
        each, work = (float(np.median([one[k] for one in single])) for k in (0, 1))
        last = sum(count for _, count in LAST)
        steps_made = sum(count for _, count in ONCE) + sum(counted(one.done) + last for one in made)
        way, same = "QGIS, an update each (three measured)", "; ".join(one[2] for one in single)
        yield row(way, steps_made, each * len(made), round(each, 1), work * len(made), same)


def own(edits: Sequence[Any], name: str) -> list[Any]:
    """The edits of the actions on one building."""
    actions = {edit.action for edit in edits if stem(edit.id) == stem(name)}
    return [edit for edit in edits if edit.action in actions]


def stem(name: str) -> str:
    """The building that was found, of which an id names a part."""
    return name.partition("-")[0]


def updated(folder: Path, corrected: Path, edits: Sequence[Any], place: Path) -> tuple[float, float, str]:
    """Seconds of the clock and of processors of an update of a copy of a run with edits in its layer, and how
    many of the outlines of these buildings are those of the corrected run."""
    copy = place / folder.name
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(folder, copy)
    path, names = copy / "footprints.gpkg", {stem(edit.id) for edit in edits}
    there, wanted = outlines(path), outlines(corrected / "footprints.gpkg")
    frame = pyogrio.read_dataframe(path, layer="footprints")
    frame["verdict"] = None
    kept = frame[[stem(name) not in names for name in frame.id]]
    rows = []
    verdicts = {stem(edit.id): edit.verdict for edit in edits if "roof" in edit.verdict}
    for name, shape in wanted.items():
        if stem(name) in names:
            row = frame[frame.id == stem(name)].iloc[0].copy() if stem(name) in there else None
            if row is not None:
                row["geometry"], row["verdict"] = shape, verdicts.get(name)
                rows.append(row)
    again = (
        kept
        if not rows
        else type(frame)([*kept.to_dict("records"), *(r.to_dict() for r in rows)], crs=frame.crs)
    )
    pyogrio.write_dataframe(again, path, layer="footprints")
    command = [sys.executable, "-m", "eaves", "update", str(copy), "--quiet"]
    before, began = os.times(), time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    wait, after = time.perf_counter() - began, os.times()
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    now = [shape for name, shape in outlines(path).items() if stem(name) in names]
    meant = [shape for name, shape in wanted.items() if stem(name) in names]
    same = sum(any(one.symmetric_difference(two).area < 0.01 * two.area for one in now) for two in meant)
    return wait, cpu, f"{same} of {len(meant)}"


def outlines(path: Path) -> dict[str, Any]:
    """Id → outline of the layer of footprints."""
    facts, _, geometry, columns = pyogrio.raw.read(path, layer="footprints", columns=["id"])
    assert list(facts["fields"]) == ["id"]
    return dict(zip(columns[0].tolist(), shapely.from_wkb(geometry), strict=True))
