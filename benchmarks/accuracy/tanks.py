"""Tanks and silos: how often a round plan is drawn round, and how often another one is taken for a circle.

Run `python -m benchmarks.accuracy.tanks`.
"""

from __future__ import annotations

import numpy as np
import shapely
from shapely import Polygon, affinity

from benchmarks.table import keep
from eaves.model import Boundary, Footprint
from eaves.outline import regularise_outlines, trace_outline

SEEDS, NOISE, ROUND = 12, 0.03, 24
"""Plans of each sort, noise in plan (m), and the fewest corners of a circle."""
REACHES, DENSITIES = (1.5, 2.5, 4.0, 8.0, 16.0), (2.0, 4.0, 10.0)
"""Radius of the circle (m) of a plan's size, and points/m²."""
SIDES = {"tank": 256, "square": 4, "hexagon": 6, "octagon": 8}


def plan_of(sides: int, reach: float, turn: float) -> Polygon:
    """A regular polygon of so many sides with corners at a distance (m) from its middle."""
    angle = 2.0 * np.pi * np.arange(sides) / sides
    return affinity.rotate(Polygon(reach * np.column_stack([np.cos(angle), np.sin(angle)])), turn)


def drawn(plan: Polygon, density: float, seed: int) -> Polygon | None:
    """The outline drawn from points at random on a plan; None where none is."""
    rng = np.random.default_rng(seed)
    west, south, east, north = plan.bounds
    count = rng.poisson(density * (east - west) * (north - south))
    xy = rng.uniform([west, south], [east, north], (count, 2))
    xy = xy[shapely.contains_xy(plan, xy)]
    points = np.column_stack([xy + rng.normal(0.0, NOISE, xy.shape), np.full(len(xy), 9.0)])
    boundary = trace_outline(points, density**-0.5) if len(points) else None
    found = regularise_outlines([boundary])[0] if isinstance(boundary, Boundary) else None
    return found.polygon if isinstance(found, Footprint) else None


def row_of(sort: str, reach: float) -> dict[str, object]:
    """How often plans of a sort and size are drawn round, and their mean IoU, by density."""
    row: dict[str, object] = {"plan": sort, "reach (m)": reach}
    for density in DENSITIES:
        plans = [plan_of(SIDES[sort], reach, 7.0 * seed) for seed in range(SEEDS)]
        pairs = [(plan, drawn(plan, density, seed)) for seed, plan in enumerate(plans)]
        iou = [
            0.0 if got is None else got.intersection(plan).area / got.union(plan).area for plan, got in pairs
        ]
        rounds = [got is not None and len(got.exterior.coords) > ROUND for _, got in pairs]
        row[f"{density:g}/m²: round"] = round(float(np.mean(rounds)), 2)
        row[f"{density:g}/m²: IoU"] = round(float(np.mean(iou)), 3)
    return row


def main() -> None:
    """Print and keep the table."""
    rows = [row_of(sort, reach) for sort in SIDES for reach in REACHES]
    note = (
        "Points at random on regular polygons, outline by the defaults. Nothing was chosen on them: a circle "
        "costs as much as the corners of a rectangle."
    )
    keep("tanks", "Tanks, and what is taken for one", rows, "python -m benchmarks.accuracy.tanks", note)


if __name__ == "__main__":
    main()
