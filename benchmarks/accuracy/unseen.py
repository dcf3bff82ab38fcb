"""Detection on surveys that chose nothing: every labelled survey, every transformation, by the command.

Run `EAVES_DATA=... python -m benchmarks.accuracy.unseen [--rows TEXT...] [--columns TEXT...]`.
Each cell of the table is what `eaves detect` finds in a bare file, in blocks. The default is shown twice:
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
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.accuracy.detection import TOWNS, TownScan, rates, scan_of, top_of_cells
from benchmarks.survey_variants import PLACES, VARIANTS, Survey, applies, judged, labelled_surveys, survey_of
from benchmarks.table import commit_now, keep, kept_rows
from eaves.flow.region import open_region
from eaves.flow.run import no_progress, open_run
from eaves.flow.step import REGIONS
from eaves.model import Mask
from eaves.model.cloud import BUILDING
from eaves.pipeline import find_plans
from eaves.recipe.recipe import Recipe, make_recipe
from eaves.run.workers import Workers

COMMAND = "python -m benchmarks.accuracy.unseen"
PUBLISHED = ("planar_patches", "normal_echo", "contours", "roof_attributes", "height_texture")
ALL_IN, LEFT_OUT = "consensus, all in", "consensus, left out"
COLUMNS = (*PUBLISHED, ALL_IN, LEFT_OUT)
COMMIT = "commit"
SHOWN = (*COLUMNS, "ahead of the best", "all in less left out", COMMIT)
DECIDING = ("ground", "detect", "surroundings", "raster", "geometry", "blocks")
"""Folders whose sources decide what is found."""
WEIGHTS = Path(__file__).with_name("detection_weights.json")
SOURCES = Path(__file__).parents[2] / "src/eaves"
NOT_RUN, NO_VARIANT = "–", "none"
"""Cells that were not run; those of variants that leave the survey as it is."""


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
    """A hash of the sources that decide a method's result: not those of other methods."""
    digest = hashlib.sha256()
    ground = make_recipe({"detect": detector_of(method)}).ground.name
    others = {"adaptive_tin", "contours", "smooth_region"} - {ground}
    others |= {"consensus"} if method in PUBLISHED else set()
    paths = [path for folder in DECIDING for path in sorted((SOURCES / folder).rglob("*.py"))]
    for path in paths:
        if not others & {*path.relative_to(SOURCES).parts[1:-1], path.stem if "ground" in path.parts else ""}:
            digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def detector_of(column: str) -> str:
    """The detector that a column is about."""
    return column if column in PUBLISHED else "consensus"


def recipe_for(column: str, place: str, folder: Path) -> Recipe:
    """The recipe of `eaves detect --method`, in the last column with the weights fitted without a place."""
    if column != LEFT_OUT:
        return make_recipe({"detect": detector_of(column)}, lod="0")
    fitted, weights = json.loads(WEIGHTS.read_text(encoding="utf-8")), folder / "weights.json"
    weights.write_text(json.dumps(fitted.get(place, fitted["all"])), encoding="utf-8")
    return make_recipe({"detect": {"method": "consensus", "weights": str(weights)}}, lod="0")


def run(survey: Survey, columns: Sequence[str], place: str) -> Iterator[tuple[str, Figures]]:
    """What the command finds in the bare file of a survey, for some columns, one after the other.

    The steps are those of `eaves detect`, up to the classes of the points and the regions joined over the
    borders of blocks. The ground is found by its key for all methods that stand on the same.
    """
    known, want = judged(survey), survey.truth == BUILDING
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bare = folder / "bare.laz"
        survey.write(bare)
        for column in columns:
            recipe = recipe_for(column, place, folder)
            outputs = ("footprints", "classified")
            run = open_run(bare, folder / recipe.ground.name, recipe, outputs=outputs, resume=True)
            region = open_region(run, Workers(), no_progress)
            plans = find_plans(region)
            if region.failed:
                raise RuntimeError(region.failed[0])
            got = np.zeros(len(survey.xyz), bool)
            for block in region.blocks:
                file = REGIONS.result(region.store, block)
                got[file.points(file.candidate[file["label"] > 0])["point_id"]] = True
            found = sum(len(plan.buildings) for plan in plans)
            yield column, compared(survey.xyz[known], got[known], want[known], found)


