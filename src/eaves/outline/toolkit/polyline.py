"""The cheapest polyline around a ring: few sides, each along one of few directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import kernel
from eaves.model import Values

FREE = -1
"""Axis of an edge that runs in a direction of its own."""
ANY = -1
"""The polyline may start along any direction."""


@dataclass(frozen=True)
class Prices:
    """Costs of the parts of a polyline, in nats: minus the logarithm of their probability."""

    corner: float
    """A corner of 90°; one that turns by τ costs 1 / |sin τ| times that, as its place is less sure."""
    direction: float
    """A side that does not follow the first frame of directions."""
    stray: float
    """A boundary point that lies on no side."""


def cheapest_polyline(
    ring: NDArray[np.float64],
    axes: NDArray[np.float64],
    sigma: float,
    prices: Prices,
    weight: Values,
    first: int = ANY,
) -> NDArray[np.int64]:
    """First point, last point, direction (K, 3) of each side of the cheapest polyline along `ring` (M, 2).

    `axes` (2 F,) are the directions (radians) of F right-angled frames: φ, φ + 90°, …, the first frame
    first; direction d of a side is axis d // 2, travelled backwards where d is odd. A side takes a stretch
    of the ring, both ends included, that leads along it, and costs half the sum of squared distances to its
    line in units of `sigma` (m), times the `weight` (M,) of each point. Points between two sides
    are on none, at `stray` times their weight. With `first` the ring starts and
    ends within one side of that direction, which is the first and the last of the answer. Exact, by dynamic
    programming over the end of the last side.
    """
    closed = np.concatenate([ring, ring[:1]])
    closed = closed - closed.mean(axis=0)
    x, y = closed.T
    each = np.append(weight, weight[:1])
    sums = np.zeros((len(closed) + 1, 6))
    sums[1:] = np.cumsum(
        each[:, None] * np.stack([x, y, x * x, x * y, y * y, np.ones_like(x)], axis=1), axis=0
    )
    angle = travel_angles(axes)
    way = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    sine = np.abs(np.sin(angle[:, None] - angle))
    turn = np.where(sine > 1e-6, prices.corner / np.maximum(sine, 1e-6), np.inf)
    own = np.where(np.arange(len(angle)) < 4, 0.0, prices.direction) if first != ANY else np.zeros(len(angle))
    return np.asarray(polyline_kernel(closed, sums, way, turn, own, 0.5 / sigma**2, prices.stray, first))


def travel_angles(axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """The angle (2 A,) of travel along each axis (A,), in radians: there and back."""
    return np.stack([axes, axes + np.pi], axis=1).ravel()


@kernel
def polyline_kernel(
    ring: NDArray[np.float64],
    sums: NDArray[np.float64],
    way: NDArray[np.float64],
    turn: NDArray[np.float64],
    own: NDArray[np.float64],
    scale: float,
    stray: float,
    first: int,
) -> NDArray[np.int64]:
    """Dynamic programming over prefix sums of moments and weights (M + 2, 6); answers as `cheapest_polyline`.

    `best` is the least cost of a polyline whose last side ends at a point, `low` of one whose next side
    starts there; a turn from one direction to the next costs `turn` (D, D), a side `own` (D,).
    """
    last, kinds = len(ring) - 1, len(way)
    best = np.full((last + 1, kinds), np.inf)
    came = np.full((last + 1, kinds), -1, np.int64)
    low = np.full((last + 1, kinds), np.inf)
    left = np.zeros((last + 1, kinds), np.int64)
    left_kind = np.full((last + 1, kinds), -1, np.int64)
    for kind in range(kinds):
        if first < 0 or kind == first:
            low[0, kind] = 0.0
    dearest = own.max() + turn.min()
    for j in range(1, last + 1):
        for i in range(j - 1, -1, -1):
            n = sums[j + 1, 5] - sums[i, 5]
            mx = (sums[j + 1, 0] - sums[i, 0]) / n
            my = (sums[j + 1, 1] - sums[i, 1]) / n
            sxx = sums[j + 1, 2] - sums[i, 2] - n * mx * mx
            sxy = sums[j + 1, 3] - sums[i, 3] - n * mx * my
            syy = sums[j + 1, 4] - sums[i, 4] - n * my * my
            least = 0.5 * (sxx + syy - np.sqrt((sxx - syy) ** 2 + 4.0 * sxy * sxy)) * scale
            if least > stray * n + 2.0 * dearest:  # leaving all of them out costs less
                break
            dx, dy = ring[j, 0] - ring[i, 0], ring[j, 1] - ring[i, 1]
            for kind in range(kinds):
                a, b = way[kind, 0], way[kind, 1]
                if low[i, kind] == np.inf or a * dx + b * dy <= 0.0:
                    continue
                cost = (b * b * sxx - 2.0 * a * b * sxy + a * a * syy) * scale + own[kind] + low[i, kind]
                if cost < best[j, kind]:
                    best[j, kind] = cost
                    came[j, kind] = i
        for kind in range(kinds):
            low[j, kind] = low[j - 1, kind] + stray * (sums[j + 1, 5] - sums[j, 5])
            left[j, kind] = left[j - 1, kind]
            left_kind[j, kind] = left_kind[j - 1, kind]
            for before in range(kinds):
                cost = best[j, before] + turn[before, kind]
                if cost < low[j, kind]:
                    low[j, kind] = cost
                    left[j, kind] = j
                    left_kind[j, kind] = before
    j, kind, cheapest = 0, -1, np.inf
    for end in range(1, last + 1):
        for one in range(kinds):
            cost = best[end, one] + stray * (sums[last, 5] - sums[end, 5])
            if (first < 0 or one == first) and cost < cheapest:
                j, kind, cheapest = end, one, cost
    sides = np.empty((last, 3), np.int64)
    count = 0
    while kind >= 0:
        i = came[j, kind]
        sides[count] = i, j, kind
        count += 1
        j, kind = left[i, kind], left_kind[i, kind]
    return sides[:count][::-1].copy()
