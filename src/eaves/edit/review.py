"""The queue of buildings to be looked at, and what a town's edits say of the reasons that put them there."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from eaves.flow import Edit, read_edits
from eaves.formats import read_polygons


@dataclass(frozen=True)
class Reviewed:
    """A building to be looked at: its id, what may be wrong of it (m²), and why."""

    id: str
    worth_m2: float
    reason: str


def read_queue(folder: Path) -> list[Reviewed]:
    """The buildings of the table `review.csv` of a run, in its order; none where it wrote none."""
    path = folder / "review.csv"
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return [Reviewed(row["id"], float(row["worth_m2"]), row["reason"]) for row in csv.DictReader(file)]


def kinds_of(reason: str) -> list[str]:
    """The single reasons of a building, without their numbers."""
    return [re.sub(r"[\d.,]+ ?%?", "…", part).strip() for part in reason.split("; ") if part]


def summarise(edits: Sequence[Edit]) -> str:
    """Which reasons of the review led to edits, and which did not, a line each."""
    looked: dict[str, tuple[str, bool]] = {}
    for edit in edits:
        if edit.reason:
            _, changed = looked.get(edit.id, ("", False))
            looked[edit.id] = edit.reason, changed or edit.verdict != "right"
    led, count = Counter[str](), Counter[str]()
    for reason, changed in looked.values():
        for kind in dict.fromkeys(kinds_of(reason)):
            count[kind] += 1
            led[kind] += changed
    changed_count = sum(changed for _, changed in looked.values())
    verdicts = Counter(edit.verdict for edit in edits)
    counts = ", ".join(f"{name} {n}" for name, n in verdicts.most_common()) or "none"
    lines = [
        f"{len(edits)} edit{'s' * (len(edits) != 1)}: {counts}",
        f"{len(looked)} buildings of the review were looked at: {changed_count} edited, "
        f"{len(looked) - changed_count} right",
    ]
    lines += [f"  {led[kind]:>4} of {n:>4} edited: {kind}" for kind, n in count.most_common()]
    return "\n".join(lines)


def summarise_folder(folder: Path) -> str:
    """The same of the edits that a run's folder keeps."""
    path = folder / "edits.gpkg"
    system = read_polygons(folder / "footprints.gpkg", "footprints")[3]
    return summarise(read_edits(path, system) if path.exists() else [])