def compared(xyz: np.ndarray, got: Mask, want: Mask, buildings: int) -> Figures:
    """Agreement of two masks over the same points (N, 3)."""
    top = top_of_cells(xyz)
    _, _, iou = rates(got[top], want[top])
    recall, precision, _ = rates(got, want)
    return Figures(iou, precision, recall, buildings, int(want.sum()), int((got & ~want).sum()))


def cell_of(name: str, variant: str, column: str, cache: Path) -> Path:
    """Where the figures of a cell of the table are kept."""
    place, fitted = PLACES.get(name, name), json.loads(WEIGHTS.read_text(encoding="utf-8"))
    weights = fitted.get(place, fitted["all"]) if column == LEFT_OUT else None
    key = hashlib.sha256(f"{name}/{variant}/{column}/{code_of(column)}/{weights}".encode()).hexdigest()
    return cache / f"{key[:16]}.json"


def kept_cell(path: Path) -> tuple[str, str] | None:
    """What the table shows of a cell, and the commit it was computed at; None where it was not."""
    if not path.exists():
        return None
    record = json.loads(path.read_text(encoding="utf-8"))
    commit = record.get("commit", NOT_RUN)
    return shown(Figures(*(record[field] for field in Figures.__dataclass_fields__))), commit


def fill_row(survey: Survey, variant: str, columns: Sequence[str], cache: Path) -> None:
    """Compute the cells of a row that are not kept."""
    name = survey.name
    todo = [column for column in columns if not cell_of(name, variant, column, cache).exists()]
    if not todo:
        return
    todo.sort(key=lambda column: detector_of(column) == "consensus")
    place, commit = PLACES.get(name, name), commit_now()
    for column, answer in run(VARIANTS[variant](survey), todo, place):
        record = {"row": f"{name}, {variant}", "column": column, "commit": commit, **answer.__dict__}
        cell_of(name, variant, column, cache).write_text(json.dumps(record), encoding="utf-8")


def wanted(text: str, words: Sequence[str] | None) -> bool:
    """Whether a name holds one of the words; without words, always."""
    return not words or any(word in text for word in words)


def main() -> None:
    """Print and keep the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--rows", nargs="+", metavar="TEXT", help="rows that hold one of these")
    options.add_argument("--columns", nargs="+", metavar="TEXT", help="columns that hold one of these")
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
            row = dict.fromkeys((*COLUMNS, COMMIT), NOT_RUN) | {
                column: str(cell) for column, cell in before.get((name, variant), {}).items()
            }
            if survey is not None and variant in variants:
                if not applies(variant, survey):
                    table.append({"survey": name, "variant": variant, **dict.fromkeys(SHOWN, NO_VARIANT)})
                    continue
                fill_row(replace(survey, name=name), variant, columns, cache)
                told = {}
                for one in columns:
                    if (cell := kept_cell(cell_of(name, variant, one, cache))) is not None:
                        told[one] = cell
                row |= {one: cell[0] for one, cell in told.items()}
                if told:
                    row[COMMIT] = ", ".join(sorted({cell[1] for cell in told.values()}))
                print(name, variant, *(f"{column}: {row[column]}" for column in columns), flush=True)
            if any(row[column] != NOT_RUN for column in COLUMNS):
                cells = {column: row[column] for column in COLUMNS}
                shown_cells = {**cells, **verdict(cells), COMMIT: row[COMMIT]}
                table.append({"survey": name, "variant": variant, **shown_cells})
    keep("unseen", "Detection on surveys left out, by the command", table, COMMAND, NOTE)


def surveys(data: Path) -> dict[str, Callable[[], Survey]]:
    """Every labelled survey, and the towns of `benchmarks.accuracy.detection`, by name."""

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
derived defaults, where all were run. Each is what `eaves detect` finds in a bare file in blocks of 240 m.
–: not run. none: the file has no strips, or no returns, that could be changed: no other survey than the whole
one. Commit: what stood when the cells of the row were measured; cells of other rows and columns are those of
the table before."""


if __name__ == "__main__":
    main()
