"""Draws each published system step by step on real data: `EAVES_DATA=... python -m docs.source_pictures`."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from docs.pictures import MARGIN_SHARE, RUNS, draw, drawable, range_of
from docs.scenes import Scenery
from PIL import Image

from eaves.detect import detect_buildings
from eaves.formats import read
from eaves.ground import classify_ground
from eaves.methods import resolve_method
from eaves.model import Failure, Footprint
from eaves.outline import regularise_outlines, trace_outline
from eaves.raster.surfaces import make_scene
from eaves.recipe.sources import SOURCES, PublishedSource
from eaves.roof import segment_roof

FOLDER = Path(__file__).parent / "images" / "sources"
SETS = {"vaihingen": "vaihingen/clip3.laz", "delft": "delft/ahn3.laz"}
SIDE = 90.0
"""Of a larger set the square of this side (m) in its middle is drawn."""
PANEL_INCHES, DOTS_AN_INCH, COLUMNS, COLOURS = 2.4, 90, 4, 64
STAGES = ("ground", "detect", "outline", "roof", "reconstruct")


def make_real_scenery(source: PublishedSource, place: Path) -> Scenery:
    """A real scene with the source's own ground, and its largest building before its model."""
    methods: dict[str, Any] = {stage: resolve_method(stage, source.methods.get(stage)) for stage in STAGES}
    cloud = read(place).with_(classification=None).in_canonical_order()
    middle = np.median(cloud.xyz[:, :2], axis=0)
    cloud = cloud.take((np.abs(cloud.xyz[:, :2] - middle) <= SIDE / 2.0).all(axis=1))
    cloud = classify_ground(cloud, methods["ground"])
    scene = make_scene(cloud, cloud.bounds)
    regions = detect_buildings(scene, methods["detect"])
    size = np.bincount(regions.label)
    size[0] = 0
    house = cloud.xyz[regions.label == int(size.argmax())]
    boundary = trace_outline(house, scene.spacing, methods["outline"])
    drawn = None if isinstance(boundary, Failure) else regularise_outlines([boundary], methods["outline"])[0]
    footprint = drawn if isinstance(drawn, Footprint) else Footprint(cloud_hull(house))
    planes = tuple(segment_roof(house, scene.spacing, methods["roof"]))
    return Scenery(cloud, scene, house, footprint, planes, float(np.nanmin(scene.dtm.at(house))))


def cloud_hull(house: np.ndarray[Any, Any]) -> Any:
    """The hull of points (N, 3)."""
    import shapely

    return shapely.MultiPoint(house[:, :2]).convex_hull


def draw_source(source: PublishedSource, scenery: Scenery, path: Path) -> None:
    """All steps of a source, stage by stage, in one picture."""
    import matplotlib.pyplot as plt

    panels: list[tuple[str, Any, Any]] = []
    for stage in (stage for stage in STAGES if stage in source.methods):
        steps: list[tuple[str, Any]] = []
        method = resolve_method(stage, source.methods[stage])
        points, answer = RUNS[stage](method, scenery, lambda name, value, to=steps: to.append((name, value)))
        panels += [
            (f"{stage}: {name}", value, points)
            for name, value in [*steps, ("answer", answer)]
            if drawable(value, points)
        ]
    rows = -(-len(panels) // COLUMNS)
    size = (PANEL_INCHES * COLUMNS, PANEL_INCHES * 1.12 * rows)
    figure, axes = plt.subplots(rows, COLUMNS, figsize=size, squeeze=False, layout="constrained")
    for panel in axes.ravel():
        panel.set_axis_off()
    for number, (panel, (name, value, points)) in enumerate(zip(axes.ravel(), panels, strict=False), 1):
        panel.margins(MARGIN_SHARE)
        draw(panel, value, points)
        panel.set_title(f"{number}. {name}{range_of(value, points)}", fontsize=7)
        panel.set(aspect="equal")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=DOTS_AN_INCH, metadata={"Software": None})
    plt.close(figure)
    Image.open(path).convert("RGB").quantize(COLOURS).save(path, optimize=True)


def main() -> None:
    """Draw the sources asked for, or all, on every set."""
    matplotlib.use("Agg")
    for name in sys.argv[1:] or SOURCES:
        for label, place in SETS.items():
            source = SOURCES[name]
            scenery = make_real_scenery(source, Path(os.environ["EAVES_DATA"]) / place)
            path = FOLDER / f"{name}-{label}.png"
            draw_source(source, scenery, path)
            sys.stdout.write(f"{path.name} {path.stat().st_size // 1000} kB\n")


if __name__ == "__main__":
    main()
