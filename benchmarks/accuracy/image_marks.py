"""A village from drone images, judged by roofs that were marked in its colours before any code was changed.

Run `python -m benchmarks.accuracy.image_marks SURVEY [MARKS]`: SURVEY is `churo.laz`, built by the command.
The crop is parted into windows of 100 m; every roof to be seen in every second one (a chessboard) is in
`churo_marks.csv` with its middle, length and width. Some marks lie outside the windows: roofs that reach in,
so that none of them counts as false.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import geopandas
import numpy as np
import shapely

from benchmarks.table import keep

WINDOW, LEAST = 100.0, 30.0
"""Side of a window (m), and the smallest roof of the row of larger ones (m²)."""
WINGS = ((871474.0, 8503574.0), (871505.0, 8503559.0), (871481.0, 8503546.0))
"""The middles of the three wings of the school."""


def in_windows(xy: np.ndarray, corner: np.ndarray) -> np.ndarray:
    """Which places (n, 2) lie in a window of the chessboard."""
    return np.floor((xy - corner) / WINDOW).sum(axis=1) % 2 == 0


def judge(footprints: np.ndarray, marks: np.ndarray, corner: np.ndarray) -> dict[str, object]:
    """Roofs found and outlines that meet no mark, in the windows.

    Parameters
    ----------
    footprints : (n,) array of polygons
        The outlines of a run.
    marks : (m, 4) array
        Middle (x, y), length and width of the marked roofs, metres.
    corner : (2,) array
        Lower left corner of the windows.
    """
    inside = in_windows(marks[:, :2], corner)
    large = marks[:, 2] * marks[:, 3] >= LEAST
    tree = shapely.STRtree(footprints)
    found = np.zeros(len(marks), dtype=bool)
    found[tree.query(shapely.points(marks[:, :2]), predicate="within")[0]] = True
    reach = shapely.buffer(shapely.points(marks[:, :2]), marks[:, 3] / 2.0)
    meets = np.zeros(len(footprints), dtype=bool)
    meets[tree.query(reach, predicate="intersects")[1]] = True
    middles = shapely.get_coordinates(shapely.centroid(footprints)).reshape(-1, 2)
    counted = in_windows(middles, corner)
    wings = tree.query(shapely.points(WINGS), predicate="within")[0]
    return {
        "roofs marked": int(inside.sum()),
        "found": round(float(found[inside].mean()), 3),
        f"of {LEAST:g} m² and more": round(float(found[inside & large].mean()), 3),
        "outlines in windows": int(counted.sum()),
        "false": round(float((~meets[counted]).mean()), 3) if counted.any() else None,
        "wings of the school": len(np.unique(wings)),
    }


def main() -> None:
    """Build, judge, print and keep the table."""
    survey = Path(sys.argv[1])
    table = Path(sys.argv[2]) if len(sys.argv) > 2 else Path(__file__).with_name("churo_marks.csv")
    marks = np.loadtxt(table, delimiter=",", skiprows=1)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        subprocess.run([sys.executable, "-m", "eaves", "build", survey, "-o", out], check=True)
        footprints = geopandas.read_file(out / "footprints.gpkg", layer="footprints").geometry.values
    corner = np.array([871075.0, 8503220.0])
    keep(
        "image-marks",
        "A village from drone images, by marks",
        [judge(np.asarray(footprints), marks, corner)],
        f"python -m benchmarks.accuracy.image_marks {survey.name}",
    )


if __name__ == "__main__":
    main()
