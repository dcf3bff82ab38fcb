"""Planes of points: ten sums and their plane, of one set or of many at once; local fits, and the noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eaves.geometry.inside import connected_groups_kernel
from eaves.geometry.neighbours import nearest
from eaves.kernels import kernel
from eaves.model import Integers, Labels, Mask, PointCloud, Points, Values
from eaves.model.scene import TREE, WALL


def quantile(values: Values, share: float) -> float:
    """The quantile of values (N,), N ≥ 1, none of them NaN, as `numpy.quantile` has it."""
    last = len(values) - 1
    place = last * share
    low = int(place)
    places = [low, min(low + 1, last)]
    before, after = map(float, np.partition(values, places)[places])
    step, part = after - before, place - low
    return before + step * part if part < 0.5 else after - step * (1.0 - part)


def median(values: Values | Integers) -> float:
    """The median of values (N,), N ≥ 1, none of them NaN, as `numpy.median` has it."""
    middles = [(len(values) - 1) // 2, len(values) // 2]
    below, above = np.partition(values, middles)[middles]
    return float(below + above) / 2.0


def group_percentiles(values: Values, group: Labels | Integers, count: int, percent: float) -> Values:
    """The percentile (G,) of the values (N,) of each of `count` groups; NaN for a group without any.

    Between two values it is linear, to the bit as `numpy.percentile` is. Values of group -1 are left out.
    """
    # one after the other, and in sixteen bits by radix: to sort by both at once takes five times as long
    order = np.argsort(values)
    few = np.int16 if count < np.iinfo(np.int16).max else np.int64
    order = order[np.argsort(group[order].astype(few), kind="stable")]
    ordered = values[order]
    first = np.searchsorted(group[order], np.arange(count + 1))
    size = np.diff(first)
    last = np.maximum(size - 1, 0)
    place = last * (percent / 100.0)
    low = np.floor(place).astype(np.int64)
    filled = size > 0
    percentiles = np.full(count, np.nan)
    before = ordered[(first[:-1] + low)[filled]]
    after = ordered[(first[:-1] + np.minimum(low + 1, last))[filled]]
    percentiles[filled] = between(before, after, (place - low)[filled])
    return percentiles


def between(before: Values, after: Values, share: Values | float) -> Values:
    """The values (K,) at a share of the way from some to others, from the nearer end: as numpy has them."""
    step = after - before
    return np.where(share < 0.5, before + step * share, after - step * (1.0 - share))


LINE_RATIO = 0.1
"""A neighbourhood whose second eigenvalue is below this share of the first is a line and has no normal."""

NOISE_QUANTILE = (0.35, -0.385)
"""Share of the neighbourhoods taken as free of edges, and the standard normal deviate of that share."""

CALM_QUANTILE = (0.12, -1.175)
"""The same where a roof of many small faces has few neighbourhoods free of edges."""

MIN_NOISE, MAX_NOISE = 0.012, 0.15
"""Noise (m): no roof is flatter than the first; what scatters more than the second is a crown, not a roof."""


@kernel
def eigen_kernel(c: Values, vectors: Values, values: Values) -> None:
    """Eigenvalues, ascending, and eigenvectors (columns) of a symmetric (3, 3) matrix by Jacobi rotations."""
    a = c.copy()
    for i in range(3):
        for j in range(3):
            vectors[i, j] = 1.0 if i == j else 0.0
    size = abs(a[0, 0]) + abs(a[1, 1]) + abs(a[2, 2])
    for _ in range(30):
        if abs(a[0, 1]) + abs(a[0, 2]) + abs(a[1, 2]) <= 1e-15 * size:
            break
        for p in range(2):
            for q in range(p + 1, 3):
                if abs(a[p, q]) <= 1e-300:
                    continue
                theta = (a[q, q] - a[p, p]) / (2.0 * a[p, q])
                t = 1.0 / (abs(theta) + np.sqrt(theta * theta + 1.0))
                if theta < 0.0:
                    t = -t
                cosine = 1.0 / np.sqrt(t * t + 1.0)
                sine = t * cosine
                for k in range(3):
                    first, second = a[k, p], a[k, q]
                    a[k, p], a[k, q] = cosine * first - sine * second, sine * first + cosine * second
                for k in range(3):
                    first, second = a[p, k], a[q, k]
                    a[p, k], a[q, k] = cosine * first - sine * second, sine * first + cosine * second
                for k in range(3):
                    first, second = vectors[k, p], vectors[k, q]
                    vectors[k, p] = cosine * first - sine * second
                    vectors[k, q] = sine * first + cosine * second
    for i in range(3):
        values[i] = max(a[i, i], 0.0)
    for i in range(2):
        for j in range(2 - i):
            if values[j] > values[j + 1]:
                values[j], values[j + 1] = values[j + 1], values[j]
                for k in range(3):
                    vectors[k, j], vectors[k, j + 1] = vectors[k, j + 1], vectors[k, j]


@kernel
def plane_of_sums_kernel(
    sums: Values,
    covariance: Values,
    vectors: Values,
    values: Values,
    plane: Values,
) -> None:
    """The plane of least squared distances, from the ten sums of its points.

    The sums are n, Σx, Σy, Σz, Σxx, Σxy, Σxz, Σyy, Σyz, Σzz. `plane` (4,) receives nx, ny, nz, d of
    nx·x + ny·y + nz·z = d, nz ≥ 0. `covariance`, `vectors` (3, 3) and `values` (3,) are work space and
    hold eq. 1 of [xiao2014] with its eigenvectors and eigenvalues afterwards.
    """
    n = sums[0]
    x, y, z = sums[1] / n, sums[2] / n, sums[3] / n
    covariance[0, 0] = sums[4] / n - x * x
    covariance[0, 1] = covariance[1, 0] = sums[5] / n - x * y
    covariance[0, 2] = covariance[2, 0] = sums[6] / n - x * z
    covariance[1, 1] = sums[7] / n - y * y
    covariance[1, 2] = covariance[2, 1] = sums[8] / n - y * z
    covariance[2, 2] = sums[9] / n - z * z
    eigen_kernel(covariance, vectors, values)
    sign = -1.0 if vectors[2, 0] < 0.0 else 1.0
    plane[0], plane[1], plane[2] = sign * vectors[0, 0], sign * vectors[1, 0], sign * vectors[2, 0]
    plane[3] = plane[0] * x + plane[1] * y + plane[2] * z


@kernel
def add_point_kernel(sums: Values, x: float, y: float, z: float, weight: float) -> None:
    """Add a point to the ten sums; weight -1 takes it away."""
    sums[0] += weight
    sums[1] += weight * x
    sums[2] += weight * y
    sums[3] += weight * z
    sums[4] += weight * x * x
    sums[5] += weight * x * y
    sums[6] += weight * x * z
    sums[7] += weight * y * y
    sums[8] += weight * y * z
    sums[9] += weight * z * z


@kernel
def local_planes_kernel(
    xyz: Values,
    neighbours: Integers,
    smallest: int,
    line_ratio: float,
    normals: Values,
    eigenvalues: Values,
    counts: Integers,
) -> None:
    """Normals (M, 3), eigenvalues (M, 3), neighbours used (M,) among points (N, 3) [xiao2014, eq. 1].

    Each of M points takes its `smallest` nearest neighbours, itself among them, and more, up to all K columns
    of `neighbours` (M, K), as long as they lie on one line.
    """
    sums, plane = np.zeros(10), np.zeros(4)
    covariance, vectors, values = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
    for i in range(len(neighbours)):
        first = neighbours[i, 0]
        sums[:] = 0.0
        size = 0
        need = smallest
        while True:
            while size < need:
                j = neighbours[i, size]
                add_point_kernel(
                    sums, xyz[j, 0] - xyz[first, 0], xyz[j, 1] - xyz[first, 1], xyz[j, 2] - xyz[first, 2], 1.0
                )
                size += 1
            plane_of_sums_kernel(sums, covariance, vectors, values, plane)
            if values[1] >= line_ratio * values[2] or size == neighbours.shape[1]:
                break
            need = min(size + 4, neighbours.shape[1])
        counts[i] = size
        for k in range(3):
            normals[i, k] = plane[k]
            eigenvalues[i, k] = values[k]


@dataclass(frozen=True, eq=False)
class LocalPlanes:
    """The plane around every point of N.

    `neighbours` (N, K) holds indices, nearest first, the point itself in front; `counts` (N,) says how
    many of them were used. `normals` (N, 3) point up, `eigenvalues` (N, 3) ascend (m²), `curvature`
    (N,) is eq. 3 of [xiao2014]. `noise` is the standard deviation (m) of points about their surface,
    `spacing` their mean distance in plan (m).
    """

    neighbours: Integers
    counts: Integers
    normals: Values
    eigenvalues: Values
    curvature: Values
    noise: float
    spacing: float


def local_planes(xyz: Points, count: int, most: int) -> LocalPlanes:
    """The planes of the `count` nearest neighbours of points (N, 3), N ≥ 3; up to `most` where on a line."""
    return planes_around(xyz, xyz, count, most)


def planes_around(queries: Points, xyz: Points, count: int, most: int) -> LocalPlanes:
    """The planes through the `count` of points (N, 3), N ≥ 3, nearest to M queries; see `local_planes`."""
    neighbours, distances = nearest(queries, xyz, max(most, count))
    most = neighbours.shape[1]
    normals, eigenvalues = np.zeros((len(neighbours), 3)), np.zeros((len(neighbours), 3))
    counts = np.zeros(len(neighbours), np.int64)
    neighbourhoods = (xyz, neighbours, min(count, most))
    local_planes_kernel(*neighbourhoods, LINE_RATIO, normals, eigenvalues, counts)
    total = eigenvalues.sum(axis=1)
    curvature = eigenvalues[:, 0] / np.where(total > 0.0, total, 1.0)  # [xiao2014], eq. 3
    spacing = float(median(distances[:, -1]) * np.sqrt(np.pi / most))
    noise = measure_noise(eigenvalues[:, 0], counts)
    return LocalPlanes(neighbours, counts, normals, eigenvalues, curvature, noise, max(spacing, 1e-3))


def measure_noise(
    smallest_eigenvalues: Values,
    counts: Integers,
    calm: tuple[float, float] = NOISE_QUANTILE,
) -> float:
    """Standard deviation (m) of points about their surface, from local fits (N,) with `counts` points each.

    A variance from k points has k − 3 degrees of freedom. Neighbourhoods across edges have large ones,
    so a low quantile is read and turned into a mean by the quantile of χ² (Wilson and Hilferty's
    approximation).
    """
    freedom = np.maximum(counts - 3, 1)
    variance = quantile(smallest_eigenvalues * counts / freedom, calm[0])
    d = median(freedom)
    share = (1.0 - 2.0 / (9.0 * d) + calm[1] * np.sqrt(2.0 / (9.0 * d))) ** 3
    return float(min(max(np.sqrt(variance / share), MIN_NOISE), MAX_NOISE))


Sums = NDArray[np.float64]
"""(K, 10): the number of points, then the sums of x, y, z, xx, xy, xz, yy, yz, zz of each of K sets."""


def sums_of(xyz: Points, group: Integers, count: int) -> Sums:
    """Sums (count, 10) of the points (N, 3) of each group (N,) 0…count-1.

    Heights should be counted from a level near the points: squares of world heights lose the noise.
    """
    return np.asarray(sums_kernel(xyz, group, count))


@kernel
def sums_kernel(xyz: Points, group: Integers, count: int) -> Sums:
    """See `sums_of`."""
    sums = np.zeros((count, 10))
    for i in range(len(xyz)):
        add_point_kernel(sums[group[i]], xyz[i, 0], xyz[i, 1], xyz[i, 2], 1.0)
    return sums


def scatter(sums: Sums) -> tuple[Points, NDArray[np.float64]]:
    """Centroids (K, 3) and covariance matrices (K, 3, 3) of sets with at least one point each."""
    n = sums[:, :1]
    centre = sums[:, 1:4] / n
    mean = sums[:, 4:] / n
    full = mean[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
    return centre, full - centre[:, :, None] * centre[:, None, :]


def plane_rmse(sums: Sums) -> Values:
    """Root mean square distance (K,) of each set from its best plane (total least squares)."""
    _, covariance = scatter(sums)
    smallest = np.linalg.eigvalsh(covariance)[:, 0]
    return np.asarray(np.sqrt(np.maximum(smallest, 0.0)), np.float64)


def fit_planes(sums: Sums) -> tuple[Points, Points, Values]:
    """Centroids (K, 3), upward unit normals (K, 3) and RMSE (K,) of the best planes (total least squares)."""
    centre, covariance = scatter(sums)
    values, vectors = np.linalg.eigh(covariance)
    normal = vectors[:, :, 0]
    normal = np.where(normal[:, 2:] < 0, -normal, normal)
    return centre, normal, np.sqrt(np.maximum(values[:, 0], 0.0))


NEIGHBOURS = 24
"""Points of a neighbourhood: at 4 points/m², the paper's, a disc of 1.4 m."""
WALL_ANGLE_DEG = 70.0
"""Normals that far from the vertical are walls: no roof is built steeper, but for mansards."""
SMOOTH_ANGLE_DEG = 9.0
"""Largest angle between the normals of neighbours on one surface: roofs and streets pass, crowns break up."""
NOISE_AREA_M2 = 5.0
"""Smaller smooth regions are noise: a bird, a crown, a chimney."""
TREE_SHARE = 0.5
"""Share of later echoes around a point that makes it a tree's: most of them. Rims and gardens on roofs have
fewer."""


