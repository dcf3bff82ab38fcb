"""What a quarter more or less of each parameter of the published systems changes.

Run `EAVES_DATA=... python -m benchmarks.accuracy.sources_tuning [--chains NAME...]`.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy.detection import top_of_cells
from benchmarks.accuracy.sources import SETS, pieces_of, reference_points
from benchmarks.table import keep, kept_rows
from eaves.evaluate.detection_scores import burn_labels
from eaves.evaluate.models import evaluate_models, read_buildings
from eaves.formats import write_cityjson_seq
from eaves.methods import Method, method_class
from eaves.model import BuildingModel, Raster
from eaves.pipeline import model_buildings
from eaves.recipe.recipe import PublishedSource, make_recipe, sources

COMMAND = "python -m benchmarks.accuracy.sources_tuning"
SET = "amsterdam, blind"
"""A scan that chose no parameter, small enough for hundreds of runs."""
QUARTER = 0.25
RMSE = "RMSE m, less / more"
Row = dict[str, Any]
Figures = tuple[float, float, int]


def parameters_of(source: PublishedSource) -> Iterator[tuple[str, str, float]]:
    """Stage, name and value of every number of the methods of a source; the ground filter of three of them
    is varied with the first of these, `chen_sun`."""
    for stage, name in source.methods.items():
        if name != "adaptive_tin" or source.name == "chen_sun":
            yield from numbers_of(stage, "", method_class(stage, name)())


def numbers_of(stage: str, prefix: str, method: Method) -> Iterator[tuple[str, str, float]]:
    """Stage, name and value of every number of a method and of the methods that are its parameters."""
    for name in type(method).model_fields:
        value = getattr(method, name)
        if isinstance(value, Method):
            yield from numbers_of(stage, f"{prefix}{name}.", value)
        elif isinstance(value, int | float) and not isinstance(value, bool) and value:
            yield stage, prefix + name, value


def table_of(name: str, value: float) -> Mapping[str, Any]:
    """A parameter, of a nested method too, as the table of a stage."""
    table: Any = value
    for part in reversed(name.split(".")):
        table = {part: table}
    return dict(table)


class Reference:
    """Roof points of class 6 and what they cover: a set is read once."""

    def __init__(self, data: Path) -> None:
        self.paths = [str(path) for pattern in SETS[SET] for path in sorted(data.glob(pattern))]
        xyz, want = reference_points(data, SET)
        self.roof = xyz[want]
        self.plans = {str(k): piece for k, piece in enumerate(pieces_of(self.roof))}
        west, south = np.floor(xyz[:, :2].min(axis=0))
        cell = np.floor((xyz[:, :2] - [west, south]) / 0.5).astype(np.int64)
        top = top_of_cells(xyz)
        self.shape = tuple((cell.max(axis=0) + 1)[::-1])
        self.row, self.column = self.shape[0] - 1 - cell[top, 1], cell[top, 0]
        self.true: NDArray[np.bool_] = want[top]
        self.corner = west, south + 0.5 * self.shape[0]

    def figures(self, source: str, stage: str = "", table: Mapping[str, Any] | None = None) -> Figures:
        """IoU of the footprints, RMSE of the models to class 6 (m, mean by building) and their number."""
        recipe = make_recipe({stage: dict(table)} if table else None, source=source)
        models, system, origin = model_buildings(self.paths, recipe, jobs=1)
        found = [one for one in models if isinstance(one, BuildingModel)]
        raster = Raster(np.zeros(self.shape, np.float32), *self.corner, 0.5)
        got = burn_labels([one.footprint.world for one in found], raster)[self.row, self.column] > 0
        iou = float((got & self.true).sum() / (got | self.true).sum())
        if sources()[source].lod == "0":
            return iou, np.nan, len(found)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "buildings.city.jsonl"
            write_cityjson_seq(path, found, system, provenance=origin)
            score = evaluate_models(read_buildings(path), self.roof, self.plans)
        return iou, score.rmse_mean_m, len(found)


def rows_of(source: PublishedSource, reference: Reference) -> Iterator[Row]:
    """A row a parameter: figures with a quarter less and more, and the largest change from the default."""
    plain = reference.figures(source.name)
    yield row_of(source, "", "none", "", [plain, plain], plain)
    for stage, name, value in parameters_of(source):
        tried, values = [], []
        for share in (1.0 - QUARTER, 1.0 + QUARTER):
            changed = value * share
            if isinstance(value, int):
                changed = (
                    max(round(changed), 1) if round(changed) != value else value + (1 if share > 1 else -1)
                )
            try:
                tried.append(reference.figures(source.name, stage, table_of(name, changed)))
                values.append(f"{changed:.4g}")
            except ValueError:  # out of the range of the parameter
                tried.append(plain)
                values.append("–")
        yield row_of(source, stage, name, " / ".join([f"{value:.4g}", *values]), tried, plain)


def row_of(
    source: PublishedSource, stage: str, name: str, values: str, tried: list[Figures], plain: Figures
) -> Row:
    """A row of the table."""
    ious, errors, counts = zip(*tried, strict=True)
    row: Row = {"source": source.name, "stage": stage, "parameter": name, "value / less / more": values}
    row |= {"IoU, less / more": " / ".join(f"{one:.4f}" for one in ious)}
    row |= {"largest change of IoU": float(max(abs(one - plain[0]) for one in ious))}
    models = sources()[source.name].lod > "0"
    row |= {RMSE: " / ".join(f"{one:.3f}" for one in errors) if models else None}
    row |= {"largest change of RMSE m": float(max(abs(one - plain[1]) for one in errors)) if models else None}
    return row | {"buildings": " / ".join(map(str, counts))}


def summary_of(name: str, rows: list[Row]) -> Row:
    """The row of all numbers of a source: how many they are, their median and largest change."""
    varied = [row for row in rows if row["source"] == name and row["stage"] not in ("", "all")]
    count = f"{len(varied)} numbers"
    row: Row = {"source": name, "stage": "all", "parameter": count, "value / less / more": "median / largest"}
    for column, unit in (
        ("IoU, less / more", "largest change of IoU"),
        (RMSE, f"largest change of {RMSE[:6]}"),
    ):
        known = [float(one[unit]) for one in varied if one[unit] not in (None, "–")]
        row[column] = f"{np.median(known):.4f} / {max(known):.4f}" if known else None
        row[unit] = max(known) if known else None
    return row | {"buildings": None}


def main() -> None:
    """Print and keep the table; rows of chains that are not run are those of the newest one."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--chains", nargs="+", choices=sources(), default=list(sources()), metavar="NAME")
    chosen = options.parse_args()
    reference = Reference(Path(os.environ["EAVES_DATA"]))
    rows: list[Row] = []
    for name in sources():
        if name in chosen.chains:
            for row in rows_of(sources()[name], reference):
                print(row, flush=True)
                rows.append(row)
        else:
            rows += [row for row in kept_rows("sources-tuning") if row["source"] == name]
    rows = [row for row in rows if row["stage"] != "all"]
    rows = [summary_of(name, rows) for name in sources() if name in {row["source"] for row in rows}] + rows
    keep("sources-tuning", "Tuning", rows, COMMAND, NOTE)


NOTE = """Each number of the methods of a source, as derived, a quarter less and more, all else as it is:
mask IoU of the footprints against class 6, RMSE of roof points of class 6 to the models, mean by building,
on a scan that chose none of them. Parameters that are derived from spacing and noise have no number to
vary."""


if __name__ == "__main__":
    main()
