"""Detection on surveys that chose nothing: every labelled survey, every transformation, by the command.

Run `EAVES_DATA=... python -m benchmarks.accuracy.unseen [--rows TEXT...] [--columns TEXT...]`.
Each cell of the table is one run of `eaves detect` on a bare file, in blocks. The default is shown twice:
with the weights fitted to everything, and with those fitted with the row's place and its variants left out
(`benchmarks.accuracy.detection_fit` makes both). What was run is kept in EAVES_CACHE (default:
~/.cache/eaves/unseen) and not run again while the code that decides it is the same. Cells that are not run
are taken from the newest table.
"""

from __future__ import annotations

import argparse
import functools
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
import pyogrio
from scipy.spatial import cKDTree

from benchmarks.accuracy.detection import CELL, TOWNS, TownScan, rates, scan_of
from benchmarks.survey_variants import (
    PLACES,
    VARIANTS,
    Survey,
    applies,
    judged,
    labelled_surveys,
    survey_of,
)
from benchmarks.table import keep, kept_rows
from eaves.model import Mask
from eaves.model.cloud import BUILDING

COMMAND = "python -m benchmarks.accuracy.unseen"
PUBLISHED = ("planar_patches", "normal_echo", "contours", "roof_attributes", "height_texture")
ALL_IN, LEFT_OUT = "consensus, all in", "consensus, left out"
COLUMNS = (*PUBLISHED, ALL_IN, LEFT_OUT)
WEIGHTS = Path(__file__).with_name("detection_weights.json")
SOURCES = Path(__file__).parents[2] / "src/eaves"
NOT_RUN = "–"
SAME_POINT_M = 0.02
"""Points of the result are those of the survey up to the rounding of the file."""


@dataclass(frozen=True)
class Figures:
    """How one run agrees with the truth: by cells of 0.5 m and by points; how many buildings it found."""

    iou: float
    precision: float
    recall: float
    buildings: int
    true_points: int
    false_points: int


@functools.cache
def code_of(method: str) -> str:
    """A hash of the sources that decide a method's result."""
    digest = hashlib.sha256()
    for folder in ("ground", "detect", "raster", "geometry"):
        for path in sorted((SOURCES / folder).rglob("*.py")):
            if method in PUBLISHED and "consensus" in path.parts:
                continue
            digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def weights_of(place: str, folder: Path) -> Path:
    """A configuration that takes the weights fitted without a place."""
    kept = json.loads(WEIGHTS.read_text(encoding="utf-8"))
    weights, config = folder / "weights.json", folder / "config.toml"
    weights.write_text(json.dumps(kept.get(place, kept["all"])), encoding="utf-8")
    config.write_text(f'[detect]\nmethod = "consensus"\nweights = "{weights}"\n', encoding="utf-8")
    return config


