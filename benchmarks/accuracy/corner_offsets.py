"""How far corners of Building3D's roofs lie off, by kind of corner, outward and upward; edges of outlines.

Run `EAVES_DATA=... python -m benchmarks.accuracy.corner_offsets`.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import shapely
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist
from shapely.geometry.base import BaseGeometry

from benchmarks.accuracy.models import Drawn, building3d
from benchmarks.table import keep
from eaves.evaluate.wireframes import CORNER_RADIUS, Wireframe
from eaves.formats.obj_wireframe import roof_wireframe
from eaves.reconstruct.arrangement import Arrangement

COMMAND = "python -m benchmarks.accuracy.corner_offsets"

ON_OUTLINE = 0.05
"""Corners of the reference this near (m) to its outline lie on it."""


def plan_of(frame: Wireframe) -> BaseGeometry:
    """What a wireframe covers in plan."""
    lines = shapely.linestrings(frame.corners[frame.edges][:, :, :2])
    cells = shapely.polygonize(shapely.get_parts(shapely.union_all(lines, grid_size=0.001)))
    return shapely.union_all(shapely.get_parts(cells))


def offsets(roof: Drawn) -> Iterator[tuple[str, float, float, float, float]]:
    """Kind, offset, offset in plan, height above and distance outside the reference of paired corners (m)."""
    if roof.model is None:
        return
    mine, true = Wireframe(*roof_wireframe(roof.model)), roof.reference
    distance = cdist(mine.corners, true.corners)
    pairs = np.column_stack(linear_sum_assignment(np.where(distance <= CORNER_RADIUS, distance, 1e6)))
    plan = plan_of(true)
    edges = np.bincount(true.edges.ravel(), minlength=len(true.corners))
    for one, other in pairs[distance[pairs[:, 0], pairs[:, 1]] <= CORNER_RADIUS].tolist():
        east, north, up = (mine.corners[one] - true.corners[other]).tolist()
        place = shapely.Point(mine.corners[one, :2])
        outside = plan.boundary.distance(place) * (-1.0 if plan.contains(place) else 1.0)
        kind = "inside: ridge ends, hips, valleys, objects"
        if plan.boundary.distance(shapely.Point(true.corners[other, :2])) < ON_OUTLINE:
            kind = "outline, two edges" if edges[other] == 2 else "outline, a ridge, valley or step ends"
        yield kind, float(distance[one, other]), float(np.hypot(east, north)), up, outside


def rows(roofs: list[Drawn]) -> Iterator[dict[str, object]]:
    """One row for each half and kind of corner."""
    for half, rest in (("even number", 0), ("odd number", 1)):
        found = [row for roof in roofs if int(roof.name) % 2 == rest for row in offsets(roof)]
        for kind in sorted({row[0] for row in found}):
            table = np.array([row[1:] for row in found if row[0] == kind])
            inner = kind.startswith("inside")
            yield {
                "roofs of": half,
                "corner": kind,
                "pairs": len(table),
                "offset m": float(table[:, 0].mean()),
                "median m": float(np.median(table[:, 0])),
                "over 0.5 m": int((table[:, 0] > 0.5).sum()),
                "in plan m": float(table[:, 1].mean()),
                "median height m": float(np.median(table[:, 2])),
                "median outward m": None if inner else float(np.median(table[:, 3])),
            }


def main() -> None:
    """Print and keep the table."""
    roofs = building3d(Path(os.environ["EAVES_DATA"]), Arrangement())
    note = (
        "Corners as exported, paired one to one within 1 m; kinds by the edges that meet in the reference. "
        "A height above the reference and a distance outside its outline count as positive."
    )
    keep("corner-offsets", "Offsets of corners, Building3D, by kind", list(rows(roofs)), COMMAND, note)


if __name__ == "__main__":
    main()
