"""IoU of class 6 of the tiles of IGN as they lie, turned, mirrored, tilted, and of each tile by itself.

`python -m benchmarks.accuracy.detection_placements`, EAVES_DATA set: by `eaves build`, from points without
classes. A cell of half a metre is what its highest point is; cells without points do not count.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np

from benchmarks.accuracy.ground_placements import placed
from benchmarks.accuracy.late_echoes import Scan, read_scan
from benchmarks.table import keep
from eaves import build
from eaves.model import BUILDING, NOISE_CLASSES

CELL_M = 0.5


def classified(scan: Scan) -> Scan:
    """The scan with the classes (N,) that a build gives it."""
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 0.001), np.floor(scan.xyz.min(axis=0))
    las = laspy.LasData(header)
    las.x, las.y, las.z = scan.xyz.T
    las.return_number, las.number_of_returns = scan.number, scan.count
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "points.laz"
        las.write(path)
        build(path, Path(folder) / "out", lod="0", outputs=("classified",), crs=f"EPSG:{scan.epsg}")
        found = np.asarray(laspy.read(Path(folder) / "out" / "classified.laz").classification)
    return replace(scan, classes=found)


def iou(found: Scan, scan: Scan) -> float:
    """IoU of class 6 of a classified scan with its true classes."""
    counted = ~np.isin(scan.classes, NOISE_CLASSES)
    xyz, true, ours = scan.xyz[counted], scan.classes[counted] == BUILDING, found.classes[counted] == BUILDING
    column, row = np.floor((xyz[:, :2] - xyz[:, :2].min(axis=0)) / CELL_M).astype(np.int64).T
    cell = row * (column.max() + 1) + column
    order = np.lexsort((-xyz[:, 2], cell))
    top = order[np.r_[True, np.diff(cell[order]) > 0]]
    return float((true & ours)[top].sum() / (true | ours)[top].sum())


def joined(tiles: Sequence[Scan]) -> Scan:
    """The tiles as one scan."""
    fields = {
        name: np.concatenate([getattr(tile, name) for tile in tiles])
        for name in ("xyz", "classes", "number", "count", "pit")
    }
    return replace(tiles[0], name="ign_urban", **fields)


def main() -> None:
    """Print and keep the table."""
    folder = Path(os.environ["EAVES_DATA"]) / "ign_urban"
    tiles = [read_scan(path, path.stem[10:22]) for path in sorted(folder.glob("*.laz"))]
    every = placed(joined(tiles))
    found = {name: classified(scan) for name, scan in every.items()}
    rows: list[dict[str, object]] = [
        {"survey": "four tiles as one", "placement": name, "IoU of class 6": iou(found[name], scan)}
        for name, scan in every.items()
    ]
    parts = np.split(next(iter(found.values())).classes, np.cumsum([len(tile.xyz) for tile in tiles])[:-1])
    for tile, classes in zip(tiles, parts, strict=True):
        for place, one in (("by itself", classified(tile)), ("of the four", replace(tile, classes=classes))):
            rows.append({"survey": tile.name, "placement": place, "IoU of class 6": iou(one, tile)})
    note = "By `eaves build` from points without classes; the truth is IGN's classification."
    command = "python -m benchmarks.accuracy.detection_placements"
    keep("detection-placements", "Detection: tiles turned, mirrored and alone", rows, command, note)


if __name__ == "__main__":
    main()
