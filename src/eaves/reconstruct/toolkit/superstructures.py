"""What stands on a roof and is too small for a face of its own: chimneys, dormers, plant, lift housings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from shapely import Polygon

from eaves.geometry.components import connected_groups_kernel
from eaves.model import Installation, Points, Solid, Values
from eaves.reconstruct.toolkit.attributes import Surface, surface_heights
from eaves.reconstruct.toolkit.plan_lines import main_directions

TOGETHER = 1.6
"""Points of one object have another this many spacings away or nearer."""

LEVEL = 0.35
"""Points this near (m) to the top of an object lie on it; a chimney's pots stand out by less."""

LEAST_INSIDE = 0.8
"""Share of an object's outline inside the footprint."""

LEAST_ON_TOP = 0.5
"""Share of an object's points on its top: the points of a crown are strewn over its height."""

LARGEST = 6.0
"""Objects larger than this (m²) are parts of the roof that it lacks, not objects on it."""

HIGHEST = 6.0
"""Objects higher than this (m) over the roof are crowns, masts and cranes."""

BESIDE, LEAST_BESIDE_M, MOST_BESIDE_M = 1.5, 0.2, 0.5
"""Points that the roof within so many spacings, from least to most metres, explains lie where a border is
drawn a little off; farther up a slope the roof would explain an object, too."""

FLAT = 0.18
"""Rise per metre under which a roof is flat (10°): plant and lift housings stand on it, else chimneys and
dormers."""

CHIMNEY_M2, LIFT_HOUSING_M = 1.5, 1.6
"""A chimney is at most so large; a lift housing at least so high."""


def find_superstructures(
    solids: tuple[Solid, ...],
    roof: Points,
    surface: Surface | None,
    polygon: Polygon,
    spacing: float,
    least_points: int,
    least_height: float,
) -> tuple[Installation, ...]:
    """The objects that roof points (N, 3) show above the model, largest first.

    Points higher over the roof than `least_height` (m) stand together where they are near in plan. An object
    has `least_points` of them, most on one level, is no wider strip along a border of the roof, and no crown.
    Its outline is the rectangle along the building's main direction, wider than its points by half a spacing.
    """
    height, _, _ = surface or surface_heights(solids, roof[:, :2])
    over = roof[:, 2] - height
    high = np.flatnonzero((over > least_height) & (over < HIGHEST))
    main = main_directions(polygon)
    if len(high) < least_points or len(main) == 0:
        return ()
    pairs = cKDTree(roof[high, :2]).query_pairs(TOGETHER * spacing, output_type="ndarray")
    group = connected_groups_kernel(pairs[:, 0], pairs[:, 1], len(high))
    sizes = np.bincount(group)
    found = []
    for number in np.flatnonzero(sizes >= least_points).tolist():
        mine = high[group == number]
        one = describe_object(solids, roof[mine], over[mine], float(main[0]), spacing, least_height)
        if one is not None and one.polygon.intersection(polygon).area > LEAST_INSIDE * one.polygon.area:
            found.append(one)
    return tuple(sorted(found, key=lambda one: (-one.polygon.area, one.polygon.centroid.x)))


def describe_object(
    solids: tuple[Solid, ...],
    points: Points,
    over: Values,
    angle: float,
    spacing: float,
    least_height: float,
) -> Installation | None:
    """The object that points (N, 3), so far `over` the roof (N,; m), make; None when they make none."""
    top = float(np.percentile(points[:, 2], 75.0))
    if np.mean(np.abs(points[:, 2] - top) < LEVEL + 0.5 * np.ptp(over)) < LEAST_ON_TOP:
        return None
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    local = points[:, :2] @ turn
    low, high = local.min(axis=0) - 0.5 * spacing, local.max(axis=0) + 0.5 * spacing
    sides = np.sort(high - low)
    filled = len(points) * spacing**2 / float(np.prod(sides))
    if np.prod(sides) > LARGEST or filled < 0.4 or sides[0] < 1.5 * spacing or sides[1] > 5.0 * sides[0]:
        return None
    if explained_beside(solids, points, float(np.clip(BESIDE * spacing, LEAST_BESIDE_M, MOST_BESIDE_M))):
        return None
    ring = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    corners = np.vstack([ring, ring.mean(axis=0)]) @ turn.T
    under, cosine, _ = surface_heights(solids, corners)
    if not np.isfinite(under[-1]):
        return None
    base = float(np.nanmin(under))
    rise = float(np.sqrt(max(1.0 / cosine[-1] ** 2 - 1.0, 0.0)))
    area, above = float(np.prod(sides)), float(np.median(over))
    if above < least_height or top - base < least_height:
        return None
    if rise < FLAT:
        kind = "lift_housing" if area > 2.0 and above >= LIFT_HOUSING_M else "plant"
        kind = "chimney" if area <= CHIMNEY_M2 and above >= 0.8 and sides[1] < 2.0 * sides[0] else kind
    else:
        kind = "chimney" if area <= CHIMNEY_M2 else "dormer"
    return Installation(kind, Polygon(corners[:-1]), base, top, above, len(points))


def explained_beside(solids: tuple[Solid, ...], points: Points, beside: float) -> bool:
    """Whether the roof within `beside` (m) explains most of the points (N, 3): its border is a little off."""
    ways = beside * np.array(
        [[1, 0], [0, 1], [-1, 0], [0, -1], [0.7, 0.7], [-0.7, 0.7], [-0.7, -0.7], [0.7, -0.7]]
    )
    places: NDArray[np.float64] = (points[:, None, :2] + ways[None]).reshape(-1, 2)
    height = surface_heights(solids, places)[0].reshape(len(points), len(ways))
    near = np.abs(np.nan_to_num(height, nan=-1e9) - points[:, 2:3]) < LEVEL
    return bool(np.mean(near.any(axis=1)) > 0.5)