def find_walls_and_trees(
    cloud: PointCloud,
    neighbours: int = NEIGHBOURS,
    wall_angle: float = WALL_ANGLE_DEG,
    tree_share: float = TREE_SHARE,
) -> NDArray[np.uint8]:
    """WALL, TREE or 0 for each of the points (N,): walls leave first, then trees among what is left."""
    part = np.zeros(len(cloud), np.uint8)
    if len(cloud) <= neighbours:
        return part
    upright = np.abs(local_planes(cloud.xyz, neighbours, neighbours).normals[:, 2])
    part[upright < np.cos(np.radians(wall_angle))] = WALL
    unassigned = np.flatnonzero(part == 0)
    if not cloud.has_returns or cloud.return_number is None or len(unassigned) <= neighbours:
        return part
    around = local_planes(cloud.xyz[unassigned], neighbours, neighbours).neighbours
    later = (cloud.return_number[unassigned] > 1).astype(np.float64)
    part[unassigned[later[around].mean(axis=1) > tree_share]] = TREE  # eq. 2
    return part


def grow_regions(xyz: Points, planes: LocalPlanes, smooth_angle: float, flat_links: bool = True) -> Integers:
    """Region (N,), counted from 0: connected points of like normals (degrees), with `flat_links` with no step
    between them."""
    likeness, rise = np.cos(np.radians(smooth_angle)), np.sin(np.radians(smooth_angle))

    def joined(neighbour: Integers) -> Mask:
        link = xyz[neighbour] - xyz
        length = np.sqrt((link**2).sum(axis=1))
        alike = (planes.normals * planes.normals[neighbour]).sum(axis=1) > likeness
        off = np.maximum(
            np.abs((link * planes.normals).sum(axis=1)),
            np.abs((link * planes.normals[neighbour]).sum(axis=1)),
        )
        flat = off <= np.maximum(rise * length, 3.0 * planes.noise)
        return np.asarray(alike & flat if flat_links else alike)

    return connected_points(planes, joined).astype(np.int64)


