"""Curved and very large roofs: the facets that stand for a surface, how far off they are, what they cost.

Run `python -m benchmarks.accuracy.curved`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from benchmarks.table import keep
from eaves.figures.attributes import surface_heights
from eaves.geometry.neighbours import measure_spacing
from eaves.model import BuildingModel, Footprint, Values
from eaves.reconstruct import reconstruct_building
from eaves.roof import segment_roof
from eaves.validate.models import validate_model

COMMAND = "python -m benchmarks.accuracy.curved"
NOISE, GRID = 0.02, 0.25
"""Noise of the points' heights (m), and the step (m) of the places at which roof and truth are compared."""

TURN_DEG = 17.0


@dataclass(frozen=True)
class Shape:
    """A roof of which everything is known: its plan and its height (m) over x, y; and its true planes."""

    name: str
    plan: shapely.Polygon
    height: Callable[[Values, Values], Values]
    planes: str
    densities: tuple[float, ...] = (4.0, 10.0, 30.0)


def saw_teeth(x: Values, y: Values) -> Values:
    """Teeth 5 m deep and 20 m wide, each with a steep and a flat side, 2 cm higher from one to the next."""
    bay, row = np.floor(x / 20.0), np.floor(y / 5.0)
    across = y - 5.0 * row
    rise = np.minimum(0.4 * across, 1.7 * (5.0 - across))
    return np.asarray(9.0 + rise + 0.9 * np.mod(bay, 2.0) + 0.02 * row)


def shapes() -> list[Shape]:
    """Vaults, domes, cones, towers, stands and halls."""
    disc = shapely.Point(0.0, 0.0).buffer(8.0, quad_segs=24)
    ring = shapely.Point(0.0, 0.0).buffer(50.0, quad_segs=48) - shapely.Point(0.0, 0.0).buffer(
        35.0, quad_segs=48
    )
    stand = shapely.intersection(ring, shapely.box(-60.0, 0.0, 60.0, 60.0))
    return [
        Shape(
            "barrel vault, 40 × 16 m",
            shapely.box(-20, -8, 20, 8),
            lambda x, y: np.sqrt(100.0 - y**2),
            "curved",
        ),
        Shape("dome, 16 m wide", disc, lambda x, y: 6.0 + 0.8 * np.sqrt(100.0 - x**2 - y**2), "curved"),
        Shape("cone, 16 m wide", disc, lambda x, y: 14.0 - 0.9 * np.hypot(x, y), "curved"),
        Shape(
            "spire of eight sides on a tower",
            shapely.box(-4, -4, 4, 4),
            lambda x, y: 20.0 - 2.0 * np.maximum(np.maximum(abs(x), abs(y)), 0.7071 * (abs(x) + abs(y))),
            "8",
        ),
        Shape(
            "stand of a stadium, half a ring",
            stand,
            lambda x, y: 4.0 + 0.5 * (np.hypot(x, y) - 35.0),
            "curved",
        ),
        Shape("saw-tooth hall, 300 × 100 m", shapely.box(0, 0, 300, 100), saw_teeth, "600", (4.0, 10.0)),
        Shape(
            "hall of 900 bays, 30,000 m²",
            shapely.box(0, 0, 300, 100),
            lambda x, y: 8.0 + 0.35 * np.mod(7.0 * np.floor(x / 8.34) + 5.0 * np.floor(y / 4.0), 11.0),
            "900",
            (4.0, 10.0),
        ),
    ]


def row_of(shape: Shape, density: float) -> dict[str, object]:
    """The model of one roof against its truth."""
    rng = np.random.default_rng([int(density), len(shape.name)])
    west, south, east, north = shape.plan.bounds
    xy = rng.uniform([west, south], [east, north], (int(density * (east - west) * (north - south)), 2))
    xy = xy[shapely.contains_xy(shape.plan, xy[:, 0], xy[:, 1])]
    z = shape.height(*xy.T) + rng.normal(0.0, NOISE, len(xy))
    points = np.column_stack([turned(xy), z])
    outline = shapely.set_precision(shapely.affinity.rotate(shape.plan, TURN_DEG, origin=(0, 0)), 0.001)
    footprint = Footprint(shapely.orient_polygons(outline))
    start = time.process_time()
    planes = segment_roof(points, measure_spacing(points))
    middle = time.process_time()
    model = reconstruct_building(points, footprint, planes, -5.0)
    end = time.process_time()
    assert isinstance(model, BuildingModel)
    grid = np.stack(np.meshgrid(np.arange(west, east, GRID), np.arange(south, north, GRID)), axis=-1)
    places = grid.reshape(-1, 2) + 0.11
    places = places[shapely.contains_xy(shape.plan, places[:, 0], places[:, 1])]
    height, cosine, _ = surface_heights(model.solids[model.lod], turned(places))
    away = np.abs(height - shape.height(*places.T)) * cosine
    away = np.where(np.isfinite(away), away, 9.0)
    return {
        "roof": shape.name,
        "points/m²": density,
        "points": len(points),
        "LoD": model.lod,
        "valid": not validate_model(model),
        "true planes": shape.planes,
        "faces": model.attributes["roof_face_count"],
        "off by, median m": float(np.median(away)),
        "95 %": float(np.percentile(away, 95.0)),
        "within 0.2 m": float(np.mean(away < 0.2)),
        "segmented s": middle - start,
        "modelled s": end - middle,
    }


def turned(xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Places (N, 2) turned about the origin."""
    cosine, sine = float(np.cos(np.radians(TURN_DEG))), float(np.sin(np.radians(TURN_DEG)))
    return np.asarray(xy @ np.array([[cosine, sine], [-sine, cosine]]))


def main() -> None:
    """Print and keep the table."""
    row_of(shapes()[1], 4.0)  # what is compiled at the first call is compiled here
    rows = [row_of(shape, density) for shape in shapes() for density in shape.densities]
    note = (
        "Exact surfaces, points at random, 2 cm of noise, true outline; distances along the face's normal at "
        "places 0.25 m apart. Seconds of processor time."
    )
    keep("curved", "Curved and very large roofs", rows, COMMAND, note)


if __name__ == "__main__":
    main()
