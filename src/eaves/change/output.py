"""The files of a comparison: a layer, a table, and its figures."""

from __future__ import annotations

import csv
import json
from importlib.metadata import version
from pathlib import Path
from typing import Any

from eaves.change.changes import Comparison
from eaves.change.faced import outline_of
from eaves.change.verdict import UNCHANGED, VERDICTS
from eaves.formats import Row, atomic, write_layers

LAYER, TABLE, SUMMARY = "changes.gpkg", "changes.csv", "changes.json"


def write_comparison(comparison: Comparison, folder: Path) -> list[Path]:
    """Write changes.gpkg (layers `changes`, a row a building, and `parts`, where roofs differ), changes.csv
    and changes.json into a folder; the files."""
    paths = [folder / name for name in (LAYER, TABLE, SUMMARY)]
    layers = {"changes": [Row(one.polygon, one.row) for one in comparison.changes]}
    parts = part_rows(comparison)
    layers |= {"parts": parts} if parts else {}
    write_layers(paths[0], layers, comparison.old.system)
    with atomic(paths[1]) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        names = list(comparison.changes[0].row) if comparison.changes else ["id", "change"]
        writer = csv.DictWriter(file, names)
        writer.writeheader()
        writer.writerows(one.row for one in comparison.changes)
    with atomic(paths[2]) as temporary:
        temporary.write_text(
            json.dumps(describe_comparison(comparison), indent=1, allow_nan=False), encoding="utf-8"
        )
    return paths


def part_rows(comparison: Comparison) -> list[Row]:
    """The parts of changed buildings where a roof came, went or moved."""
    spacing = max(comparison.spacings)
    rows = []
    for change in comparison.changes:
        for patch in change.verdict.patches:
            outline = outline_of(patch, spacing)
            if not outline.is_empty:
                values = {"id": change.id, "change": change.verdict.change, "points": len(patch)}
                rows.append(Row(outline, values))
    return rows


def describe_comparison(comparison: Comparison) -> dict[str, Any]:
    """The inputs, settings and results of a comparison, as JSON."""
    shift = comparison.shift
    return {
        "eaves": version("eaves"),
        "old": {"folder": comparison.old.name, "density": round(comparison.densities[0], 2)},
        "new": {"folder": comparison.new.name, "density": round(comparison.densities[1], 2)},
        "crs": comparison.old.system.code,
        "new_against_old_m": {
            "east": round(shift.east, 3),
            "north": round(shift.north, 3),
            "up": round(shift.up, 3),
            "pairs": shift.pairs,
        },
        "noise_m": round(shift.noise, 3),
        "same_within_m": round(comparison.tolerance, 3),
        "counts": comparison.counts,
        "buildings": [change.row for change in comparison.changes],
    }


def as_text(comparison: Comparison) -> str:
    """The closing lines of a comparison."""
    shift, counts = comparison.shift, comparison.counts
    words = ", ".join(f"{counts[name]} {name}" for name in VERDICTS if name in counts)
    changed = sum(one.verdict.change != UNCHANGED for one in comparison.changes)
    lines = [
        f"{len(comparison.changes):,} buildings, {changed:,} changed: {words or 'none'}",
        f"the new epoch lies {shift.east:+.2f} m east, {shift.north:+.2f} m north, {shift.up:+.2f} m up of "
        f"the old one ({shift.pairs:,} pairs, noise {shift.noise:.2f} m) and was moved back; surfaces within "
        f"{comparison.tolerance:.2f} m are the same",
    ]
    return "\n".join(lines)
