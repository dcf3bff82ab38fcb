"""Sheets for the eye: outlines and roofs of a run at random, the least trusted, or where two runs differ.

Run `python -m benchmarks.gallery.sheets OUT SHEET.png` or, for the differences, `... OUT SHEET.png OTHER`.
OUT is what `eaves build` wrote, with footprints and classified points; OTHER is another run, or a map in a
vector file. Ground is beige, roof points are coloured by height, all else is green; outlines are black, roof
faces thin, outlines of the other red.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import laspy
import matplotlib.pyplot as plt
import numpy as np
import pyogrio
import shapely
from matplotlib.axes import Axes
from numpy.typing import NDArray

from benchmarks.gallery.solids import save_small

COUNT, COLUMNS, SEED = 20, 5, 0
ROUND = 1.3
"""A place is shown with so many times the reach of its building, and five units more."""


@dataclass(frozen=True, eq=False)
class Run:
    """Outlines, trust and roof faces of a run, and its points (N, 3) with their classes (N,), sorted by x."""

    shapes: NDArray[np.object_]
    words: list[str]
    worth: NDArray[np.float64]
    faces: NDArray[np.object_]
    xyz: NDArray[np.float64]
    classes: NDArray[np.uint8]

    @classmethod
    def of(cls, folder: Path) -> Run:
        """What a folder holds."""
        path = folder / "footprints.gpkg"
        _, _, shapes, (ids, trust, worth) = pyogrio.raw.read(
            path, layer="footprints", columns=["id", "trust", "trust_score"]
        )
        _, _, faces, _ = pyogrio.raw.read(path, layer="roof_planes", columns=[])
        there = np.array([shape is not None for shape in shapes], bool)
        xyz, classes = [], []
        for one in sorted(folder.glob("classified*.laz")):
            las = laspy.read(one)
            xyz.append(np.column_stack([las.x, las.y, las.z]))
            classes.append(np.asarray(las.classification))
        points, kinds = np.concatenate(xyz), np.concatenate(classes)
        order = np.argsort(points[:, 0], kind="stable")
        words = [f"{name} {kind}" for name, kind in zip(ids[there], trust[there], strict=True)]
        return cls(
            shapely.from_wkb(shapes[there]),
            words,
            worth[there].astype(float),
            shapely.force_2d(shapely.from_wkb(faces)),
            points[order],
            kinds[order],
        )


def shapes_in(path: Path) -> NDArray[np.object_]:
    """The outlines of another run, or of a map."""
    layer = "footprints" if path.is_dir() else None
    _, _, shapes, _ = pyogrio.raw.read(path / "footprints.gpkg" if layer else path, layer=layer, columns=[])
    return np.asarray(shapely.make_valid(shapely.force_2d(shapely.from_wkb(shapes))))


def draw_place(
    axes: Axes, run: Run, where: shapely.Geometry, words: str, others: NDArray[np.object_] | None
) -> None:
    """One place of a run, with the outlines of another."""
    west, south, east, north = where.bounds
    half = 0.5 * ROUND * max(east - west, north - south) + 5.0
    x, y = 0.5 * (west + east), 0.5 * (south + north)
    box = shapely.box(x - half, y - half, x + half, y + half)
    near = slice(*np.searchsorted(run.xyz[:, 0], [x - half, x + half]))
    inside = np.abs(run.xyz[near, 1] - y) < half
    xyz, kind = run.xyz[near][inside], run.classes[near][inside]
    size = float(np.clip(9000.0 / max(len(xyz), 1), 0.6, 14.0))
    for mine, colour in ((kind == 2, "#d8d2c8"), ((kind != 2) & (kind != 6), "#7ab87a")):
        axes.scatter(*xyz[mine, :2].T, s=size, c=colour, linewidths=0)
    axes.scatter(*xyz[kind == 6, :2].T, s=size, c=xyz[kind == 6, 2], cmap="plasma", linewidths=0)
    drawn = [(run.faces, "#404040", 0.5), (run.shapes, "#000000", 1.6)]
    drawn += [] if others is None else [(others, "#d00000", 0.9)]
    for shapes, colour, width in drawn:
        for ring in shapely.get_rings(shapely.get_parts(shapes[shapely.intersects(shapes, box)])):
            axes.plot(*shapely.get_coordinates(ring).T, color=colour, linewidth=width)
    axes.set(xlim=(x - half, x + half), ylim=(y - half, y + half), aspect="equal")
    axes.set_title(words, size=7)


def places_of(run: Run, others: NDArray[np.object_] | None) -> list[tuple[shapely.Geometry, str]]:
    """The places to look at: buildings at random and the least trusted, or where two runs differ most."""
    if others is not None:
        both = shapely.union_all(run.shapes), shapely.union_all(others)
        parts = shapely.get_parts(shapely.symmetric_difference(*both))
        parts = parts[shapely.area(parts) > 1.0]
        largest = parts[np.argsort(-shapely.area(parts), kind="stable")][: 2 * COUNT]
        return [(part, f"{part.area:.0f}") for part in largest]
    some = np.random.default_rng(SEED).permutation(len(run.shapes))[:COUNT]
    worst = np.argsort(run.worth, kind="stable")[:COUNT]
    return [(run.shapes[k], run.words[k]) for k in (*some, *worst)]


def draw_sheet(folder: Path, picture: Path, other: Path | None = None) -> None:
    """The sheet of a run."""
    run, others = Run.of(folder), None if other is None else shapes_in(other)
    places: Sequence[tuple[shapely.Geometry, str]] = places_of(run, others)
    lines = max(-(-len(places) // COLUMNS), 1)
    figure, grid = plt.subplots(lines, COLUMNS, figsize=(13.0, 2.7 * lines), squeeze=False)
    for axes in grid.ravel():
        axes.axis("off")
    for axes, (where, words) in zip(grid.ravel(), places, strict=False):
        draw_place(axes, run, where, words, others)
    figure.tight_layout(pad=0.4)
    save_small(figure, picture, colours=40)


if __name__ == "__main__":
    draw_sheet(*map(Path, sys.argv[1:]))
