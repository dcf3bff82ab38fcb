"""The same buildings by each reconstructor, side by side.

Run `EAVES_DATA=... python -m benchmarks.gallery.reconstructors`.
"""

from __future__ import annotations

import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from benchmarks.accuracy.models import METHODS, delft
from benchmarks.gallery.solids import FOLDER, draw_plan, save_small
from eaves.geometry.face_table import fit_roof
from eaves.model import BuildingModel
from eaves.reconstruct import reconstruct_building
from eaves.validate.files import roof_faces

SHOWN = (20, 50, 75)
"""Places among the buildings of Delft in the order of their number of planes: few, some, many."""


def main() -> None:
    """Draw the picture."""
    cases = sorted(delft(Path(os.environ["EAVES_DATA"])), key=lambda case: (len(case.planes), case.name))
    figure, rows = plt.subplots(len(SHOWN), len(METHODS), figsize=(10.0, 7.0))
    for line, place in zip(rows, SHOWN, strict=True):
        case = cases[place]
        for axes, method in zip(line, METHODS, strict=True):
            model = reconstruct_building(case.points, case.footprint, case.planes, case.ground, method)
            if not isinstance(model, BuildingModel):
                axes.set_axis_off()
                continue
            away = fit_roof(case.roof, roof_faces(model, model.lod)).distance
            rmse = float(np.sqrt(np.nanmean(away**2)))
            faces = model.attributes["roof_face_count"]
            title = f"{method.name}, LoD {model.lod}\n{faces} faces, RMSE {rmse:.2f} m"
            draw_plan(axes, case, model, away, title)
    figure.tight_layout(pad=0.4, h_pad=0.8)
    save_small(figure, FOLDER / "solids-reconstructors.png", 80)


if __name__ == "__main__":
    main()
