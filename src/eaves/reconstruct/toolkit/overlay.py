"""The snap-rounded arrangement of line segments inside a polygon."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from eaves.geometry.tolerance import COORDINATE_STEP
from eaves.reconstruct.toolkit.coverage import Coverage, coverage_of

NARROWEST_NECK = 0.03
"""Parts of a footprint held together or apart by less than this (m) touch, for all that can be built."""

SMALLEST_PART = 0.1
"""Parts of a footprint smaller than this (m²) are not parts."""

MOST_CUTS = 20
"""Necks cut through one by one, where corners of a footprint touch."""

CORNER_REACH = 0.03
"""A segment that passes a corner of the polygon nearer than this (m) goes through it."""


def arrange(
    polygon: Polygon, segments: NDArray[np.float64], grid: float = COORDINATE_STEP
) -> Coverage | None:
    """The cells that segments (S, 4: x, y, x, y) cut a polygon into, nodes on the grid (m).

    Ends that hang free cut nothing. Necks and gaps narrower than `NARROWEST_NECK` are parted and filled
    first. None when the polygon has no area on the grid.
    """
    whole = without_necks(shapely.set_precision(polygon, grid), grid)
    if whole.is_empty:
        return None
    if len(segments) == 0:
        return coverage_of(shapely.get_parts(whole), grid)
    lines = through_corners(np.asarray(segments, float), shapely.get_coordinates(whole))
    net = shapely.union_all(np.append(lines, whole.boundary), grid_size=grid)
    cells = shapely.get_parts(shapely.polygonize([net]))
    if len(cells) == 0:
        return None
    shapely.prepare(whole)
    inside = shapely.contains_properly(whole, shapely.point_on_surface(cells))
    return coverage_of(cells[inside], grid) if inside.any() else None


def through_corners(segments: NDArray[np.float64], corners: NDArray[np.float64]) -> NDArray[np.object_]:
    """The segments (S, 4) as lines that bend through the corners (K, 2) they would nearly touch."""
    ends = segments.reshape(-1, 2, 2)
    lines = np.asarray(shapely.linestrings(ends), object)
    tree = shapely.STRtree(shapely.points(corners))
    number, corner = tree.query(lines, predicate="dwithin", distance=CORNER_REACH)
    step = ends[number, 1] - ends[number, 0]
    length = np.maximum(np.hypot(step[:, 0], step[:, 1]), COORDINATE_STEP)
    along = ((corners[corner] - ends[number, 0]) * step).sum(axis=1) / length**2
    between = (along > 0.0) & (along < 1.0)
    order = np.lexsort((corner, along, number))
    order = order[between[order]]
    number, corner = number[order], corner[order]
    used, first = np.unique(number, return_index=True)
    for line, some in zip(used.tolist(), np.split(corner, first[1:]), strict=False):
        lines[line] = shapely.linestrings(np.vstack([ends[line, :1], corners[some], ends[line, 1:]]))
    return lines


def without_necks(polygon: BaseGeometry, grid: float) -> BaseGeometry:
    """The polygonal shape, parted at necks and with clefts filled where they are too narrow to be built.

    A shape that is nowhere so narrow comes back as it is.
    """
    if shapely.minimum_clearance(polygon) < NARROWEST_NECK:
        reach = 0.5 * NARROWEST_NECK
        for distance in (reach, -2.0 * reach, reach):
            polygon = shapely.buffer(polygon, distance, join_style="mitre", mitre_limit=3.0)
        polygon = shapely.set_precision(polygon, grid)
    for _ in range(MOST_CUTS):
        if shapely.minimum_clearance(polygon) >= 0.5 * NARROWEST_NECK:
            break
        neck = shapely.buffer(shapely.minimum_clearance_line(polygon), NARROWEST_NECK, cap_style="square")
        polygon = shapely.set_precision(shapely.difference(polygon, neck), grid)
    parts = [
        part
        for part in shapely.get_parts(polygon)
        if part.geom_type == "Polygon" and part.area > SMALLEST_PART
    ]
    return shapely.MultiPolygon(parts)
