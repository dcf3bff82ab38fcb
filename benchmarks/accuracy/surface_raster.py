"""A DSM in place of points, on Delft: python -m benchmarks.accuracy.surface_raster."""

from __future__ import annotations

import os
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pyogrio
import shapely

from benchmarks.table import keep
from eaves.evaluate import evaluate_files
from eaves.pipeline import build

DATA = Path(os.environ.get("EAVES_DATA", "data")) / "delft"
OUTPUTS = ("footprints", "models", "rasters")
COLUMNS = ("area, completeness", "area, correctness", "area, quality")
COMMAND = "python -m benchmarks.accuracy.surface_raster"
NOTE = (
    "AHN3, and the dsm.tif (0.5 m) and dtm.tif that the first row wrote, against the map's polygons, which "
    "are a part of the buildings: correctness is low in all rows. `same` are buildings that overlap one of "
    "the points by more than half; heights and volumes are over theirs."
)


def columns_of(folder: Path) -> tuple[Any, Any, Any]:
    """Outlines, 70th percentile of the roof (m) and volume (m3) of a run's buildings."""
    file = folder / "footprints.gpkg"
    _, _, shapes, known = pyogrio.raw.read(file, layer="footprints", columns=["id", "volume_m3"])
    _, _, _, others = pyogrio.raw.read(file, layer="attributes", columns=["id", "h_70p"])
    heights = dict(zip(others[0], others[1], strict=True))
    return shapely.from_wkb(shapes), np.array([heights.get(one, np.nan) for one in known[0]]), known[1]


def differences(folder: Path, points: Path) -> dict[str, object]:
    """Differences of the buildings of a run from those of the points that are the same."""
    (one, height, volume), (other, height_p, volume_p) = columns_of(folder), columns_of(points)
    a, b = shapely.STRtree(other).query(one, predicate="intersects")
    shared = shapely.area(shapely.intersection(one[a], other[b]))
    same = shared > 0.5 * shapely.area(shapely.union(one[a], other[b]))
    a, b = a[same], b[same]
    off, size = height[a] - height_p[b], volume[a] / volume_p[b]
    return {
        "same": len(a),
        "h_70p, median (m)": round(float(np.nanmedian(off)), 3),
        "h_70p, 90 % within (m)": round(float(np.nanpercentile(np.abs(off), 90)), 3),
        "volume, median": round(float(np.nanmedian(size)), 3),
    }


def main() -> None:
    """Build Delft from its points, from their DSM, and from DSM and DTM; keep the table."""
    rows: list[dict[str, object]] = []
    with TemporaryDirectory() as name:
        points = Path(name) / "points"
        inputs: dict[str, tuple[Path, dict[str, Any]]] = {
            "points": (DATA / "ahn3.laz", {}),
            "dsm": (points / "dsm.tif", {}),
            "dsm and dtm": (points / "dsm.tif", {"dtm": points / "dtm.tif"}),
        }
        for words, (source, options) in inputs.items():
            summary = build(source, Path(name) / words, outputs=OUTPUTS, **options)
            outlines = summary.folder / "footprints.gpkg"
            figures = evaluate_files("detection", outlines, DATA / "footprints.gpkg").figures
            row: dict[str, object] = {
                "input": words,
                "found": summary.found,
                "LoD 2.2": summary.by_lod.get("2.2"),
            }
            row |= {one: round(figures[one], 4) for one in COLUMNS} | differences(summary.folder, points)
            rows.append(row | {level: summary.trust.get(level, 0) for level in ("high", "medium", "low")})
    keep("surface-raster", "Surface rasters", rows, COMMAND, NOTE)


if __name__ == "__main__":
    main()
