"""The roofs of Building3D as people drew them and as they are exported, before and after they are drawn.

Run `EAVES_DATA=... python -m benchmarks.gallery.wireframes`.
"""

from __future__ import annotations

import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from benchmarks.accuracy.models import Drawn, building3d
from benchmarks.gallery.solids import FOLDER, save_small
from benchmarks.wireframes.drawing import DRAWN_DETAIL, roof_wireframe
from benchmarks.wireframes.scores import CORNER_RADIUS, NOTHING, Wireframe, evaluate_wireframe
from eaves.reconstruct.arrangement import Arrangement

EVERY_CORNER = 0.05
"""Size (m) of what is drawn as one corner where every corner of the solid is shown."""

COLUMNS = 8


def false_corners(mine: Wireframe, true: Wireframe) -> np.ndarray:
    """Numbers of the corners that pair with none of the reference's."""
    distance = cdist(mine.corners, true.corners)
    one, two = linear_sum_assignment(np.where(distance <= CORNER_RADIUS, distance, 1e6))
    return np.setdiff1d(np.arange(len(mine.corners)), one[distance[one, two] <= CORNER_RADIUS])


def frame_of(roof: Drawn, detail: float) -> Wireframe:
    """The roof as exported with what is smaller than `detail` (m) drawn as one."""
    return Wireframe(*roof_wireframe(roof.model, detail)) if roof.model else NOTHING


def draw_frame(axes: Axes, roof: Drawn, detail: float) -> None:
    """A wireframe in red over the reference in grey, its false corners as crosses."""
    mine, true = frame_of(roof, detail), roof.reference
    for frame, style in ((true, {"color": "0.7", "lw": 2.5}), (mine, {"color": "tab:red", "lw": 0.7})):
        for edge in frame.edges:
            axes.plot(*frame.corners[edge, :2].T, **style)
    wrong = false_corners(mine, true)
    axes.plot(*mine.corners[wrong, :2].T, "x", color="black", ms=4.0, mew=0.9)
    score = evaluate_wireframe(mine, true).corners
    axes.set_title(f"{roof.name}: {score.correctness:.2f}, {score.completeness:.2f}", fontsize=6, pad=2)
    axes.set_aspect("equal")
    axes.set_axis_off()


def main() -> None:
    """Draw all roofs, those with most false corners first: every corner above, as exported below."""
    roofs = building3d(Path(os.environ["EAVES_DATA"]), Arrangement())
    roofs.sort(key=lambda roof: -len(false_corners(frame_of(roof, EVERY_CORNER), roof.reference)))
    rows = 2 * -(-len(roofs) // COLUMNS)
    figure, axes = plt.subplots(rows, COLUMNS, figsize=(13.0, 1.75 * rows))
    for axis in axes.ravel():
        axis.set_axis_off()
    for place, roof in enumerate(roofs):
        row, column = 2 * (place // COLUMNS), place % COLUMNS
        draw_frame(axes[row, column], roof, EVERY_CORNER)
        draw_frame(axes[row + 1, column], roof, DRAWN_DETAIL)
    figure.tight_layout(pad=0.3, h_pad=0.5)
    save_small(figure, FOLDER / "wireframes-building3d.png")


if __name__ == "__main__":
    main()
