"""Outlines of two builds at the same places, shuffled and without names, to be judged by eye.

Run `python -m benchmarks.gallery.blind SHEETS NAME=NEW,OLD,POINTS ...`; NEW and OLD are what `eaves build`
wrote for POINTS. It draws `COUNT` places a survey, half of them outlines of either build, each place once for
each build: `sheet-NN.png`, and `key.csv`, which says what build each crop shows: look at it when all crops
are marked. Then `python -m benchmarks.gallery.blind SHEETS MARKS.txt` counts: in a line for each sheet its
number and a letter for each crop in reading order, `r` for right, any other for wrong.
"""

from __future__ import annotations

import csv
import sys
from collections import Counter
from pathlib import Path

import laspy
import matplotlib.pyplot as plt
import numpy as np
import shapely
from matplotlib.colors import LightSource
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.gallery.sheets import shapes_in

SEED, COUNT, COLUMNS, ROWS = 67, 24, 6, 4
LEAST = 10.0
"""Area (m²) of the smallest outline that is judged."""
CELLS = 120
"""Of a crop's side: the relief of its highest points."""


def relief_of(xyz: NDArray[np.float64], west: float, south: float, side: float) -> NDArray[np.float64]:
    """Heights (CELLS, CELLS) of a place, of each cell those of the nearest point, shaded."""
    inside = (np.abs(xyz[:, 0] - west - side / 2) < 0.6 * side) & (
        np.abs(xyz[:, 1] - south - side / 2) < 0.6 * side
    )
    points = xyz[inside]
    if not len(points):
        return np.ones((CELLS, CELLS, 3))
    middles = (np.arange(CELLS) + 0.5) * side / CELLS
    places = np.stack(np.meshgrid(west + middles, south + middles), -1).reshape(-1, 2)
    _, near = cKDTree(points[:, :2]).query(places)
    heights = points[near, 2].reshape(CELLS, CELLS)
    low, high = np.percentile(heights, [2, 98])
    shown = np.clip((heights - low) / max(high - low, 3.0), 0, 1)
    return LightSource(315, 45).shade(
        shown * max(high - low, 3.0), plt.cm.viridis, blend_mode="soft", dx=side / CELLS, dy=side / CELLS
    )[..., :3]


def draw(folder: Path, surveys: list[str]) -> None:
    """Draw the sheets and write their key."""
    rng, crops = np.random.default_rng(SEED), []
    for survey in surveys:
        name, _, rest = survey.partition("=")
        new, old, file = rest.split(",")
        las = laspy.read(file)
        crs = las.header.parse_crs()
        unit = 1.0 if crs is None else crs.axis_info[0].unit_conversion_factor
        xyz = np.column_stack([las.x, las.y, las.z])[np.asarray(las.return_number == las.number_of_returns)]
        builds = {"new": shapes_in(Path(new)), "old": shapes_in(Path(old))}
        for number in range(COUNT):
            shapes = builds[("new", "old")[number % 2]]
            shapes = shapes[shapely.area(shapes) > LEAST / unit**2]
            west, south, east, north = shapes[rng.integers(len(shapes))].bounds
            side = min(max(1.5 * max(east - west, north - south), 25 / unit), 150 / unit)
            place = (west + east - side) / 2, (south + north - side) / 2, side
            crops += [(name, number, build, place, shown, xyz) for build, shown in builds.items()]
    order = rng.permutation(len(crops))
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "key.csv").open("w", newline="") as file:
        key = csv.writer(file)
        for first in range(0, len(order), COLUMNS * ROWS):
            sheet = first // (COLUMNS * ROWS)
            figure, axes = plt.subplots(ROWS, COLUMNS * 2, figsize=(COLUMNS * 4.4, ROWS * 2.35))
            for k, number in enumerate(order[first : first + COLUMNS * ROWS]):
                name, place, build, (west, south, side), shapes, xyz = crops[number]
                key.writerow([sheet, k, name, place, build])
                image = relief_of(xyz, west, south, side)
                for axis in axes.flat[2 * k : 2 * k + 2]:
                    axis.imshow(image, origin="lower", extent=(west, west + side, south, south + side))
                    axis.set(xlim=(west, west + side), ylim=(south, south + side), xticks=[], yticks=[])
                near = shapes[shapely.intersects(shapes, shapely.box(west, south, west + side, south + side))]
                for line in shapely.get_parts(shapely.boundary(near)):
                    axis.plot(*shapely.get_coordinates(line).T, color="red", linewidth=1.1)
                axis.plot(west + side / 2, south + side / 2, "w+", markersize=5)
                axes.flat[2 * k].set_title(f"{k + 1}", fontsize=8, pad=2)
            figure.tight_layout(pad=0.3)
            figure.savefig(folder / f"sheet-{sheet:02d}.png", dpi=75)
            plt.close(figure)


def count(folder: Path, marks: Path) -> None:
    """Print the share of crops that were marked right, by survey and build."""
    letters = {}
    for line in marks.read_text().splitlines():
        sheet, _, word = line.partition(" ")
        letters |= {(int(sheet), k): letter for k, letter in enumerate(word.strip())}
    right, all_of = Counter[tuple[str, str]](), Counter[tuple[str, str]]()
    with (folder / "key.csv").open() as file:
        for sheet, k, name, _, build in csv.reader(file):
            for one in (name, "all"):
                all_of[one, build] += 1
                right[one, build] += letters[int(sheet), int(k)] == "r"
    print("| survey | new | old |\n|---|---|---|")
    for name in dict.fromkeys(name for name, _ in all_of):
        shares = (right[name, build] / all_of[name, build] for build in ("new", "old"))
        print(f"| {name} | " + " | ".join(f"{share:.2f}" for share in shares) + " |")


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    if "=" in sys.argv[2]:
        draw(Path(sys.argv[1]), sys.argv[2:])
    else:
        count(Path(sys.argv[1]), Path(sys.argv[2]))
