"""What stands on a roof and is too small for a face of its own: chimneys, dormers, plant, lift housings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from shapely import Polygon

from eaves.geometry.components import connected_groups_kernel
from eaves.model import Installation, Points, Solid, Values
from eaves.reconstruct.toolkit.attributes import Surface, surface_heights
from eaves.reconstruct.toolkit.plan_lines import main_directions


@dataclass(frozen=True)
class ObjectLimits:
    """What makes an object on a roof; parameters of the method, which says what each means."""

    points: int
    height: float
    together: float
    level: float
    inside: float
    on_top: float
    least: float
    largest: float
    highest: float
    beside: float
    least_beside: float
    most_beside: float
    flat: float
    chimney: float
    lift_housing: float


def find_superstructures(
    solids: tuple[Solid, ...],
    roof: Points,
    surface: Surface | None,
    polygon: Polygon,
    spacing: float,
    limits: ObjectLimits,
) -> tuple[Installation, ...]:
    """The objects that roof points (N, 3) show above the model, largest first.

    Points higher over the roof than `limits.height` (m) stand together where they are near in plan. An object
    has `limits.points` of them, most on one level, is no wider strip along a border of the roof, and no
    crown. Its outline is the rectangle along the building's main direction, wider than its points by half a
    spacing.
    """
    height, _, _ = surface or surface_heights(solids, roof[:, :2])
    over = roof[:, 2] - height
    high = np.flatnonzero((over > limits.height) & (over < limits.highest))
    main = main_directions(polygon)
    if len(high) < limits.points or len(main) == 0:
        return ()
    pairs = cKDTree(roof[high, :2]).query_pairs(limits.together * spacing, output_type="ndarray")
    group = connected_groups_kernel(pairs[:, 0], pairs[:, 1], len(high))
    sizes = np.bincount(group)
    found = []
    for number in np.flatnonzero(sizes >= limits.points).tolist():
        mine = high[group == number]
        one = describe_object(solids, roof[mine], over[mine], float(main[0]), spacing, limits)
        if one is None or one.polygon.area < limits.least:
            continue
        if one.polygon.intersection(polygon).area > limits.inside * one.polygon.area:
            found.append(one)
    return tuple(sorted(found, key=lambda one: (-one.polygon.area, one.polygon.centroid.x)))


def describe_object(
    solids: tuple[Solid, ...],
    points: Points,
    over: Values,
    angle: float,
    spacing: float,
    limits: ObjectLimits,
) -> Installation | None:
    """The object that points (N, 3), so far `over` the roof (N,; m), make; None when they make none."""
    top = float(np.percentile(points[:, 2], 75.0))
    if np.mean(np.abs(points[:, 2] - top) < limits.level + 0.5 * np.ptp(over)) < limits.on_top:
        return None
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    local = points[:, :2] @ turn
    low, high = local.min(axis=0) - 0.5 * spacing, local.max(axis=0) + 0.5 * spacing
    sides = np.sort(high - low)
    filled = len(points) * spacing**2 / float(np.prod(sides))
    if (
        np.prod(sides) > limits.largest
        or filled < 0.4
        or sides[0] < 1.5 * spacing
        or sides[1] > 5.0 * sides[0]
    ):
        return None
    beside = float(np.clip(limits.beside * spacing, limits.least_beside, limits.most_beside))
    if explained_beside(solids, points, beside, limits.level):
        return None
    ring = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    corners = np.vstack([ring, ring.mean(axis=0)]) @ turn.T
    under, cosine, _ = surface_heights(solids, corners)
    if not np.isfinite(under[-1]):
        return None
    base = float(np.nanmin(under))
    rise = float(np.sqrt(max(1.0 / cosine[-1] ** 2 - 1.0, 0.0)))
    area, above = float(np.prod(sides)), float(np.median(over))
    if above < limits.height or top - base < limits.height:
        return None
    if rise < limits.flat:
        kind = "lift_housing" if area > 2.0 and above >= limits.lift_housing else "plant"
        kind = "chimney" if area <= limits.chimney and above >= 0.8 and sides[1] < 2.0 * sides[0] else kind
    else:
        kind = "chimney" if area <= limits.chimney else "dormer"
    return Installation(kind, Polygon(corners[:-1]), base, top, above, len(points))


def explained_beside(solids: tuple[Solid, ...], points: Points, beside: float, level: float) -> bool:
    """Whether the roof within `beside` (m) explains most of the points (N, 3) to `level` (m): its border is a
    little off.
    """
    ways = beside * np.array(
        [[1, 0], [0, 1], [-1, 0], [0, -1], [0.7, 0.7], [-0.7, 0.7], [-0.7, -0.7], [0.7, -0.7]]
    )
    places: NDArray[np.float64] = (points[:, None, :2] + ways[None]).reshape(-1, 2)
    height = surface_heights(solids, places)[0].reshape(len(points), len(ways))
    near = np.abs(np.nan_to_num(height, nan=-1e9) - points[:, 2:3]) < level
    return bool(np.mean(near.any(axis=1)) > 0.5)
