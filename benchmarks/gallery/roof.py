"""Thirty roofs coloured by plane, the worst of each data set: docs/gallery/roof-*.png.

Run `EAVES_DATA=... python -m benchmarks.gallery.roof`.
"""

from __future__ import annotations

import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from benchmarks.gallery.roof_cases import Roof, badness, roofs_of
from benchmarks.gallery.solids import FOLDER, save_small
from eaves.geometry.neighbours import measure_spacing
from eaves.model import RoofPlane
from eaves.roof import segment_roof

SHEETS = {
    "delft": {"delft": 10},
    "city3d": {"city3d": 7, "ign": 3},
    "others": {"building3d": 5, "town": 2, "delfshaven": 2, "trondheim": 1},
}
"""How many roofs of which data each sheet shows."""

COLUMNS, COLOURS = 5, 64


def palette(count: int) -> NDArray[np.float64]:
    """Colours (count, 4), unlike for numbers near each other."""
    number = np.arange(count)
    shades = plt.get_cmap("hsv")(np.mod(0.13 + number * 0.381966, 1.0))
    shades[:, :3] *= np.where(number % 3 == 1, 0.65, 0.92)[:, None]
    return np.asarray(shades)


def draw_roof(plan: Axes, side: Axes, roof: Roof, planes: list[RoofPlane], bad: float) -> None:
    """The points in plan, and from the side or with their true faces; black ones have no plane."""
    points = roof.points
    mine = np.zeros(len(points), np.int64)
    for number, plane in enumerate(planes, 1):
        mine[plane.members] = number
    colours = np.vstack([[0.0, 0.0, 0.0, 1.0], palette(max(int(mine.max()), 1))])
    size = float(np.clip(3000.0 / len(points), 0.15, 5.0))
    style = {"s": size, "linewidths": 0}
    plan.scatter(points[:, 0], points[:, 1], c=colours[mine], **style)
    plan.set_title(f"{roof.data} {roof.name}: {len(planes)} planes, {bad:.1%}", size=6, pad=2)
    if roof.faces is None:
        flat = points[:, :2] - points[:, :2].mean(axis=0)
        across = flat @ np.linalg.svd(flat, full_matrices=False)[2][1]
        side.scatter(across, points[:, 2], c=colours[mine], **style)
    else:
        faces = np.unique(roof.faces, return_inverse=True)[1].ravel() + int(roof.faces.min() > 0)
        colours = np.vstack([[0.0, 0.0, 0.0, 1.0], palette(int(faces.max()))])
        side.scatter(points[:, 0], points[:, 1], c=colours[faces], **style)
        side.set_title("truth", size=5, pad=1)
    for axes in (plan, side):
        axes.set_aspect("equal")
        axes.axis("off")


def main() -> None:
    """Segment all roofs, draw the worst, and print what is drawn."""
    found: dict[str, list[tuple[float, Roof, list[RoofPlane]]]] = {}
    for roof in roofs_of(Path(os.environ["EAVES_DATA"])):
        planes = segment_roof(roof.points, measure_spacing(roof.points))
        found.setdefault(roof.data, []).append((badness(roof, planes), roof, planes))
    for name, wanted in SHEETS.items():
        rows = [
            case
            for data, count in wanted.items()
            for case in sorted(found[data], key=lambda case: -case[0])[:count]
        ]
        lines = -(-len(rows) // COLUMNS)
        figure, grid = plt.subplots(2 * lines, COLUMNS, figsize=(11.0, 4.4 * lines), squeeze=False)
        for axes in grid.ravel():
            axes.axis("off")
        for number, (bad, roof, planes) in enumerate(rows):
            line, column = divmod(number, COLUMNS)
            draw_roof(grid[2 * line, column], grid[2 * line + 1, column], roof, planes, bad)
            print(f"{roof.data} {roof.name}: {len(planes)} planes, {bad:.1%} of {len(roof.points)} points")
        figure.tight_layout(pad=0.3)
        save_small(figure, FOLDER / f"roof-{name}.png", 100, COLOURS)
    for data, cases in found.items():
        print(f"{data}: {len(cases)} roofs, mean {np.mean([case[0] for case in cases]):.2%}")


if __name__ == "__main__":
    main()
