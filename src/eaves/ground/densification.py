"""Which points join a TIN of the ground: distance and angles to the facet, and the facet across a break
line.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from eaves.geometry.tin import OUTSIDE, Ids, Tin, walk
from eaves.model import Mask, Points, Values
from eaves.model.cloud import QUANTUM

STEEPEST_RIM = 1.5
"""A facet at the hull that is steeper is a sliver, and says nothing of the terrain beyond."""

UPRIGHT = 1e6
"""Slope of a facet that has no area."""


@dataclass(frozen=True)
class Limits:
    """What a point may differ from the surface to join it."""

    distance: float
    """From the facet, m."""
    angle: float
    """To the facet, seen from its vertices, radians."""
    angle_gain: float
    """Added to `angle` per unit of the facet's slope, radians."""
    mirror_rise: float
    """Height over the extended facet across the nearest vertex, per metre from the vertex."""
    mirror_slope: float
    """Steepest facet that is extended."""
    mirror_reach: float
    """Farthest vertex that is mirrored at, m."""
    steep: float
    """Facets at least this steep may hide a break line."""
    noise: float
    """A point nearer to the facet than this (m) is ground, and tells the TIN nothing new."""


def densify(tin: Tin, xyz: Points, candidates: NDArray[np.int64], limits: Limits, rounds: int) -> int:
    """Insert into the TIN the candidates (K,) that fit, round by round until none does; the rounds used.

    A round judges all candidates on the same surface, so their order is of no matter.
    """
    waiting = candidates.copy()
    hint = np.full(len(waiting), -1, np.int32)
    judged = np.full((len(waiting), 3), OUTSIDE, np.int32)
    for number in range(rounds):
        if len(waiting) == 0 or len(tin.vertices) == 0:
            return number
        whole = np.round((xyz[waiting, :2] - tin.corner) / QUANTUM).astype(np.int64)
        fits, new = fits_kernel(
            xyz,
            waiting,
            whole,
            tin.whole,
            tin.corner,
            tin.vertices,
            tin.neighbours,
            hint,
            judged,
            limits.distance,
            limits.angle,
            limits.angle_gain,
            limits.mirror_rise,
            limits.mirror_slope,
            limits.mirror_reach,
            limits.steep,
            limits.noise,
        )
        if not fits.any():
            return number
        tin.insert(waiting[new])
        waiting, hint, judged = waiting[~fits], hint[~fits], judged[~fits]
    return rounds


def heights_above(tin: Tin, xyz: Points) -> tuple[Values, Values]:
    """Height (N,) of points over the TIN of some of them, and the slope (N,) of the facet."""
    triangle = tin.located(xyz)
    if len(tin.vertices) == 0:  # all on one line: the nearest point is all there is to compare with
        nearest = cKDTree(xyz[tin.waiting, :2]).query(xyz[:, :2])[1]
        return xyz[:, 2] - xyz[tin.waiting[nearest], 2], np.zeros(len(xyz))
    above, slope = above_kernel(xyz, tin.vertices, tin.neighbours, triangle)
    return above, slope


def measure_roughness(tin: Tin, xyz: Points, longest: float) -> float:
    """Median distance (m) of a vertex from the plane through its neighbours up to `longest` (m) away."""
    triangles = tin.triangles
    if len(triangles) == 0:
        return 0.0
    used = np.zeros(len(xyz), bool)
    used[triangles.ravel()] = True
    residual = plane_residuals_kernel(xyz, triangles, longest)
    known = residual[used & np.isfinite(residual)]
    return float(np.median(known)) if len(known) else 0.0


@njit(cache=True)
def facet_inside(xyz: Points, vertices: Ids, triangle: int, x: float, y: float) -> Any:
    """Height of a finite facet's plane at (x, y), and its slope."""
    a, b, c = vertices[triangle, 0], vertices[triangle, 1], vertices[triangle, 2]
    ux, uy, uz = xyz[b, 0] - xyz[a, 0], xyz[b, 1] - xyz[a, 1], xyz[b, 2] - xyz[a, 2]
    vx, vy, vz = xyz[c, 0] - xyz[a, 0], xyz[c, 1] - xyz[a, 1], xyz[c, 2] - xyz[a, 2]
    area = ux * vy - uy * vx
    if area == 0.0:  # three points whose turn is less than a double can tell
        return xyz[a, 2], UPRIGHT
    east, north = (uz * vy - uy * vz) / area, (ux * vz - uz * vx) / area
    height = xyz[a, 2] + east * (x - xyz[a, 0]) + north * (y - xyz[a, 1])
    return height, np.sqrt(east * east + north * north)


@njit(cache=True)
def facet_at(xyz: Points, vertices: Ids, neighbours: Ids, triangle: int, x: float, y: float) -> Any:
    """Height of a facet at (x, y), its slope, and the distance of (x, y) from the hull (0 inside).

    Outside the hull the facet behind the hull's edge goes on, or where that is steep the edge's height does.
    """
    for k in range(3):
        if vertices[triangle, k] != OUTSIDE:
            continue
        a, b = vertices[triangle, (k + 1) % 3], vertices[triangle, (k + 2) % 3]
        ux, uy = xyz[b, 0] - xyz[a, 0], xyz[b, 1] - xyz[a, 1]
        along = ((x - xyz[a, 0]) * ux + (y - xyz[a, 1]) * uy) / (ux * ux + uy * uy)
        along = min(1.0, max(0.0, along))
        away = np.hypot(x - xyz[a, 0] - along * ux, y - xyz[a, 1] - along * uy)
        height, slope = facet_inside(xyz, vertices, neighbours[triangle, k], x, y)
        if slope <= STEEPEST_RIM:
            return height, slope, away
        return xyz[a, 2] + along * (xyz[b, 2] - xyz[a, 2]), 0.0, away
    height, slope = facet_inside(xyz, vertices, triangle, x, y)
    return height, slope, 0.0


