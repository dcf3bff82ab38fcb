"""Random footprints and plane sets, most of them unkind."""

from __future__ import annotations

import numpy as np
import shapely
from shapely import Polygon

from eaves.model import Footprint, Points, RoofPlane


def make_footprint(rng: np.random.Generator) -> Polygon:
    """Boxes, L shapes, courtyards that nearly touch the outline, stars, spikes, slivers, rounds; turned
    and moved.
    """
    side = 10 ** rng.uniform(0.3, 1.6)
    kind = int(rng.integers(0, 8))
    if kind == 0:
        shape = shapely.box(0, 0, side, side * rng.uniform(0.2, 1.0))
    elif kind == 1:
        shape = shapely.union(shapely.box(0, 0, side, side / 3), shapely.box(0, 0, side / 3, side))
    elif kind == 2:
        gap = min(float(rng.choice([0.0, 0.001, 0.02, 0.3, 1.0])), side / 3)
        shape = shapely.difference(
            shapely.box(0, 0, side, side), shapely.box(gap, side / 3, side / 2, 2 * side / 3)
        )
    elif kind == 3:
        count = int(rng.integers(3, 25))
        angle, radius = np.sort(rng.uniform(0, 2 * np.pi, count)), side * rng.uniform(0.2, 1.0, count)
        shape = Polygon(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]))
    elif kind == 4:
        spike = shapely.box(-0.5, side / 2, side, side / 2 + float(rng.choice([0.001, 0.01, 0.05])))
        corner = shapely.box(side, side, 2 * side, 2 * side).buffer(float(rng.choice([0.0, 0.001, 0.1])))
        shape = shapely.union_all([shapely.box(0, 0, side, side), corner, spike])
    elif kind == 5:
        diamond = Polygon(
            [(0, side / 2), (side / 4, side / 4), (side / 2, side / 2), (side / 4, 0.75 * side)]
        )
        shape = shapely.difference(shapely.box(0, 0, side, side), diamond)
    elif kind == 6:
        shape = shapely.box(0, 0, side, float(rng.choice([0.02, 0.1, 0.5, 2.0])))
    else:
        shape = shapely.Point(0, 0).buffer(side, quad_segs=int(rng.integers(2, 40)))
    turned = shapely.affinity.rotate(shape, float(rng.choice([0.0, rng.uniform(0, 360)])), origin=(0, 0))
    moved = shapely.make_valid(shapely.affinity.translate(turned, *rng.uniform(-100, 100, 2)))
    parts = [part for part in shapely.get_parts(moved) if part.geom_type == "Polygon"]
    return shapely.orient_polygons(max(parts, key=lambda part: part.area))


def make_planes(rng: np.random.Generator, polygon: Polygon, count: int) -> list[tuple[float, float, float]]:
    """Planes that are coplanar, nearly parallel, steep, far above, under the ground, or ordinary."""
    west, south, east, north = polygon.bounds
    answer: list[tuple[float, float, float]] = []
    for _ in range(count):
        kind = int(rng.integers(0, 7))
        x, y, height = rng.uniform(west, east), rng.uniform(south, north), rng.uniform(1.0, 12.0)
        a, b, c = answer[-1] if answer else (0.0, 0.0, 5.0)
        if kind == 0:
            c += float(rng.choice([0.0, 1e-4, 0.003, 0.02, 0.3]))
        elif kind == 1:
            a, b = a + float(rng.choice([1e-6, 1e-3, 0.02])), b + 0.01 * rng.normal()
        elif kind == 3:
            a, b, c = 0.0, 0.0, height + float(rng.choice([0.0, 100.0]))
        elif kind == 4:
            a, b, c = 0.0, 0.0, -20.0
        else:
            a, b = rng.normal(size=2) * (8.0 if kind == 2 else 0.7)
            c = height - a * x - b * y
        answer.append((float(a), float(b), float(c)))
    return answer


def make_building(seed: int) -> tuple[Points, Footprint, list[RoofPlane], float]:
    """Points, footprint, planes and ground of one unkind building."""
    rng = np.random.default_rng(seed)
    polygon = make_footprint(rng)
    west, south, east, north = polygon.bounds
    count = int(rng.choice([3, 10, 100, 600, 1500]))
    xy = np.column_stack(
        [rng.uniform(west - 0.5, east + 0.5, count), rng.uniform(south - 0.5, north + 0.5, count)]
    )
    planes = make_planes(rng, polygon, int(rng.choice([0, 1, 2, 3, 5, 8, 15])))
    owner = np.zeros(count, np.int64)
    z = rng.uniform(0.0, 9.0, count)
    if planes:
        rise = xy @ np.array(planes)[:, :2].T + np.array(planes)[:, 2]
        seeds = np.column_stack(
            [rng.uniform(west, east, len(planes)), rng.uniform(south, north, len(planes))]
        )
        owner = [
            rng.integers(0, len(planes), count),
            ((xy[:, None] - seeds) ** 2).sum(axis=2).argmin(axis=1),
            rise.argmin(axis=1),
        ][int(rng.integers(0, 3))]
        z = rise[np.arange(count), owner] + rng.normal(size=count) * float(rng.choice([0.0, 0.02, 0.2]))
    points = np.column_stack([xy, z])
    if rng.random() < 0.1:
        points[int(rng.integers(0, count))] = np.nan
    found = [RoofPlane(row, np.flatnonzero(owner == number), 0.0) for number, row in enumerate(planes)]
    return points, Footprint(polygon), found, float(rng.choice([0.0, -3.0, 5.0]))
