"""The detector calibrated on half of a survey, scored on the other.

`python -m benchmarks.accuracy.calibration`. The verdicts are what a user with the reference at hand would say
of the western half: of each building that was detected whether it is one, of each that was missed that it is.
The eastern half is built with the shipped and with the calibrated weights, and held against the reference.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from shapely import Polygon

from eaves.change.edits import IS_BUILDING, NO_BUILDING, Edit, write_edits
from eaves.change.upkeep.calibrate import Calibrated, calibrate
from eaves.change.upkeep.kept import open_kept
from eaves.cli.runs import read_config
from eaves.formats import read_polygons
from eaves.model.cloud import BUILDING
from eaves.pipeline import build
from eaves.recipe.recipe import make_recipe

CELL_M = 1.0
"""Cells in which points of the reference are grouped into buildings."""
SMALLEST_M2 = 10.0
"""Smaller groups of class 6 are no buildings."""
HALF = 0.5
"""Share of the points in an outline that are building: it is one."""


@dataclass(frozen=True, eq=False)
class Reference:
    """Points (N, 2) of a survey over the ground, and which are building (N,)."""

    xy: NDArray[np.float64]
    building: NDArray[np.bool_]
    middle: float

    @classmethod
    def read(cls, paths: list[Path]) -> Reference:
        """Of classified files: class 6 against 3, 4, 5 and 1."""
        some, truth = [], []
        for path in paths:
            las = laspy.read(path)
            classes = np.asarray(las.classification)
            use = np.isin(classes, (1, 3, 4, 5, BUILDING))
            some.append(np.column_stack([las.x, las.y])[use])
            truth.append(classes[use] == BUILDING)
        xy = np.concatenate(some)
        return cls(xy, np.concatenate(truth), float(np.median(xy[:, 0])))

    def share(self, outline: Polygon) -> float:
        """Share of the points in an outline that are building."""
        west, south, east, north = outline.bounds
        x, y = self.xy.T
        near = np.flatnonzero((x >= west) & (x <= east) & (y >= south) & (y <= north))
        near = near[shapely.contains_xy(outline, self.xy[near])]
        return float(self.building[near].mean()) if len(near) else 0.0

    def groups(self) -> Iterator[Polygon]:
        """The hulls of its buildings."""
        mine = self.xy[self.building]
        place = np.floor(mine / CELL_M).astype(np.int64)
        first = place.min(axis=0)
        grid = np.zeros(tuple(np.ptp(place, axis=0) + 1), bool)
        grid[tuple((place - first).T)] = True
        closed = ndimage.binary_closing(np.pad(grid, 2), np.ones((3, 3)))[2:-2, 2:-2] | grid
        label, count = ndimage.label(closed, np.ones((3, 3)))
        for number, box in enumerate(ndimage.find_objects(label), 1):
            rows, columns = np.nonzero(label[box] == number)
            if len(rows) * CELL_M**2 >= SMALLEST_M2:
                corner = (np.column_stack([rows + box[0].start, columns + box[1].start]) + first) * CELL_M
                cells = shapely.box(*corner.T, *(corner + CELL_M).T)
                yield shapely.union_all(cells).convex_hull
        assert count


@dataclass(frozen=True)
class Score:
    """Buildings found of those there are, and of those detected which are buildings."""

    there: int
    found: int
    detected: int
    right: int

    @property
    def told(self) -> str:
        """Completeness, correctness, and their harmonic mean."""
        complete, correct = self.found / max(self.there, 1), self.right / max(self.detected, 1)
        both = 2 * complete * correct / max(complete + correct, 1e-9)
        return f"{complete:.3f}, {correct:.3f}, {both:.3f}"


def outlines_of(out: Path) -> list[Polygon]:
    """The footprints of a run."""
    return read_polygons(out / "footprints.gpkg", "footprints")[0]


def is_here(outline: Polygon, reference: Reference, west: bool) -> bool:
    """Whether an outline lies in a half."""
    return (outline.centroid.x < reference.middle) == west


def score(out: Path, reference: Reference, west: bool = False) -> Score:
    """A run against the reference in one half."""
    mine = [one for one in outlines_of(out) if is_here(one, reference, west)]
    there = [one for one in reference.groups() if is_here(one, reference, west)]
    tree = shapely.STRtree(mine)
    found = sum(
        sum(shapely.intersection(one, mine[k]).area for k in tree.query(one)) >= HALF * HALF * one.area
        for one in there
    )
    right = sum(reference.share(one) >= HALF for one in mine)
    return Score(len(there), found, len(mine), right)


def verdicts(out: Path, reference: Reference, west: bool = True) -> list[Edit]:
    """What a user with the reference says of one half."""
    polygons, _, rows, _ = read_polygons(out / "footprints.gpkg", "footprints")
    edits = []
    for outline, row in zip(polygons, rows, strict=True):
        if is_here(outline, reference, west):
            verdict = IS_BUILDING if reference.share(outline) >= HALF else NO_BUILDING
            edits.append(Edit(verdict, outline, str(row["id"])))
    tree = shapely.STRtree(polygons)
    for one in reference.groups():
        if is_here(one, reference, west) and not len(tree.query(one, predicate="intersects")):
            edits.append(Edit(IS_BUILDING, one))
    return edits


def judge_survey(paths: list[Path], place: Path) -> tuple[Calibrated, Score, Score | None]:
    """The calibration on the western half; the eastern one with the shipped and the calibrated weights."""
    reference, inputs = Reference.read(paths), [str(path) for path in paths]
    options: dict[str, Any] = {"lod": "0", "outputs": ("footprints",)}
    build(inputs, place / "shipped", keep=True, **options)
    edits = verdicts(place / "shipped", reference)
    write_edits(place / "verdicts.gpkg", edits, open_kept(place / "shipped").index.system)
    done = calibrate(place / "shipped", place / "verdicts.gpkg")
    before = score(place / "shipped", reference)
    if done.weights is None:
        return done, before, None
    build(inputs, place / "calibrated", make_recipe(read_config(done.path), lod="0"), outputs=("footprints",))
    return done, before, score(place / "calibrated", reference)


def surveys(data: Path, place: Path) -> Iterator[tuple[str, Callable[[], list[Path]]]]:
    """Name and files of each survey."""
    yield "Delft", lambda: [data / "delft" / "ahn3.laz"]
    yield "ign_urban", lambda: sorted((data / "ign_urban").glob("*.la[sz]"))
    yield "ign_sparse", lambda: sorted((data / "ign_sparse").glob("*.la[sz]"))


def main() -> None:
    """Print a row a survey."""
    print(
        "| survey | verdicts | left out one by one | shipped: completeness, correctness, F1 | calibrated |\n"
        "|---|---|---|---|---|"
    )
    with tempfile.TemporaryDirectory() as folder:
        for name, files in surveys(Path(os.environ["EAVES_DATA"]), Path(folder)):
            done, before, after = judge_survey(files(), Path(folder) / name)
            told = "too few" if done.detector is None else done.detector.words
            verdict = f"{done.buildings} and {done.others}"
            end = "shipped weights stay" if after is None else after.words
            print(f"| {name} | {verdict} | {told} | {before.words} | {end} |", flush=True)


if __name__ == "__main__":
    main()