@njit(cache=True)
def fits_kernel(
    xyz: Points,
    numbers: NDArray[np.int64],
    targets: NDArray[np.int64],
    whole: NDArray[np.int64],
    corner: NDArray[np.float64],
    vertices: Ids,
    neighbours: Ids,
    hint: Ids,
    judged: Ids,
    distance: float,
    angle: float,
    angle_gain: float,
    mirror_rise: float,
    mirror_slope: float,
    mirror_reach: float,
    steep: float,
    noise: float,
) -> tuple[Mask, Mask]:
    """Which candidates (K,) fit the TIN, and which change it.

    `hint` (K,) receives the triangle of each and `judged` (K, 3) its vertices: who did not fit a triangle
    does not fit it later.
    """
    fits, new = np.zeros(len(numbers), np.bool_), np.zeros(len(numbers), np.bool_)
    last = 0
    for i in range(len(numbers)):
        p, known = numbers[i], hint[i]
        if (
            known >= 0
            and vertices[known, 0] == judged[i, 0]
            and vertices[known, 1] == judged[i, 1]
            and vertices[known, 2] == judged[i, 2]
        ):
            continue
        x, y, z = xyz[p, 0], xyz[p, 1], xyz[p, 2]
        here = walk(
            whole, vertices, neighbours, hint[i] if hint[i] >= 0 else last, targets[i, 0], targets[i, 1]
        )
        hint[i] = here
        last = here
        judged[i, 0], judged[i, 1], judged[i, 2] = vertices[here, 0], vertices[here, 1], vertices[here, 2]
        height, slope, away = facet_at(xyz, vertices, neighbours, here, x, y)
        off = abs(z - height) / np.sqrt(1.0 + slope * slope)
        nearest, closest, widest = -1, np.inf, 0.0
        for k in range(3):
            v = vertices[here, k]
            if v == OUTSIDE:
                continue
            length = np.sqrt((x - xyz[v, 0]) ** 2 + (y - xyz[v, 1]) ** 2 + (z - xyz[v, 2]) ** 2)
            if length < closest:
                nearest, closest = v, length
            if length > 0.0:
                widest = max(widest, np.arcsin(min(1.0, off / length)))
        if away > 0.0:
            widest = np.arctan2(off, away)
        if off <= distance and widest <= angle + angle_gain * min(slope, 1.5):
            fits[i], new[i] = True, off > noise
            continue
        reach = np.hypot(x - xyz[nearest, 0], y - xyz[nearest, 1])
        if slope < steep or reach > mirror_reach:
            continue
        mx, my = 2.0 * xyz[nearest, 0] - x, 2.0 * xyz[nearest, 1] - y
        across = walk(
            whole,
            vertices,
            neighbours,
            here,
            int(np.round((mx - corner[0]) / QUANTUM)),
            int(np.round((my - corner[1]) / QUANTUM)),
        )
        height, slope, away = facet_at(xyz, vertices, neighbours, across, mx, my)
        if away > 0.0 or slope > mirror_slope:
            continue
        off = abs(z - (2.0 * xyz[nearest, 2] - height))
        fits[i] = new[i] = off <= distance and off <= mirror_rise * reach
    return fits, new


@njit(cache=True)
def above_kernel(xyz: Points, vertices: Ids, neighbours: Ids, triangle: Ids) -> tuple[Values, Values]:
    """Height of each point (N,) over the facet at it, and the facet's slope."""
    above, slope = np.empty(len(xyz)), np.empty(len(xyz))
    for i in range(len(xyz)):
        height, slope[i], _ = facet_at(xyz, vertices, neighbours, triangle[i], xyz[i, 0], xyz[i, 1])
        above[i] = xyz[i, 2] - height
    return above, slope


@njit(cache=True)
def plane_residuals_kernel(xyz: Points, triangles: Ids, longest: float) -> Values:
    """Distance in z of each vertex (N,) from the plane through the ends of its edges, NaN with too few."""
    sums = np.zeros((len(xyz), 9))  # n, x, y, z, xx, xy, yy, xz, yz of the neighbours, about the vertex
    for t in range(len(triangles)):
        for k in range(3):  # each inner edge is met twice, once from either side
            a, b = triangles[t, k], triangles[t, (k + 1) % 3]
            x, y, z = xyz[b, 0] - xyz[a, 0], xyz[b, 1] - xyz[a, 1], xyz[b, 2] - xyz[a, 2]
            if x * x + y * y > longest * longest:
                continue
            for v, sign in ((a, 1.0), (b, -1.0)):
                sums[v, 0] += 1.0
                sums[v, 1] += sign * x
                sums[v, 2] += sign * y
                sums[v, 3] += sign * z
                sums[v, 4] += x * x
                sums[v, 5] += x * y
                sums[v, 6] += y * y
                sums[v, 7] += x * z
                sums[v, 8] += y * z
    residual = np.full(len(xyz), np.nan)
    for i in range(len(xyz)):
        n = sums[i, 0]
        if n < 8.0:  # four neighbours, each met twice
            continue
        x, y, z = sums[i, 1] / n, sums[i, 2] / n, sums[i, 3] / n
        xx, xy, yy = sums[i, 4] / n - x * x, sums[i, 5] / n - x * y, sums[i, 6] / n - y * y
        xz, yz = sums[i, 7] / n - x * z, sums[i, 8] / n - y * z
        area = xx * yy - xy * xy
        if area <= 1e-6 * xx * yy:
            continue
        east, north = (xz * yy - yz * xy) / area, (yz * xx - xz * xy) / area
        residual[i] = abs(z - east * x - north * y)
    return residual
