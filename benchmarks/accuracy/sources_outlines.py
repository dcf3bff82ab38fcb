"""How much of the outlines of xiao2014 is the boundary as traced, not its straight segments.

Run `EAVES_DATA=... python -m benchmarks.accuracy.sources_outlines`.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import shapely
from shapely import Polygon

from benchmarks.accuracy.detection import read
from benchmarks.table import keep
from eaves.detect import detect_buildings
from eaves.ground import classify_ground
from eaves.model import Boundary, Failure
from eaves.outline import regularise_outlines, trace_outline
from eaves.raster.surfaces import make_scene
from eaves.recipe.recipe import make_recipe

COMMAND = "python -m benchmarks.accuracy.sources_outlines"
SETS = {
    "delft": "delft/ahn3.laz",
    "ign_urban": "ign_urban/*.laz",
    "amsterdam": "ahn3_ground/Amsterdam*.las",
    "williams": "williams/williams.laz",
}
ON = 0.005
"""A piece of an outline this near (m) to the traced boundary is the boundary: segments turn away from it."""


def outlines_of(files: list[Path], published: bool) -> Iterator[tuple[Boundary, Polygon]]:
    """The boundary and the outline of every region of the chain, in one piece."""
    recipe = make_recipe(source="xiao2014", published=published)
    assert recipe.detect is not None
    cloud = classify_ground(read(files)[0], recipe.ground)
    scene = make_scene(cloud, cloud.bounds)
    regions = detect_buildings(scene, recipe.detect)
    for label in range(1, regions.count + 1):
        points = scene.cloud.xyz[regions.label == label]
        part = recipe.outline.parts(points, scene.spacing)
        for number in range(int(part.max(initial=-1)) + 1):
            boundary = trace_outline(points[part == number], scene.spacing, recipe.outline)
            outline = regularise_outlines(boundary, recipe.outline)
            if not (isinstance(boundary, Failure) or isinstance(outline, Failure)):
                yield boundary, outline.polygon


def traced_length(boundary: Boundary, outline: Polygon) -> float:
    """Length (m) of an outline that lies on its boundary as traced."""
    traced = Polygon(boundary.rings[0], boundary.rings[1:]).simplify(boundary.spacing)
    return float(outline.boundary.intersection(shapely.buffer(traced.boundary, ON)).length)


def row_of(name: str, files: list[Path], published: bool) -> dict[str, object]:
    """Shares over all outlines of a set."""
    found = list(outlines_of(files, published))
    length = np.array([outline.length for _, outline in found])
    area = np.array([outline.area for _, outline in found])
    traced = np.array([traced_length(*one) for one in found])
    some = traced > 1.0
    return {
        "data": name,
        "chain": "xiao2014" + (", as published" if published else ""),
        "outlines": len(found),
        "length as traced": round(float(traced.sum() / length.sum()), 4),
        "length, were it all or nothing": round(float(length[some].sum() / length.sum()), 4),
        "area with a stretch as traced": round(float(area[some].sum() / area.sum()), 4),
        "outlines wholly traced": int((traced > 0.9 * length).sum()),
    }


def main() -> None:
    """Print and keep the table."""
    data = Path(os.environ["EAVES_DATA"])
    rows = []
    for name, pattern in SETS.items():
        for published in (False, True):
            rows.append(row_of(name, sorted(data.glob(pattern)), published))
            print(rows[-1], flush=True)
    keep("sources-outlines", "Traced", rows, COMMAND, NOTE)


NOTE = f"""Regions of points without classes, in one piece, in memory. As traced: within {ON:g} m of the
boundary of the alpha shape, which the segments left farther outside than a corner. Were it all or
nothing: all outlines with over 1 m of it, which the rule before left whole as traced."""


if __name__ == "__main__":
    main()
