"""The thirty buildings whose roof points lie farthest from their models, on contact sheets.

Run `EAVES_DATA=... python -m benchmarks.gallery.solids`.
"""

from __future__ import annotations

import os
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from benchmarks.accuracy.models import Case, city3d, delft, town
from eaves.geometry.face_table import fit_roof
from eaves.model import BuildingModel, Values
from eaves.model.building import ROOF_SURFACE
from eaves.reconstruct import reconstruct_building
from eaves.validate.files import roof_faces

FOLDER = Path(__file__).parents[2] / "docs" / "gallery"

WORST = 10
"""Buildings of each data set on its sheet."""

COLOURS = 128
"""Colours of a picture."""

COLOUR_END = 1.0
"""Distance (m) at which the colours end."""

STRIP = 0.35
"""Half the width (m) of the strip whose points the section shows."""


def worst_of(cases: list[Case]) -> list[tuple[float, Case, BuildingModel, Values]]:
    """RMSE (m), case, model and signed distances of the roof points of the worst cases, the worst first."""
    found = []
    for case in cases:
        model = reconstruct_building(case.points, case.footprint, case.planes, case.ground)
        if isinstance(model, BuildingModel) and len(case.roof):
            away = fit_roof(case.roof, roof_faces(model, model.lod)).distance
            found.append((float(np.sqrt(np.nanmean(away**2))), case, model, away))
    return sorted(found, key=lambda row: -row[0])[:WORST]


def draw_plan(axes: Axes, case: Case, model: BuildingModel, away: Values, title: str) -> None:
    """The roof faces from above, and the roof points: red above their face, blue below it."""
    order = np.argsort(np.abs(np.nan_to_num(away)))
    x, y, _ = case.roof[order].T
    axes.scatter(
        x,
        y,
        c=away[order],
        s=5.0,
        cmap="RdBu_r",
        vmin=-COLOUR_END,
        vmax=COLOUR_END,
        edgecolors="0.75",
        lw=0.15,
    )
    for solid in model.solids[model.lod]:
        for face in solid.faces:
            if face.surface == ROOF_SURFACE:
                for ring in face.rings:
                    axes.plot(*solid.vertices[[*ring, ring[0]], :2].T, color="black", lw=0.7)
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_title(title, fontsize=7, pad=2)


def draw_section(axes: Axes, case: Case, model: BuildingModel, away: Values) -> None:
    """Points and model along the strip, across the building's longer side, where the residual is largest."""
    box = case.footprint.polygon.minimum_rotated_rectangle
    corners = np.asarray(box.exterior.coords)[:3]
    sides = np.diff(corners, axis=0)
    along = sides[np.argmax(np.hypot(*sides.T))]
    along = along / np.hypot(*along)
    across = np.array([-along[1], along[0]])
    place = case.roof[:, :2] @ along
    error = np.minimum(np.nan_to_num(away), 3.0) ** 2
    weight = [error[np.abs(place - middle) < STRIP].sum() for middle in place]
    middle = place[int(np.argmax(weight))]
    strip = np.abs(case.points[:, :2] @ along - middle) < STRIP
    shown = case.points[strip]
    axes.scatter(shown[:, :2] @ across, shown[:, 2] - case.ground, s=3.0, color="tab:red", lw=0)
    t = np.arange((case.roof[:, :2] @ across).min() - 0.5, (case.roof[:, :2] @ across).max() + 0.5, 0.05)
    places = np.column_stack([middle * along + t[:, None] * across, np.zeros(len(t))])
    fit = fit_roof(places, roof_faces(model, model.lod))
    axes.plot(t, np.nan_to_num(-fit.vertical - case.ground), color="black", lw=0.8)
    axes.set_aspect("equal")
    axes.tick_params(labelsize=5, length=2, pad=1)
    axes.spines[["top", "right"]].set_visible(False)


def draw_sheet(name: str, cases: list[Case], first: int) -> Path:
    """One sheet: the plan of each of the worst and, under it, a section where it is worst."""
    worst = worst_of(cases)
    figure, rows = plt.subplots(4, 5, figsize=(11.0, 9.6), height_ratios=[3, 2, 3, 2])
    for place, (rmse, case, model, away) in enumerate(worst):
        above, below = rows[2 * (place // 5), place % 5], rows[2 * (place // 5) + 1, place % 5]
        faces = model.attributes["roof_face_count"]
        title = f"{first + place}  {case.name[-12:]}\nRMSE {rmse:.2f} m, {len(case.roof)} points, {faces} f."
        draw_plan(above, case, model, away, title)
        draw_section(below, case, model, away)
    figure.tight_layout(pad=0.4, h_pad=0.6)
    path = FOLDER / f"solids-{name}.png"
    save_small(figure, path)
    return path


def save_small(figure: Figure, path: Path, dpi: int = 95, colours: int = COLOURS) -> None:
    """Write a figure as a PNG of few colours: a quarter of the size."""
    figure.savefig(path, dpi=dpi)
    plt.close(figure)
    with Image.open(path) as picture:
        small = picture.convert("RGB").quantize(colours, Image.Quantize.MAXCOVERAGE)
    small.save(path, optimize=True)


def main() -> None:
    """Draw the sheets."""
    data = Path(os.environ["EAVES_DATA"])
    FOLDER.mkdir(exist_ok=True)
    sets = (("delft", delft(data)), ("city3d", city3d(data)), ("town", town(10.0)))
    for number, (name, cases) in enumerate(sets):
        print(draw_sheet(name, cases, 1 + WORST * number))


if __name__ == "__main__":
    main()