def run(survey: Survey, column: str, place: str) -> Figures:
    """One run of the command on the bare file of a survey."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bare, out = folder / "bare.laz", folder / "out"
        survey.write(bare)
        words = ["--method", column] if column in PUBLISHED else []
        if column == LEFT_OUT:
            words = ["--config", str(weights_of(place, folder))]
        command = [sys.executable, "-m", "eaves", "detect", str(bare), "-o", str(out), "--jobs", "1", "-q"]
        subprocess.run([*command, *words], check=True)
        found = laspy.read(next(out.glob("classified*.la[sz]")))
        buildings = len(
            pyogrio.read_dataframe(out / "footprints.gpkg", layer="footprints", read_geometry=False)
        )
        xyz = np.column_stack([found.x, found.y, np.asarray(found.z) * survey.height_unit])
        called = np.asarray(found.classification) == BUILDING
    near = cKDTree(xyz).query(survey.xyz, distance_upper_bound=SAME_POINT_M)[1]
    got = np.r_[called, False][np.asarray(near)]
    keep_ = judged(survey)
    return compared(survey.xyz[keep_], got[keep_], survey.truth[keep_] == BUILDING, buildings)


def compared(xyz: np.ndarray, got: Mask, want: Mask, buildings: int) -> Figures:
    """Agreement of two masks over the same points (N, 3)."""
    cell = np.floor(xyz[:, :2] / CELL).astype(np.int64)
    order = np.lexsort((xyz[:, 2], cell[:, 0], cell[:, 1]))
    top = order[np.r_[(np.diff(cell[order], axis=0) != 0).any(axis=1), True]]
    _, _, iou = rates(got[top], want[top])
    recall, precision, _ = rates(got, want)
    return Figures(iou, precision, recall, buildings, int(want.sum()), int((got & ~want).sum()))


def figures(survey: Survey, name: str, variant: str, column: str, cache: Path, kept: bool) -> Figures | None:
    """The figures of a run, from the cache where it was made before; None where `kept` forbids to make it."""
    place = PLACES.get(name, name)
    fitted = json.loads(WEIGHTS.read_text(encoding="utf-8"))
    weights = fitted.get(place, fitted["all"]) if column == LEFT_OUT else None
    key = hashlib.sha256(f"{name}/{variant}/{column}/{code_of(column)}/{weights}".encode()).hexdigest()[:16]
    path = cache / f"{key}.json"
    if not path.exists():
        if kept:
            return None
        answer = run(VARIANTS[variant](survey), column, place)
        record = {"row": f"{name}, {variant}", "column": column, **answer.__dict__}
        path.write_text(json.dumps(record), encoding="utf-8")
    record = json.loads(path.read_text(encoding="utf-8"))
    return Figures(*(record[field] for field in Figures.__dataclass_fields__))


def wanted(text: str, words: Sequence[str] | None) -> bool:
    """Whether a name holds one of the words; without words, always."""
    return not words or any(word in text for word in words)


def main() -> None:
    """Print and keep the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--rows", nargs="+", metavar="TEXT", help="rows that hold one of these")
    options.add_argument("--columns", nargs="+", metavar="TEXT", help="columns that hold one of these")
    options.add_argument("--kept", action="store_true", help="show what was run before, and run nothing")
    chosen = options.parse_args()
    cache = Path(os.environ.get("EAVES_CACHE", str(Path.home() / ".cache/eaves"))) / "unseen"
    cache.mkdir(parents=True, exist_ok=True)
    columns = [column for column in COLUMNS if wanted(column, chosen.columns)]
    before = {(row["survey"], row["variant"]): row for row in kept_rows("unseen")}
    table: list[dict[str, object]] = []
    for name, read in surveys(Path(os.environ["EAVES_DATA"])).items():
        variants = [variant for variant in VARIANTS if wanted(f"{name}, {variant}", chosen.rows)]
        survey = read() if variants else None
        for variant in VARIANTS:
            row = dict.fromkeys(COLUMNS, NOT_RUN) | {
                column: str(cell) for column, cell in before.get((name, variant), {}).items()
            }
            if survey is not None and variant in variants and applies(variant, survey):
                for column in columns:
                    answer = figures(survey, name, variant, column, cache, chosen.kept)
                    row[column] = row[column] if answer is None else shown(answer)
                print(name, variant, *(f"{column}: {row[column]}" for column in columns), flush=True)
            if any(row[column] != NOT_RUN for column in COLUMNS):
                cells = {column: row[column] for column in COLUMNS}
                table.append({"survey": name, "variant": variant, **cells, **verdict(cells)})
    keep("unseen", "Detection on surveys left out, by the command", table, COMMAND, NOTE)


def surveys(data: Path) -> dict[str, Callable[[], Survey]]:
    """Every labelled survey, and the towns that `benchmarks.accuracy.detection` shows, by name."""

    def town(scan: TownScan) -> Callable[[], Survey]:
        return lambda: survey_of(scan.name, scan_of(scan))

    return labelled_surveys(data) | {f"town, {scan.name}": town(scan) for scan in TOWNS}


def shown(found: Figures) -> str:
    """IoU with precision and recall of points; where no building stands, or none is known, how many were
    found, and how many of their points are known to be none."""
    if not found.true_points:
        return f"{found.buildings} found, {found.false_points} points"
    return f"{found.iou:.3f} ({found.precision:.2f}, {found.recall:.2f})"


def verdict(cells: Mapping[str, str]) -> dict[str, str]:
    """How far the left-out default is ahead of the best published method, and behind the all-in one."""
    iou = {column: float(cell.split()[0]) for column, cell in cells.items() if "(" in cell}
    default, all_in = iou.get(LEFT_OUT), iou.get(ALL_IN)
    singles = [iou[column] for column in PUBLISHED if column in iou]
    ahead = gap = NOT_RUN
    if default is not None and len(singles) == len(PUBLISHED):
        ahead = f"{default - max(singles):+.3f}"
    if default is not None and all_in is not None:
        gap = f"{all_in - default:+.3f}"
    return {"ahead of the best": ahead, "all in less left out": gap}


NOTE = """IoU by cells of 0.5 m against class 6, a cell being its highest point; in brackets precision and
recall by points. `found`: where no building stands, or only the ground is known (california), how many were
found, and how many of their points are known to be none. Left out: the weights of `consensus` were fitted
without the row's place and all its variants; california and the towns fitted none, so both columns are
left out there. The other constants of all methods are the same in all columns.
Ahead of the best: IoU of the left-out default less that of the best of the five published methods with
derived defaults, where all were run. Each is one run of `eaves detect` on a bare file in blocks of 240 m.
–: not run, or no other survey than the whole one."""


if __name__ == "__main__":
    main()
