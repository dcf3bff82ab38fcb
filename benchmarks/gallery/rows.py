"""Rows of like houses in delft with the roofs fitted to them: docs/gallery/roof-rows.png.

Run `EAVES_DATA=... python -m benchmarks.gallery.rows`.
"""

from __future__ import annotations

import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import shapely
from matplotlib.axes import Axes

from benchmarks.accuracy.moments_rows import RowHouse, row_houses
from benchmarks.gallery.solids import FOLDER, save_small
from eaves.published.maas_vosselman.moments.parametric_roof import ACROSS, LEFT_SLOPE, RIGHT_SLOPE, TOP


def draw_section(axes: Axes, house: RowHouse) -> None:
    """The points across the ridge, those of the main roof in blue, and the roof fitted to them in red."""
    fit, (_, _, south, north) = house.house.fit, house.house.edges
    p = fit.parameters
    on = np.zeros(len(house.points), bool)
    on[house.roof] = True
    across = fit.axes(house.points)[1]
    plan = fit.axes(shapely.get_coordinates(house.plan))[1]
    axes.scatter(across[~on], house.points[~on, 2], s=1, color="0.6", linewidths=0)
    axes.scatter(across[on], house.points[on, 2], s=2, color="tab:blue", linewidths=0)
    eaves = [p[TOP] - p[RIGHT_SLOPE] * (p[ACROSS] - south), p[TOP] - p[LEFT_SLOPE] * (north - p[ACROSS])]
    axes.plot([south, p[ACROSS], north], [eaves[0], p[TOP], eaves[1]], "r", lw=0.8)
    for edge in (plan.min(), plan.max()):
        axes.axvline(edge, color="k", lw=0.4, ls=":")
    axes.set_title(f"{house.number}: {house.house.width:.2f} m, {np.degrees(house.house.slope):.1f}°", size=6)
    axes.set_aspect("equal")
    axes.tick_params(labelsize=5, length=1, pad=1)
    axes.set_ylim(p[TOP] - 6.0, p[TOP] + 1.5)


def main() -> None:
    """Draw all rows on one sheet."""
    rows = list(row_houses(Path(os.environ["EAVES_DATA"])))
    columns = max(len(houses) for _, houses in rows)
    figure, grid = plt.subplots(len(rows), columns, figsize=(11.0, 8.0), squeeze=False)
    for line, (name, houses) in zip(grid, rows, strict=True):
        line[0].set_ylabel(name, size=7)
        for axes, house in zip(line, houses, strict=False):
            draw_section(axes, house)
        for axes in line[len(houses) :]:
            axes.axis("off")
    figure.tight_layout(pad=0.3)
    save_small(figure, FOLDER / "roof-rows.png", 110)


if __name__ == "__main__":
    main()
