"""Each roof point of one epoch against the points of the other: is its surface still there?

A roof point with the plane of its neighbours says where the other epoch's points must lie. In a cylinder
around it they lie on that plane (the same roof), all below (it was not there yet, or is gone), all above
(raised, or hidden by a crown), or there are none (not seen).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import kernel
from eaves.model import Mask, Points, Values
from eaves.model.cloud import BUILDING, GROUND

UNSEEN, SAME, GROUND_BELOW, ROOF_BELOW, ROOF_ABOVE, OTHER_BELOW, HIDDEN = range(7)
"""State of a roof point in the other epoch: nothing; the same surface; the ground, another roof or
something else under it; a roof above it; only what is no roof above it."""

LEAST_NEIGHBOURS = 5
"""A plane through fewer points decides nothing."""
MOST_NEIGHBOURS = 200
"""More neighbours make no plane better."""
STEEPEST = 2.5
"""Tangent of the steepest roof (68°)."""
BESIDE = 0.4
"""Points whose middle is farther from a place than this share of their radius lie beside it: those of half a
disc are, on the mean, by 0.42."""
STANDING = 0.2
"""Points of no roof make a surface where they are at least this share of those on and under it: at a corner
of a roof a quarter lies on it, and of a crown single leaves lie at the height of any roof."""
ONE_SURFACE = 1.5
"""A point that lies more standard deviations off the plane of its neighbours is not on it."""


@dataclass(frozen=True, eq=False)
class PointPlanes:
    """Slopes (N, 2) and residuals (N,) of the planes of roof points' neighbours; residual NaN for none."""

    slope: NDArray[np.float64]
    rms: Values


@dataclass(frozen=True, eq=False)
class Facing:
    """The other epoch at roof points: `state` (N,), and how far it lies over them (m)."""

    state: NDArray[np.uint8]
    distance: Values


def point_planes(xyz: Points, radius: float) -> PointPlanes:
    """Planes through the neighbours of points (N, 3) within `radius` (m) in plan and in height."""
    order, start, corner, columns = sort_into_cells(xyz, radius)
    slope, rms = planes_kernel(xyz, order, start, corner, columns, radius, LEAST_NEIGHBOURS)
    return PointPlanes(slope, rms)


def face_points(
    xyz: Points,
    slope: NDArray[np.float64],
    others: Points,
    classes: NDArray[np.uint8],
    radius: float,
    tolerance: float,
) -> Facing:
    """The state that points of another epoch (M, 3) with classes show within `radius` (m) of roof points (N,
    3)."""
    if not len(others):
        return Facing(np.full(len(xyz), UNSEEN, np.uint8), np.full(len(xyz), np.nan))
    order, start, corner, columns = sort_into_cells(others, radius)
    state, distance = facing_kernel(
        xyz, slope, others, classes, order, start, corner, columns, radius, tolerance
    )
    return Facing(state, distance)


def nearest_distances(
    xyz: Points, slope: NDArray[np.float64], others: Points, radius: float, most: float
) -> Values:
    """Distance (N,) of the other epoch's surface over roof points: of the nearest in plan of those no
    farther than `most` (m) from the plane; NaN where there is none."""
    if not len(others):
        return np.full(len(xyz), np.nan)
    order, start, corner, columns = sort_into_cells(others, radius)
    found: Values = nearest_kernel(xyz, slope, others, order, start, corner, columns, radius, most)
    return found


def sort_into_cells(
    xyz: Points, side: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64], int]:
    """Points (N, 3) by square cells of `side` (m): their order, where each cell begins in it, the grid's
    south-west corner and its columns."""
    corner = xyz[:, :2].min(axis=0) if len(xyz) else np.zeros(2)
    cell = np.floor((xyz[:, :2] - corner) / side).astype(np.int64)
    columns, rows = (cell.max(axis=0) + 1).tolist() if len(xyz) else (1, 1)
    key = cell[:, 1] * columns + cell[:, 0]
    order = np.argsort(key, kind="stable")
    start = np.searchsorted(key[order], np.arange(columns * rows + 1))
    return order, start, corner, int(columns)


