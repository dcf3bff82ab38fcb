"""Densification of a TIN of the ground: distance and angles to the facet, or that across a break line."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from eaves.geometry.tin import OUTSIDE, Ids, Tin, walk
from eaves.kernels import inlined_kernel, kernel
from eaves.model import GRID_STEP, Mask, Points, Values

UPRIGHT = np.inf
"""Slope (1) of a facet that has no area."""


@dataclass(frozen=True)
class Limits:
    """Largest differences from the surface at which a point joins it."""

    distance: float
    """From the facet, m."""
    angle: float
    """To the facet, seen from its vertices, radians."""
    steep: float
    """Facets at least this steep may hide a break line, and none so steep is extended across it."""
    reach: float
    """Farthest vertex that is mirrored at, m."""
    noise: float
    """A point nearer to the facet than this (m) is ground, and tells the TIN nothing new."""


class Waiting(NamedTuple):
    """Points (K,) that are no vertices yet, by their numbers among those of the TIN.

    `hint` (K,) is the triangle each was last seen in, -1 before that, and `judged` (K, 3) the vertices which
    that had: what a triangle said of a point it does not say again.
    """

    numbers: NDArray[np.int64]
    hint: Ids
    judged: Ids

    @classmethod
    def of(cls, numbers: NDArray[np.int64]) -> Waiting:
        """Points that were never looked at."""
        return cls(
            numbers, np.full(len(numbers), -1, np.int32), np.full((len(numbers), 3), OUTSIDE, np.int32)
        )

    def without(self, gone: Mask) -> Waiting:
        """Those that are left."""
        waiting = np.flatnonzero(~gone)
        return Waiting(self.numbers.take(waiting), self.hint.take(waiting), self.judged.take(waiting, axis=0))


def densify(tin: Tin, xyz: Points, waiting: Waiting, limits: Limits, rounds: int) -> int:
    """Insert into the TIN the candidates that fit, round by round until none does; the rounds used.

    A round judges all candidates on the same surface, so their order is of no matter.
    """
    for number in range(rounds):
        if len(waiting.numbers) == 0 or len(tin.vertices) == 0:
            return number
        fits, new = fits_kernel(
            xyz,
            *waiting,
            tin.whole,
            tin.corner,
            tin.vertices,
            tin.neighbours,
            limits.distance,
            limits.angle,
            limits.steep,
            limits.reach,
            limits.noise,
        )
        if not fits.any():
            return number
        tin.insert(waiting.numbers[new], waiting.hint[new])
        waiting = waiting.without(fits)
    return rounds


def insert_residuals(tin: Tin, xyz: Points, waiting: Waiting, residual: Values, noise: float) -> None:
    """Insert the points (K,) that are farther than `noise` (m) from the TIN, until none is.

    `residual` (K,) holds their distances from it now. The others would tell it nothing new.
    """
    while (far := residual > noise).any():
        tin.insert(waiting.numbers[far], waiting.hint[far])
        waiting, residual = waiting.without(far), residual[~far]
        update_residuals(tin, xyz, waiting, residual)


def update_residuals(tin: Tin, xyz: Points, waiting: Waiting, residual: Values) -> None:
    """Set the distances (K,), m, of points from the facets of the TIN where those are others than before."""
    if len(tin.vertices):
        residual_kernel(xyz, *waiting, tin.whole, tin.vertices, tin.neighbours, residual)


def near_surface(tin: Tin, xyz: Points, points: Points, tolerance: float, slant: float) -> Mask:
    """The points (M, 3) no farther along z from the TIN of some of others (N, 3) than a tolerance (m), plus
    `slant` (m) per unit of the facet's slope.
    """
    if len(tin.vertices) == 0:  # all on one line: the nearest point is all there is to compare with
        nearest = cKDTree(xyz[tin.waiting, :2]).query(points[:, :2])[1]
        return np.asarray(np.abs(points[:, 2] - xyz[tin.waiting[nearest], 2]) <= tolerance)
    return np.asarray(
        near_kernel(points, xyz, tin.whole, tin.corner, tin.vertices, tin.neighbours, tolerance, slant)
    )


@inlined_kernel
def plane_of(xyz: Points, vertices: Ids, triangle: int) -> Any:
    """Rise of a finite facet's plane to the east and to the north, and its slope."""
    a, b, c = vertices[triangle, 0], vertices[triangle, 1], vertices[triangle, 2]
    ux, uy, uz = xyz[b, 0] - xyz[a, 0], xyz[b, 1] - xyz[a, 1], xyz[b, 2] - xyz[a, 2]
    vx, vy, vz = xyz[c, 0] - xyz[a, 0], xyz[c, 1] - xyz[a, 1], xyz[c, 2] - xyz[a, 2]
    area = ux * vy - uy * vx
    if area == 0.0:  # three points whose turn is less than a double can tell
        return 0.0, 0.0, UPRIGHT
    east, north = (uz * vy - uy * vz) / area, (ux * vz - uz * vx) / area
    return east, north, np.sqrt(east * east + north * north)


@inlined_kernel
def facet_inside(xyz: Points, vertices: Ids, triangle: int, x: float, y: float) -> Any:
    """Height of a finite facet's plane at (x, y), and its slope."""
    east, north, slope = plane_of(xyz, vertices, triangle)
    a = vertices[triangle, 0]
    return xyz[a, 2] + east * (x - xyz[a, 0]) + north * (y - xyz[a, 1]), slope


