"""Models seen from the side with the points they were made from."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from eaves.model import BuildingModel, Points
from eaves.model.building import GROUND_SURFACE, ROOF_SURFACE

COLOURS = {ROOF_SURFACE: (0.80, 0.35, 0.25, 0.55), "WallSurface": (0.85, 0.85, 0.80, 0.35)}
OTHER = (0.70, 0.60, 0.50, 0.35)


def plot_models(
    models: Sequence[BuildingModel],
    clouds: Sequence[Points],
    path: str | Path,
    columns: int = 5,
    titles: Sequence[str] = (),
) -> Path:
    """A sheet of models at their finest level, each over its points (N, 3) in the same local metres."""
    rows = -(-len(models) // columns)
    figure = Figure(figsize=(4 * columns, 3.6 * rows))
    for number, (model, points) in enumerate(zip(models, clouds, strict=True)):
        axes = figure.add_subplot(rows, columns, number + 1, projection="3d")
        for solid in model.solids.get(model.lod, ()):
            for face in solid.faces:
                if face.surface != GROUND_SURFACE:
                    ring = solid.vertices[list(face.rings[0])]
                    axes.add_collection3d(
                        Poly3DCollection(
                            [ring],
                            facecolors=COLOURS.get(face.surface, OTHER),
                            edgecolors="k",
                            linewidths=0.5,
                        )
                    )
        if len(points):
            axes.scatter(*points.T, s=0.6, c="tab:blue", depthshade=False)
            low, high = points.min(axis=0), points.max(axis=0)
            axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
            axes.set_box_aspect(np.maximum(high - low, 1.0))
        axes.set_axis_off()
        axes.set_title(titles[number] if titles else model.footprint.id, fontsize=7)
        axes.view_init(35, -60)
    figure.tight_layout()
    figure.savefig(path, dpi=80)
    return Path(path)