@kernel
def planes_kernel(
    xyz: Points,
    order: NDArray[np.int64],
    start: NDArray[np.int64],
    corner: NDArray[np.float64],
    columns: int,
    radius: float,
    least: int,
) -> tuple[NDArray[np.float64], Values]:
    """Least-squares planes of what lies as near in height as a roof could rise."""
    count = len(xyz)
    rows = (len(start) - 1) // columns
    slope, rms = np.zeros((count, 2)), np.full(count, np.nan)
    near = np.empty((MOST_NEIGHBOURS, 3))
    for i in range(count):
        x, y, z = xyz[i]
        column, row = int((x - corner[0]) / radius), int((y - corner[1]) / radius)
        total = 0
        for r in range(max(row - 1, 0), min(row + 2, rows)):
            for c in range(max(column - 1, 0), min(column + 2, columns)):
                for k in range(start[r * columns + c], start[r * columns + c + 1]):
                    j = order[k]
                    dx, dy, dz = xyz[j, 0] - x, xyz[j, 1] - y, xyz[j, 2] - z
                    away = dx * dx + dy * dy
                    if away > radius * radius or total == MOST_NEIGHBOURS:
                        continue
                    if abs(dz) > STEEPEST * np.sqrt(away) + 0.1:  # on a wall, or on another roof
                        continue
                    near[total, 0], near[total, 1], near[total, 2] = dx, dy, dz
                    total += 1
        if total < least:
            continue
        sx, sy, sz, sxx, sxy, syy, sxz, syz, szz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(total):
            dx, dy, dz = near[k]
            sx, sy, sz = sx + dx, sy + dy, sz + dz
            sxx, sxy, syy = sxx + dx * dx, sxy + dx * dy, syy + dy * dy
            sxz, syz, szz = sxz + dx * dz, syz + dy * dz, szz + dz * dz
        cxx, cxy, cyy = sxx - sx * sx / total, sxy - sx * sy / total, syy - sy * sy / total
        cxz, cyz, czz = sxz - sx * sz / total, syz - sy * sz / total, szz - sz * sz / total
        determinant = cxx * cyy - cxy * cxy
        if determinant < 0.01 * (cxx + cyy) ** 2:  # the neighbours lie in a line
            continue
        a, b = (cxz * cyy - cyz * cxy) / determinant, (cyz * cxx - cxz * cxy) / determinant
        slope[i, 0], slope[i, 1] = a, b
        left = np.sqrt(max(czz - a * cxz - b * cyz, 0.0) / max(total - 3, 1))
        if abs(sz - a * sx - b * sy) <= total * (ONE_SURFACE * left + 0.01):
            rms[i] = left / np.sqrt(1.0 + a * a + b * b)
    return slope, rms


