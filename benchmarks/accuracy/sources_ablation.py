"""What each step of the five published detectors is worth: IoU without it, on real sets.

Run `EAVES_DATA=... python -m benchmarks.accuracy.sources_ablation`.
"""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy.detection import rates, read, top_of_cells
from benchmarks.table import keep
from eaves.detect import Detector, detect_buildings
from eaves.ground import GroundMethod, classify_ground
from eaves.methods import resolve_method
from eaves.model import PointCloud, Scene
from eaves.model.cloud import BUILDING
from eaves.raster.surfaces import make_scene
from eaves.recipe.recipe import sources

COMMAND = "python -m benchmarks.accuracy.sources_ablation"
SETS = {"delft": "delft/ahn3.laz", "ign_urban": "ign_urban/*.laz", "wooded hill": "misc/lidR_Topography.laz"}
EMPTY = ("wooded hill",)
"""Sets without any building: regions found are counted."""


@cache
def cloud_of(name: str) -> tuple[PointCloud, NDArray[np.uint8]]:
    """The points of a set without their classes, and the classes."""
    return read(sorted(Path(os.environ["EAVES_DATA"]).glob(SETS[name])))


@cache
def scene_of(name: str, ground: GroundMethod) -> Scene:
    """The scene of a set on a ground filter."""
    cloud = classify_ground(cloud_of(name)[0], ground)
    return make_scene(cloud, cloud.bounds)


def score(name: str, ground: GroundMethod, detector: Detector) -> tuple[NDArray[np.bool_], float]:
    """The building points (N,), and the IoU of cells, or how many regions there are where none should be."""
    scene = scene_of(name, ground)
    regions = detect_buildings(scene, detector)
    got = regions.label > 0
    if name in EMPTY:
        return got, float(regions.count)
    top = top_of_cells(scene.cloud.xyz + [*scene.cloud.origin, 0.0])
    return got, rates(got[top], cloud_of(name)[1][top] == BUILDING)[2]


def main() -> None:
    """Print and keep the table."""
    rows: list[dict[str, object]] = []
    for source in sources().values():
        for where, step, off in (("", "nothing", {}), *source.steps):
            made = {
                stage: resolve_method(
                    stage, {"method": source.methods[stage], **(off if where == stage else {})}
                )
                for stage in ("ground", "detect")
            }
            plain = {stage: resolve_method(stage, source.methods[stage]) for stage in ("ground", "detect")}
            row: dict[str, object] = {"source": source.name, "without": step}
            for name in SETS:
                got, value = score(name, made["ground"], made["detect"])  # type: ignore[arg-type]
                whole, _ = score(name, plain["ground"], plain["detect"])  # type: ignore[arg-type]
                row[name] = f"{value:.0f} false" if name in EMPTY else round(value, 4)
                row[f"{name}: points changed"] = int((got != whole).sum())
            print(row, flush=True)
            rows.append(row)
    keep("sources-ablation", "Published detectors without a step", rows, COMMAND, NOTE)


NOTE = """IoU of building cells (0.5 m, a cell being its highest point) against class 6; on the wooded hill
the number of buildings found, of which none is there. A step is left out by the parameters that
its method declares for it; all else stays derived."""


if __name__ == "__main__":
    main()
