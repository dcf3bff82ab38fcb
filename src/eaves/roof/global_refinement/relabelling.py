"""The labelling of points that costs least: distances to planes, unlike neighbours, a price per plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import kernel
from eaves.model import Labels, Points
from eaves.roof.toolkit.regions import touching_kernel


@kernel
def relabel_kernel(
    xyz: NDArray[np.float64],
    neighbours: NDArray[np.int64],
    planes: NDArray[np.float64],
    weights: NDArray[np.float64],
    outlier: float,
    smoothness: float,
    sweeps: int,
    labels: NDArray[np.int32],
) -> int:
    """Number of points that changed their label (N,) while each in turn took the cheapest one around it.

    A label costs half the squared distance from its plane (K, 4) times its weight (K,), or `outlier`
    for none (0), and `smoothness` times the share of the `neighbours` (N, M) that have another label.
    """
    changed = 0
    width = neighbours.shape[1]
    # The choice of a point hangs on the labels around it alone: it is made again when one of them changed.
    last_change = np.full(len(xyz), -1)
    for sweep in range(sweeps):
        moved = 0
        for i in range(len(xyz)):
            before = (sweep - 1) * len(xyz) + i
            first = labels[neighbours[i, 0]]
            alike, fresh = True, sweep > 0
            for column in range(width):
                j = neighbours[i, column]
                alike &= labels[j] == first
                fresh &= last_change[j] < before
            if fresh:
                continue
            best, winner = np.inf, labels[i]
            for column in range(width + 1):
                if column > 0 and alike and (column < width or best <= outlier):
                    continue
                label = labels[neighbours[i, column]] if column < width else 0
                seen = False
                for earlier in range(column if label != 0 else 0):
                    if labels[neighbours[i, earlier]] == label:
                        seen = True
                        break
                if seen:
                    continue
                if label == 0:
                    cost = outlier
                else:
                    plane = planes[label - 1]
                    away = plane[0] * xyz[i, 0] + plane[1] * xyz[i, 1] + plane[2] * xyz[i, 2] - plane[3]
                    cost = 0.5 * away * away * weights[label - 1]
                others = 0
                for other in range(1, width):
                    if labels[neighbours[i, other]] != label:
                        others += 1
                cost += smoothness * others / max(width - 1, 1)
                if cost < best - 1e-12:
                    best, winner = cost, label
            if winner != labels[i]:
                labels[i] = winner
                last_change[i] = sweep * len(xyz) + i
                moved += 1
        changed += moved
        if moved == 0:
            break
    return changed


@kernel
def worth_kernel(
    xyz: NDArray[np.float64],
    neighbours: NDArray[np.int64],
    planes: NDArray[np.float64],
    weights: NDArray[np.float64],
    outlier: float,
    smoothness: float,
    labels: NDArray[np.int32],
    worth: NDArray[np.float64],
) -> None:
    """The saving by every plane (K,): the cost of its points without it, less the cost with it.

    Without it a point goes to the cheapest of the planes that touch it, or becomes an outlier; with it, it
    pays for neighbours of other labels. So a plane that passes through a crown by chance saves little.
    """
    count = len(planes)
    touching = touching_kernel(neighbours, labels, count)
    beside = np.empty((count + 1, count), np.int64)
    sizes = np.zeros(count + 1, np.int64)
    for own in range(1, count + 1):
        for label in range(1, count + 1):
            if label == own or touching[own, label]:
                beside[own, sizes[own]] = label
                sizes[own] += 1
    for i in range(len(xyz)):
        own = labels[i]
        if own == 0:
            continue
        cheapest, inner = outlier, 0.0
        for label in beside[own, : sizes[own]]:
            plane = planes[label - 1]
            away = plane[0] * xyz[i, 0] + plane[1] * xyz[i, 1] + plane[2] * xyz[i, 2] - plane[3]
            cost = 0.5 * away * away * weights[label - 1]
            if label == own:
                inner = cost
            elif cost < cheapest:
                cheapest = cost
        others = 0
        for column in range(1, neighbours.shape[1]):
            if labels[neighbours[i, column]] != own:
                others += 1
        inner += smoothness * others / max(neighbours.shape[1] - 1, 1)
        worth[own - 1] += cheapest - inner


def near_regions(labels: Labels, xyz: Points, count: int, gap: float) -> NDArray[np.bool_]:
    """Mask (K, K) of the pairs of regions that come about as near as `gap` (m) in plan: cells that wide
    touch."""
    known = labels > 0
    place = np.floor(xyz[known, :2] / gap).astype(np.int64)
    place -= place.min(axis=0, initial=0) - 1
    wide = int(place.max(initial=0)) + 2
    number = np.unique((place[:, 0] * wide + place[:, 1]) * count + labels[known] - 1)
    near: NDArray[np.bool_] = beside_kernel(number, wide, count)
    return near


@kernel
def beside_kernel(number: NDArray[np.int64], wide: int, count: int) -> NDArray[np.bool_]:
    """Mask (K, K) of the pairs of `count` labels that lie in one cell or in cells that touch. Each `number`
    (M,), ascending, is that of a cell, `wide` to a column, times `count`, and a label in it."""
    near = np.zeros((count, count), np.bool_)
    for one in number:
        cell, label = one // count, one % count
        for step in (0, 1, wide - 1, wide, wide + 1):
            for place in range(np.searchsorted(number, (cell + step) * count), len(number)):
                if number[place] // count != cell + step:
                    break
                other = number[place] % count
                if other != label:
                    near[label, other] = near[other, label] = True
    return near