@kernel
def facing_kernel(
    xyz: Points,
    slope: NDArray[np.float64],
    others: Points,
    classes: NDArray[np.uint8],
    order: NDArray[np.int64],
    start: NDArray[np.int64],
    corner: NDArray[np.float64],
    columns: int,
    radius: float,
    tolerance: float,
) -> tuple[NDArray[np.uint8], Values]:
    count, rows = len(xyz), (len(start) - 1) // columns
    state, distance = np.full(count, UNSEEN, np.uint8), np.full(count, np.nan)
    for i in range(count):
        x, y, z = xyz[i]
        a, b = slope[i]
        limit = tolerance * np.sqrt(1.0 + a * a + b * b)
        column, row = int(np.floor((x - corner[0]) / radius)), int(np.floor((y - corner[1]) / radius))
        seen, nearest, above = 0, np.inf, False
        roof_above, top, top_class = np.inf, -np.inf, 0
        ground_east, ground_north, ground_top = 0.0, 0.0, -np.inf
        grounds, under, on, roofs = 0, 0, 0, 0
        for r in range(max(row - 1, 0), min(row + 2, rows)):
            for c in range(max(column - 1, 0), min(column + 2, columns)):
                for k in range(start[r * columns + c], start[r * columns + c + 1]):
                    j = order[k]
                    dx, dy = others[j, 0] - x, others[j, 1] - y
                    if dx * dx + dy * dy > radius * radius:
                        continue
                    d = others[j, 2] - z - a * dx - b * dy
                    seen += 1
                    if abs(d) < abs(nearest):
                        nearest = d
                    if abs(d) <= limit:
                        on += 1
                        roofs += classes[j] == BUILDING
                        continue
                    if classes[j] == GROUND and d < 0:
                        ground_east, ground_north, grounds = ground_east + dx, ground_north + dy, grounds + 1
                        ground_top = max(ground_top, d)
                    if d > 0:
                        above = True
                        if classes[j] == BUILDING and d < roof_above:
                            roof_above = d
                        continue
                    under += 1
                    if d > top:
                        top, top_class = d, classes[j]
        if seen == 0:
            continue
        if roofs > 0 or (on > 0 and on >= STANDING * (on + under)):
            state[i], distance[i] = SAME, nearest
            continue
        if top_class == BUILDING and -top <= roof_above:
            state[i], distance[i] = ROOF_BELOW, top
        elif roof_above < np.inf:
            state[i], distance[i] = ROOF_ABOVE, roof_above
        elif grounds > 0:
            state[i], distance[i] = GROUND_BELOW, ground_top
            if np.hypot(ground_east, ground_north) > BESIDE * radius * grounds:
                state[i] = UNSEEN
            continue
        elif top > -np.inf:
            state[i], distance[i] = OTHER_BELOW, top
            continue
        elif above:
            state[i], distance[i] = HIDDEN, nearest
            continue
        # the other roof must lie around the point: what lies to one side of it is seen past it
        east, north, total, number = 0.0, 0.0, 0.0, 0
        for r in range(max(row - 1, 0), min(row + 2, rows)):
            for c in range(max(column - 1, 0), min(column + 2, columns)):
                for k in range(start[r * columns + c], start[r * columns + c + 1]):
                    j = order[k]
                    dx, dy = others[j, 0] - x, others[j, 1] - y
                    d = others[j, 2] - z - a * dx - b * dy
                    if dx * dx + dy * dy <= radius * radius and abs(d - distance[i]) <= 4 * limit:
                        east, north, total, number = east + dx, north + dy, total + d, number + 1
        if np.hypot(east, north) <= BESIDE * radius * number:
            distance[i] = total / number
        elif grounds > 0 and np.hypot(ground_east, ground_north) <= BESIDE * radius * grounds:
            state[i], distance[i] = GROUND_BELOW, ground_top
        else:
            state[i] = HIDDEN
    return state, distance


@kernel
def nearest_kernel(
    xyz: Points,
    slope: NDArray[np.float64],
    others: Points,
    order: NDArray[np.int64],
    start: NDArray[np.int64],
    corner: NDArray[np.float64],
    columns: int,
    radius: float,
    most: float,
) -> Values:
    count, rows = len(xyz), (len(start) - 1) // columns
    distance = np.full(count, np.nan)
    for i in range(count):
        x, y, z = xyz[i]
        a, b = slope[i]
        column, row = int(np.floor((x - corner[0]) / radius)), int(np.floor((y - corner[1]) / radius))
        best = radius * radius
        for r in range(max(row - 1, 0), min(row + 2, rows)):
            for c in range(max(column - 1, 0), min(column + 2, columns)):
                for k in range(start[r * columns + c], start[r * columns + c + 1]):
                    j = order[k]
                    dx, dy = others[j, 0] - x, others[j, 1] - y
                    away = dx * dx + dy * dy
                    d = others[j, 2] - z - a * dx - b * dy
                    if away <= best and abs(d) <= most:
                        best, distance[i] = away, d
    return distance


def planar(planes: PointPlanes, limit: float) -> Mask:
    """Which points (N,) lie on a surface that a plane fits within `limit` (m)."""
    return np.asarray(np.isfinite(planes.rms) & (planes.rms <= limit))
