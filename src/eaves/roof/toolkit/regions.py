"""Regions of points on planes: grown, joined where coplanar, and turned into roof planes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from eaves.geometry.neighbours import nearest
from eaves.geometry.planes import LocalPlanes, add_point_kernel, plane_of_sums_kernel
from eaves.kernels import kernel
from eaves.model import Labels, Mask, Points, RoofPlane, Values

NEIGHBOURS = 8
"""Points, a point itself with them, that say what it lies on; solid ones that say how high the roof is."""


HIGH = 3.0
"""A storey (m): chimneys and railings, whose edges split pulses too, rise no more over the roof."""


def crown_points(points: Points, not_last: Mask | None) -> Mask:
    """Mask (N,) of the points (N, 3) that are of a crown over the roof.

    A roof lets no pulse through but at its edges. A point is of something that does where most of the points
    around it are `not_last` (N,): echoes of pulses that came back once more from below. It is of a crown
    where the solid points around it in plan lie lower by more than `HIGH`. Glass has no solid roof below and
    stays. Without echoes nothing is a crown.
    """
    crown = np.zeros(len(points), bool)
    if not_last is None or 2 * not_last.sum() <= NEIGHBOURS or len(points) < NEIGHBOURS:
        return crown
    if np.ptp(points[:, 2]) <= HIGH:
        return crown
    around, _ = nearest(points, points, NEIGHBOURS)
    split = not_last[around].mean(axis=1) > 0.5
    loose, solid = np.flatnonzero(split), np.flatnonzero(~split)
    if len(loose) and len(solid) >= NEIGHBOURS:
        below = cKDTree(points[solid, :2]).query(points[loose, :2], NEIGHBOURS)[1]
        crown[loose] = points[loose, 2] - np.median(points[solid[below], 2], axis=1) > HIGH
    return crown


@kernel
def grow_kernel(
    xyz: NDArray[np.float64],
    neighbours: NDArray[np.int64],
    counts: NDArray[np.int64],
    normals: NDArray[np.float64],
    open_: NDArray[np.bool_],
    seeds: NDArray[np.int64],
    least_cosine: float,
    tolerance: float,
    fewest: int,
    labels: NDArray[np.int32],
) -> int:
    """Number of regions grown over `open_` points from `seeds` in their order; `labels` (N,) receives 1, 2, …

    A neighbour joins when its normal is like the region's and it is within `tolerance` of the region's
    plane. The plane is fitted again whenever the region has grown by a quarter, and members are asked
    again until none joins.
    """
    sums, plane = np.zeros(10), np.zeros(4)
    covariance, vectors, values = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
    queue = np.empty(len(xyz), np.int64)
    regions = 0
    for seed in seeds:
        if not open_[seed] or labels[seed] != 0:
            continue
        regions += 1
        sums[:] = 0.0
        add_point_kernel(sums, xyz[seed, 0], xyz[seed, 1], xyz[seed, 2], 1.0)
        for k in range(3):
            plane[k] = normals[seed, k]
        plane[3] = plane[0] * xyz[seed, 0] + plane[1] * xyz[seed, 1] + plane[2] * xyz[seed, 2]
        queue[0] = seed
        labels[seed] = regions
        length, fitted, grown = 1, 8, True
        while grown:
            grown = False
            head = 0
            while head < length:
                i = queue[head]
                head += 1
                for column in range(1, counts[i]):
                    j = neighbours[i, column]
                    if not open_[j] or labels[j] != 0:
                        continue
                    away = plane[0] * xyz[j, 0] + plane[1] * xyz[j, 1] + plane[2] * xyz[j, 2] - plane[3]
                    cosine = plane[0] * normals[j, 0] + plane[1] * normals[j, 1] + plane[2] * normals[j, 2]
                    if abs(away) > tolerance or cosine < least_cosine:
                        continue
                    labels[j] = regions
                    queue[length] = j
                    length += 1
                    grown = True
                    add_point_kernel(sums, xyz[j, 0], xyz[j, 1], xyz[j, 2], 1.0)
                    if length >= fitted:
                        fitted = length + length // 4 + 1
                        plane_of_sums_kernel(sums, covariance, vectors, values, plane)
        if length < fewest:
            for head in range(length):
                labels[queue[head]] = 0
            regions -= 1
    return regions


@kernel
def sums_kernel(xyz: NDArray[np.float64], labels: NDArray[np.int32], sums: NDArray[np.float64]) -> None:
    """Add up the ten sums (K, 10) of the points (N, 3) of every label 1…K."""
    for i in range(len(xyz)):
        if labels[i] > 0:
            add_point_kernel(sums[labels[i] - 1], xyz[i, 0], xyz[i, 1], xyz[i, 2], 1.0)


@kernel
def squared_distance_kernel(sums: NDArray[np.float64], plane: NDArray[np.float64]) -> Any:
    """Mean squared distance of the points behind ten sums from a plane (4,)."""
    a, b, c, d = plane[0], plane[1], plane[2], plane[3]
    square = a * a * sums[4] + b * b * sums[7] + c * c * sums[9]
    square += 2.0 * (a * b * sums[5] + a * c * sums[6] + b * c * sums[8])
    square += -2.0 * d * (a * sums[1] + b * sums[2] + c * sums[3]) + d * d * sums[0]
    return max(square / sums[0], 0.0)


@kernel
def join_kernel(
    sums: NDArray[np.float64],
    touching: NDArray[np.bool_],
    most_square: float,
    growth: float,
    owner: NDArray[np.int64],
) -> None:
    """Join touching regions that one plane explains, best pair first; `owner` (K,) receives joined numbers.

    One plane explains both when each region's mean squared distance from it stays below `most_square`,
    or below `growth` times what the region had from its own plane.
    """
    count = len(sums)
    plane, joint = np.zeros(4), np.zeros(10)
    covariance, vectors, values = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
    roughness, cost = np.zeros(count), np.full((count, count), np.inf)
    alive, stale = np.ones(count, np.bool_), np.ones(count, np.bool_)
    again, least, partner = np.ones(count, np.bool_), np.full(count, np.inf), np.zeros(count, np.int64)
    for i in range(count):
        owner[i] = i
        plane_of_sums_kernel(sums[i], covariance, vectors, values, plane)
        roughness[i] = values[0]
    while count:
        for i in range(count):
            if not again[i]:
                continue
            least[i] = np.inf
            for j in range(i + 1, count):
                if not (alive[i] and alive[j] and touching[i, j]):
                    continue
                if stale[i] or stale[j]:
                    joint[:] = sums[i] + sums[j]
                    plane_of_sums_kernel(joint, covariance, vectors, values, plane)
                    ratio = max(
                        squared_distance_kernel(sums[i], plane) / max(most_square, growth * roughness[i]),
                        squared_distance_kernel(sums[j], plane) / max(most_square, growth * roughness[j]),
                    )
                    cost[i, j] = ratio
                if cost[i, j] < least[i]:
                    least[i], partner[i] = cost[i, j], j
        first = int(np.argmin(least))
        second = int(partner[first])
        if least[first] > 1.0:
            break
        stale[:] = False
        sums[first] += sums[second]
        alive[second] = False
        stale[first] = True
        plane_of_sums_kernel(sums[first], covariance, vectors, values, plane)
        roughness[first] = values[0]
        for k in range(count):
            if owner[k] == second:
                owner[k] = first
            if touching[second, k]:
                touching[first, k] = touching[k, first] = True
        touching[first, first] = False
        again[:] = touching[first]
        again[first] = again[second] = True


def normal_error(local: LocalPlanes) -> float:
    """The error (radians) of a local normal by noise, spacing and number of neighbours: 2 s √π / (a k)."""
    return float(2.0 * np.sqrt(np.pi) * local.noise / (local.spacing * np.median(local.counts)))


def without_gaps(labels: Labels) -> Labels:
    """The labels (N,) numbered 1…K in their order, 0 kept."""
    present = np.bincount(labels, minlength=1) > 0
    present[0] = False
    return np.cumsum(present).astype(np.int32)[labels]


def touching_regions(labels: Labels, neighbours: NDArray[np.int64], count: int) -> NDArray[np.bool_]:
    """Mask (K, K) of the pairs of regions that touch: a point of one neighbours (N, M) a point of the
    other."""
    return np.ascontiguousarray(touching_kernel(neighbours, labels, count)[1:, 1:])


@kernel
def touching_kernel(neighbours: NDArray[np.int64], labels: NDArray[np.int32], count: int) -> Mask:
    """Mask (K + 1, K + 1) of the pairs of labels that touch: a point of one neighbours (N, M) a point of
    another."""
    touching = np.zeros((count + 1, count + 1), np.bool_)
    for i in range(len(labels)):
        for column in range(1, neighbours.shape[1]):
            j = neighbours[i, column]
            if labels[j] != labels[i]:
                touching[labels[i], labels[j]] = touching[labels[j], labels[i]] = True
    return touching


def join_coplanar(
    xyz: Points, labels: Labels, touching: NDArray[np.bool_], most_rms: float, growth: float
) -> Labels:
    """Labels (N,), 1…J without gaps, with touching regions (K, K) made one where one plane explains both."""
    count = len(touching)
    sums, owner = np.zeros((count, 10)), np.zeros(count, np.int64)
    sums_kernel(xyz, labels, sums)
    join_kernel(sums, touching.copy(), most_rms**2, growth, owner)
    stays = owner == np.arange(count)
    joined: Labels = np.append(0, np.cumsum(stays)[owner]).astype(np.int32)[labels]
    return joined


def fit_labels(
    xyz: Points, labels: Labels, count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Planes (K, 4), mean squared distances (K,) and numbers of points (K,); NaN for fewer than three."""
    planes = np.full((count, 4), np.nan)
    squares, sizes = np.full(count, np.nan), np.zeros(count, np.int64)
    fit_kernel(xyz, labels, planes, squares, sizes)
    return planes, squares, sizes