def euclidean_components(xyz: Points, planes: LocalPlanes, join: float) -> Labels:
    """Numbers (N,) from 0 of the connected components: neighbours nearer than `join` (m) are one."""

    def joined(neighbour: Integers) -> Mask:
        return np.asarray(((xyz[neighbour] - xyz) ** 2).sum(axis=1) <= join * join)

    return connected_points(planes, joined)


def connected_points(planes: LocalPlanes, joined: Callable[[Integers], Mask]) -> Labels:
    """Components (N,) of the graph of neighbours whose link `joined` (others (N,) → mask (N,)) keeps."""
    count, around = len(planes.neighbours), planes.neighbours[:, 1:]
    rows, columns = [], []
    for k in range(around.shape[1]):
        row = np.flatnonzero(joined(around[:, k]))
        rows.append(row)
        columns.append(around[row, k])
    group = connected_groups_kernel(np.concatenate(rows), np.concatenate(columns), count)
    return np.asarray(group, np.int32)


def region_areas(xyz: Points, region: Integers, side: float) -> Values:
    """Area (K,) in m² of each region of points (N, 3): its occupied cells of the given side (m)."""
    cell = np.floor(xyz[:, :2] / side).astype(np.int64)
    cell -= cell.min(axis=0)
    key = (region * (int(cell[:, 0].max()) + 1) + cell[:, 0]) * (int(cell[:, 1].max()) + 1) + cell[:, 1]
    _, first = np.unique(key, return_index=True)
    cells = np.bincount(region[first], minlength=int(region.max()) + 1)
    return np.asarray(cells * (side * side), np.float64)
