"""The cheapest polyline around a ring: few edges, each a line fitted to its stretch of boundary points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import kernel

FREE = -1
"""Axis of an edge that runs in a direction of its own."""


def cheapest_polyline(
    ring: NDArray[np.float64],
    axes: NDArray[np.float64],
    sigma: float,
    price: float,
    angle_cost: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First point of every edge (K,) and its axis (K,) for the cheapest closed polyline along `ring` (M, 2).

    The ring starts at a corner. An edge takes a stretch of the ring, both ends included, and costs half the
    sum of squared distances to its line in units of `sigma` (m), plus `price`; a line in a direction of its
    own costs `angle_cost` more than one along one of `axes` (A,) (radians; axis a has the number a). Two
    edges that follow each other never share an axis. Exact, by dynamic programming over the end of the last
    edge.
    """
    closed = np.concatenate([ring, ring[:1]])
    closed = closed - closed.mean(axis=0)
    x, y = closed.T
    sums = np.zeros((len(closed) + 1, 5))
    sums[1:] = np.cumsum(np.stack([x, y, x * x, x * y, y * y], axis=1), axis=0)
    normals = np.stack([-np.sin(axes), np.cos(axes)], axis=1).reshape(-1, 2)
    starts, axis = polyline_kernel(sums, normals, 0.5 / sigma**2, price, angle_cost)
    return starts, axis


@kernel
def polyline_kernel(
    sums: NDArray[np.float64],
    normals: NDArray[np.float64],
    scale: float,
    price: float,
    angle_cost: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Dynamic programming over prefix sums of moments (M + 2, 5); answers as `cheapest_polyline`."""
    last = len(sums) - 2
    kinds = len(normals) + 1
    free = kinds - 1
    best = np.full((last + 1, kinds), np.inf)
    came = np.full((last + 1, kinds), -1, np.int64)
    came_kind = np.full((last + 1, kinds), -1, np.int64)
    low = np.zeros((last + 1, 2))  # the cheapest, and the cheapest of another kind
    low_kind = np.full((last + 1, 2), free, np.int64)
    for j in range(1, last + 1):
        bound = np.inf
        for i in range(j - 1, -1, -1):
            n = j - i + 1
            mx = (sums[j + 1, 0] - sums[i, 0]) / n
            my = (sums[j + 1, 1] - sums[i, 1]) / n
            sxx = sums[j + 1, 2] - sums[i, 2] - n * mx * mx
            sxy = sums[j + 1, 3] - sums[i, 3] - n * mx * my
            syy = sums[j + 1, 4] - sums[i, 4] - n * my * my
            least = 0.5 * (sxx + syy - np.sqrt((sxx - syy) ** 2 + 4.0 * sxy * sxy))
            least = max(least, 0.0) * scale + price
            if least > bound:  # longer edges only cost more
                break
            for kind in range(kinds):
                if kind == free:
                    cost = least + angle_cost
                    before = 0
                else:
                    a, b = normals[kind, 0], normals[kind, 1]
                    cost = (a * a * sxx + 2.0 * a * b * sxy + b * b * syy) * scale + price
                    before = 1 if i > 0 and low_kind[i, 0] == kind else 0
                cost += low[i, before]
                if cost < best[j, kind]:
                    best[j, kind] = cost
                    came[j, kind] = i
                    came_kind[j, kind] = low_kind[i, before]
            smallest = best[j, 0]
            for kind in range(1, kinds):
                smallest = min(smallest, best[j, kind])
            bound = smallest + angle_cost + price
        first, second = 0, -1
        for kind in range(1, kinds):
            if best[j, kind] < best[j, first]:
                first = kind
        for kind in range(kinds):
            if kind != first and (second < 0 or best[j, kind] < best[j, second]):
                second = kind
        low[j, 0], low_kind[j, 0] = best[j, first], first
        if first == free or second < 0:
            low[j, 1], low_kind[j, 1] = best[j, first], first
        else:
            low[j, 1], low_kind[j, 1] = best[j, second], second
    starts = np.empty(last, np.int64)
    axis = np.empty(last, np.int64)
    count, j, kind = 0, last, low_kind[last, 0]
    while j > 0:
        i = came[j, kind]
        starts[count] = i
        axis[count] = -1 if kind == free else kind
        kind = came_kind[j, kind]
        j = i
        count += 1
    return starts[:count][::-1].copy(), axis[:count][::-1].copy()
