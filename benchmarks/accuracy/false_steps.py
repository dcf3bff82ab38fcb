"""False steps: how often two neighbours of one block differ by a few centimetres along their party wall.

Run `python -m benchmarks.accuracy.false_steps RUN`. Places lie `EVERY` apart along the common borders of the
buildings of a block. At each the roofs of both are read on their own side of the wall, `BESIDE` from it, and
carried on to the wall by their planes. A difference of 1 to 10 cm is a step that no one built.
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.figures.attributes import surface_heights
from eaves.formats.models.cityjson_read import read_models
from eaves.geometry.face_table import FaceTable
from eaves.model import ROOF_SURFACE, BuildingModel

EVERY, BESIDE, TOUCHING = 0.25, 0.05, 0.02
"""Metres between places, from a wall, and between borders that are one."""
LOW, HIGH = 0.01, 0.10
"""Heights (m) between which a step is false."""

Values = NDArray[np.float64]


def wall_places(first: shapely.Polygon, second: shapely.Polygon) -> Iterator[tuple[Values, Values]]:
    """Places (K, 2) along the borders that two outlines share, and the way (2,) from the first across."""
    common = shapely.intersection(first.exterior.buffer(TOUCHING), second.boundary)
    for line in shapely.get_parts(shapely.line_merge(common)):
        corners = shapely.get_coordinates(line)
        for a, b in pairwise(corners):
            length = float(np.hypot(*(b - a)))
            along = np.arange(0.5 * EVERY, length, EVERY)
            if not len(along):
                continue
            across = np.array([b[1] - a[1], a[0] - b[0]]) / length
            middle = 0.5 * (a + b)
            inside = first.distance(shapely.Point(middle + BESIDE * across)) < BESIDE / 2
            yield a + along[:, None] / length * (b - a), -across if inside else across


def heights_at(model: BuildingModel, places: Values, inward: Values) -> Values:
    """Heights (K,) of a model's roof at places (K, 2), by the faces that lie `BESIDE` along `inward`."""
    solids = model.solids[model.lod]
    face = surface_heights(solids, places + BESIDE * inward)[2]
    planes = FaceTable.of_solids(solids, ROOF_SURFACE).planes
    a, b, c = np.vstack([planes, np.full(3, np.nan)])[face].T
    return a * places[:, 0] + b * places[:, 1] + c


def wall_steps(models: list[BuildingModel]) -> Values:
    """Height differences (K,) along the party walls of the models of one block."""
    origin = np.array(models[0].footprint.origin)
    shift = [np.array(model.footprint.origin) - origin for model in models]
    outlines = [
        shapely.transform(model.footprint.polygon, lambda xy, by=by: xy + by)
        for model, by in zip(models, shift, strict=True)
    ]
    steps = []
    for i, j in sorted(zip(*shapely.STRtree(outlines).query(outlines, "dwithin", TOUCHING), strict=True)):
        if i >= j:
            continue
        for places, across in wall_places(outlines[i], outlines[j]):
            one = heights_at(models[i], places - shift[i], -across)
            other = heights_at(models[j], places - shift[j], across)
            steps.append(np.abs(one - other))
    return np.concatenate([np.zeros(0), *steps])


def figures(run: Path) -> dict[str, float]:
    """Places along the party walls of a run, and the shares of them with false and with no steps."""
    blocks = defaultdict(list)
    for file in sorted(run.rglob("buildings.city.jsonl")):
        for model in read_models(file):
            if isinstance(model, BuildingModel) and model.solids:
                blocks[model.attributes.get("block_id")].append(model)
    steps = np.concatenate([wall_steps(block) for block in blocks.values() if len(block) > 1])
    steps = steps[np.isfinite(steps)]
    false = (steps >= LOW) & (steps < HIGH)
    return {
        "places": len(steps),
        "false_steps": round(float(false.mean()), 4),
        "under_1_cm": round(float((steps < LOW).mean()), 4),
        "over_10_cm": round(float((steps >= HIGH).mean()), 4),
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path)
    print(json.dumps(figures(parser.parse_args().run)))
