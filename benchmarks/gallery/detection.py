"""The worst places of the default detector on every data set, drawn, and where the reference is wrong.

Run `EAVES_DATA=... python -m benchmarks.gallery.detection`: sheets docs/gallery/detection-*.png, the places
as Markdown tables on screen, and the figures once more without the places where the reference is wrong.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pyogrio
import shapely
from matplotlib.figure import SubFigure
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage

from benchmarks.accuracy.detection import CELL, TOWNS, detect, rates, read, top_of_cells
from benchmarks.gallery.detection_reasons import REASONS, Reason
from eaves.detect.consensus import Consensus
from eaves.model import Bounds, Labels, Mask, Scene
from eaves.model.cloud import BUILDING
from eaves.simulate.scanner import scan_town
from eaves.simulate.town import simulate_town

FOLDER = Path(__file__).parents[2] / "docs" / "gallery"
LEAST_M2 = 5.0
"""Smaller places are borders that differ by a cell."""
LEAST_OBJECT_M2 = 10.0
SHOWN = 12
"""Places on a sheet."""
COLUMNS = 4
DOTS_AN_INCH, COLOURS_KEPT = 125, 32
NEAR_M = 6.0
"""A place is that of a reason when it is no farther from it."""
AROUND_M = 5.0
HIGHEST_M = 8.0
MISSED, FALSE = "missed", "false"
COLOURS = {MISSED: "#e00000", FALSE: "#ff8c00"}


@dataclass(frozen=True, eq=False)
class Case:
    """A data set with the answer: `want` and `got` say of each point whether it is of a building."""

    name: str
    scene: Scene
    want: Mask
    got: Mask
    outlines: tuple[shapely.Polygon, ...] = ()
    """What the reference draws, in world metres."""

    @property
    def xy(self) -> NDArray[np.float64]:
        return np.asarray(self.scene.cloud.xyz[:, :2] + np.array(self.scene.cloud.origin), np.float64)


@dataclass(frozen=True)
class Place:
    """Where answer and reference differ: the middle (world metres), the width (m), the area (m²)."""

    kind: str
    middle: tuple[float, float]
    width: float
    area: float

    def reason(self, name: str) -> Reason | None:
        """Why it is there, if it has been looked at."""
        away = [(np.hypot(r.x - self.middle[0], r.y - self.middle[1]), r) for r in REASONS.get(name, ())]
        near = [(distance, r) for distance, r in away if distance <= NEAR_M and r.kind == self.kind]
        return min(near, key=lambda pair: pair[0])[1] if near else None


def real_cases(data: Path) -> Iterator[Case]:
    """The scans whose vendor says which points are buildings."""
    files = {
        "delft": [data / "delft/ahn3.laz"],
        "ign_urban": sorted((data / "ign_urban").glob("*.laz")),
        "ign_buildings": sorted((data / "ign_buildings").glob("*postValidation.laz")),
    }
    for name, paths in files.items():
        cloud, truth = read(paths)
        scene, regions, _ = detect(cloud, Consensus(), {})
        if name != "ign_buildings":
            yield Case(name, scene, truth == BUILDING, regions.label > 0)
            continue
        around = Bounds.of(cloud.xyz).translated(*cloud.origin)
        box = shapely.box(around.west, around.south, around.east, around.north)
        frame = pyogrio.read_dataframe(next((data / name).glob("*.shp")))
        drawn = tuple(shapely.force_2d(p) for p in frame.geometry if box.intersects(p))
        xy = cloud.xyz[:, :2] + np.array(cloud.origin)
        inside = shapely.contains_xy(shapely.union_all(drawn), xy[:, 0], xy[:, 1])
        raised = inside & (scene.height > 1.0)
        yield Case(name, scene, raised, regions.label > 0, drawn)


def town_case() -> Iterator[tuple[Case, list[Place]]]:
    """The simulated towns of the table, with the buildings over 10 m² that are lost and the false ones."""
    for town in TOWNS:
        made = simulate_town(0.04, seed=town.seed, terrain=town.terrain, trees=town.trees)
        exact = scan_town(made, town.density, 0.02, town.pattern, town.seed)
        order = exact.cloud.canonical_order()
        scene, regions, _ = detect(exact.cloud.take(order), Consensus(), {})
        side = max(CELL, town.density**-0.5)
        top = top_of_cells(scene.cloud, side)
        want = np.where(exact.truth_class[order] == BUILDING, exact.building[order], 0)
        case = Case(f"{town.terrain} {town.seed}", scene, want > 0, regions.label > 0)
        places = [
            *unmatched(case.xy, want, regions.label, top, side, MISSED),
            *unmatched(case.xy, regions.label, want, top, side, FALSE),
        ]
        yield case, places


def unmatched(
    xy: NDArray[np.float64], one: Labels, two: Labels, top: NDArray[np.int64], side: float, kind: str
) -> Iterator[Place]:
    """The objects of `one` over 10 m² of which less than half lies in any object of `two`."""
    size = np.bincount(one[top])
    hits = np.bincount(one[top][two[top] > 0], minlength=len(size))
    for number in np.flatnonzero((size * side * side > LEAST_OBJECT_M2) & (hits < 0.5 * size)):
        if number:
            own = xy[one == number]
            middle = (own.min(axis=0) + own.max(axis=0)) / 2
            wide = float(np.ptp(own, axis=0).max())
            yield Place(kind, (float(middle[0]), float(middle[1])), wide, float(size[number] * side * side))


def places_of(case: Case) -> list[Place]:
    """Connected groups of cells at least 1 m wide that differ from the reference, the largest first."""
    top = top_of_cells(case.scene.cloud)
    cell = np.floor(case.xy[top] / CELL).astype(np.int64)
    first = cell.min(axis=0)
    cell -= first
    places = []
    for kind, wrong in ((MISSED, case.want & ~case.got), (FALSE, case.got & ~case.want)):
        grid = np.zeros(cell.max(axis=0) + 1, bool)
        grid[tuple(cell[wrong[top]].T)] = True
        label, count = ndimage.label(
            ndimage.binary_opening(grid, np.ones((2, 2), bool)), np.ones((3, 3), int)
        )
        for number, window in enumerate(ndimage.find_objects(label, count), 1):
            area = float((label[window] == number).sum() * CELL * CELL)
            if area >= LEAST_M2:
                ends = np.array([[s.start, s.stop] for s in window])
                middle = (ends.mean(axis=1) + first) * CELL
                wide = float(np.ptp(ends, axis=1).max() * CELL)
                places.append(Place(kind, (float(middle[0]), float(middle[1])), wide, area))
    return sorted(places, key=lambda place: (-place.area, place.middle))


def draw_place(figure: SubFigure, case: Case, place: Place, title: str) -> None:
    """The place in plan and a section: colour is height, red what is missed, orange what is false."""
    plan, section = figure.subplots(2, 1, height_ratios=(3, 1))
    half = place.width / 2 + AROUND_M
    xy = case.xy - np.array(place.middle)
    near = np.flatnonzero((np.abs(xy) < half).all(axis=1) & ~case.scene.cloud.noise)
    near = near[np.argsort(case.scene.cloud.xyz[near, 2], kind="stable")]
    height = case.scene.height[near]
    size = 40.0 * min(1.0, 40.0 / np.sqrt(max(len(near), 1)))
    wrong = {MISSED: case.want & ~case.got, FALSE: case.got & ~case.want}
    for axes, right in ((plan, xy[near, 1]), (section, height)):
        some = np.abs(xy[near, 1]) < 1.0 if axes is section else np.ones(len(near), bool)
        axes.scatter(
            xy[near, 0][some], right[some], c=np.clip(height[some], 0, HIGHEST_M), s=size * 0.1, lw=0
        )
        for kind, mask in wrong.items():
            shown = mask[near] & some
            axes.scatter(xy[near, 0][shown], right[shown], color=COLOURS[kind], s=size * 0.13, lw=0)
        axes.tick_params(labelsize=5, length=1, pad=1)
        axes.set_xlim(-half, half)
    for polygon in case.outlines:
        plan.plot(*(shapely.get_coordinates(polygon.exterior) - np.array(place.middle)).T, "k", lw=0.8)
    plan.set_ylim(-half, half)
    plan.set_aspect("equal")
    section.set_ylim(-0.5, max(4.0, float(np.percentile(height, 99)) + 1.0))
    plan.set_title(title, size=6.5)


def draw_sheet(name: str, panels: list[tuple[Case, Place, str]]) -> Path:
    """One sheet with a panel a place; its file."""
    rows = -(-len(panels) // COLUMNS)
    figure = plt.figure(figsize=(2.3 * COLUMNS, 2.9 * rows), dpi=DOTS_AN_INCH, layout="constrained")
    for part, panel in zip(figure.subfigures(rows, COLUMNS, squeeze=False).ravel(), panels, strict=False):
        draw_place(part, *panel)
    FOLDER.mkdir(parents=True, exist_ok=True)
    path = FOLDER / f"detection-{name}.png"
    figure.canvas.draw()
    pixels = Image.fromarray(np.asarray(figure.canvas.buffer_rgba())).convert("RGB")
    pixels.quantize(COLOURS_KEPT).save(path, optimize=True)
    plt.close(figure)
    return path


def told(case: Case, place: Place) -> str:
    """Middle height over the terrain and share of several returns of the points that differ there."""
    wrong = case.want & ~case.got if place.kind == MISSED else case.got & ~case.want
    own = wrong & (np.abs(case.xy - np.array(place.middle)) <= place.width / 2 + CELL).all(axis=1)
    echoes = case.scene.cloud.number_of_returns
    if not own.any():
        return "–"
    several = f"{float((echoes[own] > 1).mean()):.2f}" if echoes is not None else "–"
    return f"{float(np.median(case.scene.height[own])):.1f} m, {several}"


def report(letter: str, pairs: list[tuple[Case, Place]]) -> list[tuple[Case, Place, str]]:
    """Prints the table of the places, and gives their panels."""
    print("| | data | place | kind | m² | height, several returns | reason |\n|---|---|---|---|---|---|---|")
    panels = []
    for number, (case, place) in enumerate(pairs, 1):
        reason = place.reason(case.name)
        text = "not looked at" if reason is None else ("**reference**: " * reason.reference + reason.why)
        where = f"{place.middle[0]:.0f} {place.middle[1]:.0f} | {place.kind} | {place.area:.0f}"
        print(f"| {letter}{number} | {case.name} | {where} | {told(case, place)} | {text} |")
        panels.append((case, place, f"{letter}{number} {case.name}: {place.kind}, {place.area:.0f} m²"))
    return panels


def apart(case: Case, places: list[Place]) -> None:
    """Prints the rates per cell as measured, and with the places where the reference is wrong left out."""
    blamed = [p for p in places if (reason := p.reason(case.name)) is not None and reason.reference]
    top = top_of_cells(case.scene.cloud)
    keep = np.ones(len(top), bool)
    for place in blamed:
        inside = np.abs(case.xy[top] - np.array(place.middle)) <= place.width / 2 + CELL
        keep &= ~(inside.all(axis=1) & (case.want[top] != case.got[top]))
    for title, some in (("as measured", np.ones(len(top), bool)), ("without them", keep)):
        complete, correct, iou = rates(case.got[top][some], case.want[top][some])
        print(f"{case.name} {title}: completeness {complete:.4f}, correctness {correct:.4f}, IoU {iou:.4f}")
    print(f"{len(blamed)} places, {sum(p.area for p in blamed):.0f} m², are the reference's\n")


def main() -> None:
    """Draw the sheets and print the tables."""
    folder = os.environ.get("EAVES_DATA")
    if folder is None:
        print("EAVES_DATA is not set: there is nothing to draw")
        return
    for case in real_cases(Path(folder)):
        places = places_of(case)
        letter = {"delft": "D", "ign_urban": "U", "ign_buildings": "H"}[case.name]
        print(draw_sheet(case.name, report(letter, [(case, place) for place in places[:SHOWN]])))
        apart(case, places)
    pairs = [(case, place) for case, places in town_case() for place in places]
    print(draw_sheet("towns", report("T", pairs)))


if __name__ == "__main__":
    main()
