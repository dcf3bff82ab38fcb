"""Sums that tell how well one plane fits a set of points; sets are united by adding their sums.

For many sets at once; `planes` has the same ten sums for one set at a time, inside kernels.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import kernel
from eaves.model import Points, Values

Sums = NDArray[np.float64]
"""(K, 10): the number of points, then the sums of x, y, z, xx, xy, xz, yy, yz, zz of each of K sets."""


def sums_of(xyz: Points, group: NDArray[np.int64], count: int) -> Sums:
    """Sums (count, 10) of the points (N, 3) of each group (N,) 0…count-1.

    Heights should be counted from a level near the points: squares of world heights lose the noise.
    """
    return np.asarray(sums_kernel(xyz, group, count))


@kernel
def sums_kernel(xyz: Points, group: NDArray[np.int64], count: int) -> Sums:
    """See `sums_of`."""
    sums = np.zeros((count, 10))
    for i in range(len(xyz)):
        x, y, z, total = xyz[i, 0], xyz[i, 1], xyz[i, 2], sums[group[i]]
        total[0] += 1.0
        total[1] += x
        total[2] += y
        total[3] += z
        total[4] += x * x
        total[5] += x * y
        total[6] += x * z
        total[7] += y * y
        total[8] += y * z
        total[9] += z * z
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
