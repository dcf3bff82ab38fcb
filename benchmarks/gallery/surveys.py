"""What `eaves build` finds on every survey: docs/gallery/surveys-*.png, and rows of counts on screen.

Run `EAVES_DATA=... python -m benchmarks.gallery.surveys FOLDER`; what FOLDER has already is only drawn.
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path

import laspy
import matplotlib.pyplot as plt
import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.colors import LightSource
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from scipy import ndimage

import eaves
from benchmarks.gallery.solids import FOLDER, save_small
from eaves.flow.results import table_of
from eaves.formats.rasters.geotiff import read_raster
from eaves.model import Raster
from eaves.run.manifest import read_facts

SURVEYS: dict[str, tuple[str, str | None]] = {
    "woodford": ("woodford/woodford.laz", "EPSG:3089"),
    "autzen": ("autzen/autzen_full.laz", "autzen/srs.wkt"),
    "ign_sparse": ("ign_sparse/*.laz", None),
    "delft": ("delft/ahn3.laz", None),
    "delft_small": ("misc/delft_small.laz", None),
    "ign_urban": ("ign_urban/*.laz", None),
    "ign_buildings": ("ign_buildings/*postValidation.laz", None),
    "vaihingen1": ("vaihingen/clip1.laz", None),
    "vaihingen2": ("vaihingen/clip2.laz", None),
    "vaihingen3": ("vaihingen/clip3.laz", None),
    "california": ("california/california.laz", None),
    "galapagos": ("galapagos/galapagos.laz", None),
    "conifer": ("misc/lidR_MixedConifer.laz", None),
    "topography": ("misc/lidR_Topography.laz", None),
}
"""Where the points of each survey are, and their reference system where the files are silent."""
WHOLE = ("woodford", "autzen", "ign_sparse", "delft", "california")
"""Surveys with a sheet of their own, which shows the worst places enlarged."""
SMALL = {
    "ign": ("ign_urban", "ign_buildings", "delft_small"),
    "vaihingen": ("vaihingen1", "vaihingen2", "vaihingen3"),
}
PLACES, AROUND_M = 6, 12.0
"""How many places a sheet enlarges, and the margin around the building."""
MOST_CELLS = 1100
"""A raster wider than that is thinned before it is drawn."""
GREYS, COLOURS_KEPT = 12, 40
"""Few, so that the pages stay small."""
BRIDGES = {
    "autzen": (193924.0, 258780.0, 194126.0, 259102.0),
    "delft": (84925.0, 447445.0, 84950.0, 447475.0),
}
"""Where bridges are, m: west, south, east, north."""
CLASS_COLOURS = {2: "#b4b4b4", 5: "#7fb77f", 6: "#0b3fb3", 9: "#50b0f0", 17: "#e07000"}
FULL, LOWER, DOUBTED, FAILED = "#0b3fb3", "#008a5a", "#e07000", "#e00000"


@dataclass(frozen=True, eq=False)
class Found:
    """One footprint (world m), and how it is drawn: the worse, the larger `badness`."""

    shape: shapely.Polygon
    colour: str
    words: str
    badness: float


def found_of(folder: Path, scale: float) -> list[Found]:
    """The footprints of a run, worst first: the large ones that failed, are doubted or fit badly."""
    frame = table_of(folder, "footprints")
    finest = frame.lod.max() if len(frame) else ""
    found = []
    for row in frame.itertuples():
        shape = shapely.transform(shapely.force_2d(row.geometry), lambda xy: scale * xy)
        misfit = 9.0 if row.rmse95_m is None or np.isnan(row.rmse95_m) else float(row.rmse95_m)
        failed, doubted = isinstance(row.failure_code, str), row.trust == "low"
        colour = FAILED if failed else DOUBTED if doubted else FULL if row.lod == finest else LOWER
        reason = str(row.failure_code if failed else row.review_reason if doubted else "")
        words = f"{shape.area:.0f} m², LoD {row.lod}, {misfit:.2f} m\n{reason[:50]}"
        size = np.sqrt(shape.area)
        badness = size * (misfit + 2.0 * failed + doubted)
        found.append(Found(shape, colour, words, float(badness)))
    return sorted(found, key=lambda one: -one.badness)


def hillshade(axes: Axes, surface: Raster) -> None:
    """The surface lit from the north-west; cells without points are white."""
    step = max(1, -(-max(surface.shape) // MOST_CELLS))
    heights = surface.values[::step, ::step]
    known = np.isfinite(heights)
    near = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    cell = surface.cell * step
    shade = LightSource(315, 45).hillshade(heights[tuple(near)], dx=cell, dy=cell)
    rows, columns = surface.shape
    extent = (
        surface.west,
        surface.west + columns * surface.cell,
        surface.north - rows * surface.cell,
        surface.north,
    )
    steps = np.round(GREYS * (0.35 + 0.65 * shade)) / GREYS
    axes.imshow(
        np.where(known, steps, 1.0), cmap="gray", vmin=0, vmax=1, extent=extent, interpolation="nearest"
    )
    axes.set(xticks=[], yticks=[], aspect="equal")


def filled(part: shapely.Polygon) -> Outline:
    """The rings of a polygon as one path, so that its holes stay empty."""
    return Outline.make_compound_path(
        *(Outline(np.asarray(ring.coords)[:, :2], closed=True) for ring in shapely.get_rings(part))
    )


def outline(axes: Axes, found: list[Found], width: float) -> None:
    """All rings, the worst drawn last."""
    for one in reversed(found):
        for part in shapely.get_parts(one.shape):
            axes.add_patch(PathPatch(filled(part), facecolor=one.colour, alpha=0.25, linewidth=0))
        for ring in shapely.get_rings(shapely.get_parts(one.shape)):
            axes.plot(*np.asarray(ring.coords)[:, :2].T, color=one.colour, linewidth=width)


def window(surface: Raster, box: tuple[float, float, float, float]) -> Raster:
    """The part of a raster within west, south, east, north."""
    west, south, east, north = box
    left, right = (int((x - surface.west) // surface.cell) for x in (west, east))
    upper, lower = (int((surface.north - y) // surface.cell) for y in (north, south))
    left, upper = max(left, 0), max(upper, 0)
    cells = surface.values[upper : lower + 1, left : right + 1]
    return Raster(
        cells, surface.west + left * surface.cell, surface.north - upper * surface.cell, surface.cell
    )


def panel(axes: Axes, folder: Path, title: str, width: float = 0.6) -> tuple[Raster, list[Found]]:
    """A whole survey: hillshade and outlines."""
    surface, system = read_raster(folder / "dsm.tif")
    found = found_of(folder, system.horizontal_unit_m)
    hillshade(axes, surface)
    outline(axes, found, width)
    count = f"{len(found)} building" + "s" * (len(found) != 1)
    axes.set_title(f"{title}: {count}", size=8)
    return surface, found


def sheet(folder: Path, name: str, picture: Path) -> None:
    """The whole survey on the left, its worst places on the right."""
    figure = plt.figure(figsize=(13, 8.6), layout="constrained")
    grid = figure.add_gridspec(3, 4, width_ratios=(1.3, 1.3, 1, 1))
    surface, found = panel(figure.add_subplot(grid[:, :2]), folder, name)
    for number, one in enumerate(found[:PLACES]):
        axes = figure.add_subplot(grid[number // 2, 2 + number % 2])
        west, south, east, north = one.shape.buffer(AROUND_M).bounds
        half = max(east - west, north - south) / 2
        x, y = (west + east) / 2, (south + north) / 2
        box = (x - half, y - half, x + half, y + half)
        hillshade(axes, window(surface, box))
        outline(axes, found, 1.2)
        axes.set(xlim=(box[0], box[2]), ylim=(box[1], box[3]))
        axes.set_title(one.words, size=7)
    save_small(figure, picture, colours=COLOURS_KEPT)


def strip(folder: Path, names: tuple[str, ...], picture: Path) -> None:
    """Small surveys side by side."""
    figure, row = plt.subplots(1, len(names), figsize=(4.6 * len(names), 5.0), layout="constrained")
    for axes, name in zip(np.atleast_1d(row), names, strict=True):
        panel(axes, folder / name, name, width=0.9)
    save_small(figure, picture, colours=COLOURS_KEPT)


def bridges(folder: Path, picture: Path) -> None:
    """The classes of points about bridges."""
    figure, row = plt.subplots(1, len(BRIDGES), figsize=(8.0, 6.0), layout="constrained")
    for axes, (name, (west, south, east, north)) in zip(row, BRIDGES.items(), strict=True):
        las = laspy.read(next((folder / name).glob("classified*.laz")))
        unit = read_raster(folder / name / "mask.tif")[1].horizontal_unit_m
        xy = unit * np.column_stack([las.x, las.y])
        classes = np.asarray(las.classification)
        seen = ((xy > [west, south]) & (xy < [east, north])).all(axis=1)
        for number in np.unique(classes[seen]):
            mine = seen & (classes == number)
            colour = CLASS_COLOURS.get(int(number), "#303030")
            size = min(4.0, 40000.0 / seen.sum())
            axes.scatter(*xy[mine].T, s=size, c=colour, linewidths=0, label=str(number))
        axes.set(xticks=[], yticks=[], aspect="equal")
        axes.set_title(name, size=8)
        axes.legend(loc="upper left", markerscale=4.0, fontsize=6)
    save_small(figure, picture, colours=COLOURS_KEPT)


def compute(data: Path, folder: Path) -> None:
    """Build what the folder has not."""
    for name, (pattern, system) in SURVEYS.items():
        if "found" not in read_facts(folder / name):
            crs = str(data / system) if system and system.endswith(".wkt") else system
            files = [str(path) for path in sorted(data.glob(pattern))]
            eaves.build(files, folder / name, crs=crs, jobs=1)


def counts(folder: Path) -> str:
    """A row of the table of docs/gallery/surveys.md."""
    run = read_facts(folder)
    share = ", ".join(
        f"{lod}: {100 * n / max(run['found'], 1):.0f} %" for lod, n in sorted(run["by_lod"].items())
    )
    seconds = sum(run["stage_cpu_seconds"].values())
    return (
        f"| {folder.name} | {run['points']:,} | {run['found']} | {run['failed']} | {share} | {seconds:.0f} |"
    )


def main() -> None:
    """Build, draw, and print the counts."""
    data, folder = Path(os.environ["EAVES_DATA"]), Path(sys.argv[1])
    compute(data, folder)
    for name in WHOLE:
        sheet(folder / name, name, FOLDER / f"surveys-{name}.png")
    for name, members in SMALL.items():
        strip(folder, members, FOLDER / f"surveys-{name}.png")
    bridges(folder, FOLDER / "surveys-bridges.png")
    for name in SURVEYS:
        sys.stdout.write(counts(folder / name) + "\n")


if __name__ == "__main__":
    main()