@kernel
def fit_kernel(
    xyz: NDArray[np.float64],
    labels: NDArray[np.int32],
    planes: NDArray[np.float64],
    squares: NDArray[np.float64],
    sizes: NDArray[np.int64],
) -> None:
    """Fit a plane to the points of every label 1…K of at least three points."""
    sums = np.zeros((len(planes), 10))
    covariance, vectors, values = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
    sums_kernel(xyz, labels, sums)
    for k in range(len(planes)):
        sizes[k] = int(sums[k, 0])
        if sizes[k] >= 3:
            plane_of_sums_kernel(sums[k], covariance, vectors, values, planes[k])
            squares[k] = values[0]


@kernel
def return_kernel(
    xyz: NDArray[np.float64],
    neighbours: NDArray[np.int64],
    planes: NDArray[np.float64],
    tolerance: float,
    gap: float,
    labels: NDArray[np.int32],
) -> int:
    """Number of points given, this round, to the plane that is near in both distances [xiao2014, section 3].

    The distances are that to the plane, at most `tolerance`, and that to the nearest point of the
    plane, at most `gap`; the smallest sum of their squared ratios wins. All points of a round see the
    labels before it.
    """
    before = labels.copy()
    returned = 0
    for i in range(len(xyz)):
        if before[i] != 0:
            continue
        best = 2.0
        for column in range(1, neighbours.shape[1]):
            j = neighbours[i, column]
            if before[j] == 0:
                continue
            plane = planes[before[j] - 1]
            away = plane[0] * xyz[i, 0] + plane[1] * xyz[i, 1] + plane[2] * xyz[i, 2] - plane[3]
            x, y, z = xyz[i, 0] - xyz[j, 0], xyz[i, 1] - xyz[j, 1], xyz[i, 2] - xyz[j, 2]
            apart = (x * x + y * y + z * z) / (gap * gap)
            flat = away * away / (tolerance * tolerance)
            if apart <= 1.0 and flat <= 1.0 and apart + flat < best:
                best = apart + flat
                labels[i] = before[j]
        if labels[i] != 0:
            returned += 1
    return returned


def roof_planes(labels: Labels, xyz: Points, fewest: int, least_normal_z: float) -> list[RoofPlane]:
    """The planes of the labels (N,), largest first, without those of few points, on lines, and too steep."""
    planes = []
    count = int(labels.max(initial=0))
    normals, _, sizes = fit_labels(xyz, labels, count)
    order = np.argsort(labels, kind="stable")
    start = np.append(0, np.cumsum(np.bincount(labels, minlength=count + 1)))
    for number in np.argsort(-sizes, kind="stable"):
        x, y, z, d = normals[number]
        if sizes[number] < max(fewest, 3) or not z >= least_normal_z:
            continue
        members = order[start[number + 1] : start[number + 2]].astype(np.int64)
        away: Values = xyz[members] @ np.array([x, y, z]) - d
        planes.append(
            RoofPlane((float(-x / z), float(-y / z), float(d / z)), members, float(np.sqrt(np.mean(away**2))))
        )
    return planes


def seed_order(curvature: Values, open_: Mask) -> NDArray[np.int64]:
    """The open points (M,), flattest first."""
    return np.argsort(np.where(open_, curvature, np.inf), kind="stable")[: int(open_.sum())].astype(np.int64)
