"""The twenty worst outlines of all data sets, and Delft's addresses: docs/gallery/outline-*.png.

Run `EAVES_DATA=... python -m benchmarks.gallery.outline`.
"""

from __future__ import annotations

import os
from pathlib import Path

import laspy
import matplotlib.pyplot as plt
import numpy as np
import pyogrio
import shapely
from matplotlib.axes import Axes
from shapely.geometry.base import BaseGeometry

from benchmarks.accuracy.outline import METHODS
from benchmarks.accuracy.outline_detected import MAP_OFF_M, delft_detected, drawn_together
from benchmarks.gallery.outline_cases import Case, outline_cases
from benchmarks.gallery.roof import FOLDER, palette, save
from eaves.footprints.given import repair_footprints
from eaves.footprints.party_walls import split_block
from eaves.footprints.snap import snap_footprints
from eaves.geometry.neighbours import measure_spacing
from eaves.methods import make_method
from eaves.model import Footprint
from eaves.outline import OutlineMethod

SHEETS = {"towns": {"town": 5, "found": 5}, "real": {"building3d": 4, "delft": 4, "ign": 2}}
"""How many outlines of which data each sheet shows; `found` are towns with nothing but points given."""
COLUMNS = 5
TRUTH, OURS = "#e00000", "#000000"
HALF_M = 25.0
"""Half the width of the part of Delft in which snapping is shown."""


def draw_rings(axes: Axes, shape: BaseGeometry, color: str, linewidth: float) -> None:
    """All rings of the polygons of a shape."""
    for ring in shapely.get_rings(shapely.get_parts(shape)):
        axes.plot(*np.asarray(ring.coords)[:, :2].T, color=color, linewidth=linewidth)


def draw_case(axes: Axes, title: str, case: Case) -> None:
    """Points around grey, of the building by height; the truth red, ours black."""
    size = float(np.clip(2500.0 / max(len(case.points), 1), 0.3, 6.0))
    axes.scatter(case.around[:, 0], case.around[:, 1], c="#c8c8c8", s=0.6 * size, linewidths=0)
    axes.scatter(case.points[:, 0], case.points[:, 1], c=case.points[:, 2], s=size, linewidths=0)
    draw_rings(axes, case.truth, color=TRUTH, linewidth=1.4)
    draw_rings(axes, case.found, color=OURS, linewidth=1.0)
    west, south, east, north = case.truth.union(case.found).buffer(2.0).bounds
    axes.set(xlim=(west, east), ylim=(south, north), aspect="equal")
    axes.set_title(
        f"{title}  {case.data} {case.name}\nIoU {case.iou:.2f}, {east - west:.0f} m", size=7, pad=2
    )


def worst_of(cases: list[Case], count: int) -> list[Case]:
    """The cases of least IoU, each outline once."""
    worst: list[Case] = []
    for case in sorted(cases, key=lambda one: one.iou):
        if len(worst) < count and all(case.found.is_empty or case.found != one.found for one in worst):
            worst.append(case)
    return worst


def draw_sheet(name: str, cases: list[Case], letter: str) -> None:
    """One sheet of cases, numbered."""
    lines = -(-len(cases) // COLUMNS)
    figure, grid = plt.subplots(lines, COLUMNS, figsize=(11.0, 2.5 * lines), squeeze=False)
    for axes in grid.ravel():
        axes.axis("off")
    for number, (axes, case) in enumerate(zip(grid.ravel(), cases, strict=False), 1):
        draw_case(axes, f"{letter}{number}", case)
        print(f"{letter}{number}: {case.data} {case.name}, IoU {case.iou:.3f}, {case.truth.area:.0f} m²")
    figure.tight_layout(pad=0.4)
    save(figure, FOLDER / f"outline-{name}.png")


def draw_delft(data: Path) -> None:
    """Delft's detected blocks split into the map's addresses, and the map moved off and snapped back."""
    method = make_method("outline", METHODS[-1])
    assert isinstance(method, OutlineMethod)
    groups, spacing, corner = delft_detected(data)
    blocks = drawn_together(groups, spacing, method)
    shapes = shapely.from_wkb(pyogrio.raw.read(data / "delft/footprints.gpkg")[2])
    whole = shapely.transform(shapely.make_valid(shapes), lambda xy: xy - corner)
    given = repair_footprints(list(whole))
    west, south, east, north = shapely.total_bounds(whole)
    figure, (left, right) = plt.subplots(1, 2, figsize=(11.0, 5.2))
    parts: list[Footprint] = []
    for block in blocks:
        near = [one for one in given if one.polygon.intersects(block)]
        found, rest = split_block(block, near)
        parts += [one for one in found if one is not None] + [Footprint(one) for one in rest]
    for part, colour in zip(parts, palette(len(parts)), strict=True):
        outer = np.asarray(part.polygon.exterior.coords)[:, :2]
        left.fill(*outer.T, color=0.5 + 0.5 * colour[:3], linewidth=0)
        draw_rings(left, part.polygon, color=OURS, linewidth=0.6)
    draw_rings(left, shapely.union_all(blocks), color=OURS, linewidth=1.4)
    left.set(xlim=(west - 5, east + 5), ylim=(south - 5, north + 5))
    told = f"{len(blocks)} blocks split into {len(parts)} buildings by {len(given)} addresses"
    left.set_title(told, size=8)
    cloud = laspy.read(data / "delft/ahn3.laz")
    roofs = np.asarray(cloud.xyz)[np.asarray(cloud.classification) == 6] - np.append(corner, 0.0)
    moved = [one.with_(polygon=shapely.transform(one.polygon, lambda xy: xy + MAP_OFF_M)) for one in given]
    snapped = snap_footprints(moved, roofs, measure_spacing(roofs))
    right.scatter(roofs[:, 0], roofs[:, 1], c="#a8c4dc", s=1.5, linewidths=0)
    for before, after in zip(moved, snapped, strict=True):
        draw_rings(right, before.polygon, color=TRUTH, linewidth=0.8)
        draw_rings(right, after.polygon, color=OURS, linewidth=1.2)
    x, y = 0.5 * (west + east), 0.5 * (south + north)
    right.set(xlim=(x - HALF_M, x + HALF_M), ylim=(y - HALF_M, y + HALF_M))
    right.set_title(f"red: the map moved by {np.hypot(*MAP_OFF_M):.1f} m; black: snapped to class 6", size=8)
    for axes in (left, right):
        axes.set_aspect("equal")
        axes.axis("off")
    figure.tight_layout(pad=0.4)
    save(figure, FOLDER / "outline-delft.png")


def main() -> None:
    """Draw all outlines' worst, print what is drawn, and the mean of each data set."""
    folder = os.environ.get("EAVES_DATA")
    if folder is None:
        print("EAVES_DATA is not set: there are no outlines to draw")
        return
    found: dict[str, list[Case]] = {}
    for case in outline_cases(Path(folder)):
        found.setdefault(case.data.split()[0], []).append(case)
    for (name, wanted), letter in zip(SHEETS.items(), "TR", strict=True):
        worst = [case for data, count in wanted.items() for case in worst_of(found[data], count)]
        draw_sheet(name, worst, letter)
    for data, cases in found.items():
        iou = np.array([case.iou for case in cases])
        told = f"median IoU {np.median(iou):.3f}, {np.mean(iou < 0.9):.1%} under 0.9"
        print(f"{data}: {len(cases)} outlines, {told}")
    draw_delft(Path(folder))


if __name__ == "__main__":
    main()