@inlined_kernel
def facet_at(xyz: Points, vertices: Ids, neighbours: Ids, triangle: int, x: float, y: float) -> Any:
    """Height of a facet at (x, y), its slope, and the distance of (x, y) from the hull (0 inside).

    Outside the hull the facet behind the hull's edge goes on.
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
        return height, slope, away
    height, slope = facet_inside(xyz, vertices, triangle, x, y)
    return height, slope, 0.0


@kernel
def fits_kernel(
    xyz: Points,
    numbers: NDArray[np.int64],
    hint: Ids,
    judged: Ids,
    steps: NDArray[np.int64],
    corner: NDArray[np.float64],
    vertices: Ids,
    neighbours: Ids,
    distance: float,
    angle: float,
    steep: float,
    reach: float,
    noise: float,
) -> tuple[Mask, Mask]:
    """Masks (K,) of the candidates that fit the TIN, and of those that change it.

    `hint` and `judged` are those of `Waiting`.
    """
    fits, new = np.zeros(len(numbers), np.bool_), np.zeros(len(numbers), np.bool_)
    last, widest_sine = 0, np.sin(min(angle, 0.5 * np.pi))
    for i in range(len(numbers)):
        p, triangle = numbers[i], hint[i]
        if (
            triangle >= 0
            and vertices[triangle, 0] == judged[i, 0]
            and vertices[triangle, 1] == judged[i, 1]
            and vertices[triangle, 2] == judged[i, 2]
        ):
            continue
        x, y, z = xyz[p, 0], xyz[p, 1], xyz[p, 2]
        here = walk(steps, vertices, neighbours, hint[i] if hint[i] >= 0 else last, steps[p, 0], steps[p, 1])
        hint[i] = here
        last = here
        judged[i, 0], judged[i, 1], judged[i, 2] = vertices[here, 0], vertices[here, 1], vertices[here, 2]
        height, slope, away = facet_at(xyz, vertices, neighbours, here, x, y)
        off = abs(z - height) / np.sqrt(1.0 + slope * slope)
        if off > distance and slope < steep:
            continue
        nearest, closest = -1, np.inf
        for k in range(3):
            v = vertices[here, k]
            if v == OUTSIDE:
                continue
            length = np.sqrt((x - xyz[v, 0]) ** 2 + (y - xyz[v, 1]) ** 2 + (z - xyz[v, 2]) ** 2)
            if length < closest:
                nearest, closest = v, length
        # the widest angle is that at the nearest vertex
        is_flat = np.arctan2(off, away) <= angle if away > 0.0 else off <= widest_sine * closest
        if off <= distance and is_flat:
            fits[i], new[i] = True, off > noise
            continue
        length = np.hypot(x - xyz[nearest, 0], y - xyz[nearest, 1])
        if slope < steep or length > reach:
            continue
        mx, my = 2.0 * xyz[nearest, 0] - x, 2.0 * xyz[nearest, 1] - y
        right, up = int(np.round((mx - corner[0]) / GRID_STEP)), int(np.round((my - corner[1]) / GRID_STEP))
        across = walk(steps, vertices, neighbours, here, right, up)
        height, slope, away = facet_at(xyz, vertices, neighbours, across, mx, my)
        if away > 0.0 or slope > steep:
            continue
        off = abs(z - (2.0 * xyz[nearest, 2] - height))
        fits[i] = new[i] = off <= distance and np.arctan2(off, length) <= angle
    return fits, new


@kernel
def residual_kernel(
    xyz: Points,
    numbers: NDArray[np.int64],
    hint: Ids,
    judged: Ids,
    steps: NDArray[np.int64],
    vertices: Ids,
    neighbours: Ids,
    residual: Values,
) -> None:
    """Distance of each of the points (K,) from its facet, into `residual`; `hint` and `judged` are those of
    `Waiting`.
    """
    last = 0
    for i in range(len(numbers)):
        p, here = numbers[i], hint[i]
        if here >= 0:
            a, b, c = vertices[here, 0], vertices[here, 1], vertices[here, 2]
            if a == judged[i, 0] and b == judged[i, 1] and c == judged[i, 2]:
                continue
        last = walk(steps, vertices, neighbours, here if here >= 0 else last, steps[p, 0], steps[p, 1])
        hint[i] = last
        for k in range(3):
            judged[i, k] = vertices[last, k]
        height, slope, _ = facet_at(xyz, vertices, neighbours, last, xyz[p, 0], xyz[p, 1])
        residual[i] = abs(xyz[p, 2] - height) / np.sqrt(1.0 + slope * slope)


@kernel
def near_kernel(
    points: Points,
    xyz: Points,
    steps: NDArray[np.int64],
    corner: NDArray[np.float64],
    vertices: Ids,
    neighbours: Ids,
    tolerance: float,
    slant: float,
) -> Mask:
    """Mask (M,) of the points (M, 3) within the tolerance + `slant` · slope of the facet at each, along z."""
    fits = np.empty(len(points), np.bool_)
    here, facet = 0, -1
    east, north, slope = 0.0, 0.0, 0.0
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        right, up = int(np.rint((x - corner[0]) / GRID_STEP)), int(np.rint((y - corner[1]) / GRID_STEP))
        here = walk(steps, vertices, neighbours, here, right, up)
        a, b, c = vertices[here, 0], vertices[here, 1], vertices[here, 2]
        if a == OUTSIDE or b == OUTSIDE or c == OUTSIDE:
            height, slope, _ = facet_at(xyz, vertices, neighbours, here, x, y)
            facet = -1
        else:
            if here != facet:  # points come in order, so a plane often serves the next one too
                east, north, slope = plane_of(xyz, vertices, here)
                facet = here
            height = xyz[a, 2] + east * (x - xyz[a, 0]) + north * (y - xyz[a, 1])
        fits[i] = abs(z - height) <= tolerance + slant * slope
    return fits
