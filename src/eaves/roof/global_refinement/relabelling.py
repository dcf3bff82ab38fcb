"""The labelling of points that costs least: distances to planes, unlike neighbours, a price per plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import kernel
from eaves.model import Labels, Mask, Points
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
                if column == width:
                    label = 0
                elif column > 0 and alike:
                    continue
                else:
                    label = labels[neighbours[i, column]]
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
    """What every plane (K,) saves: the cost of its points without it, less the cost with it.

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
        cheapest, mine = outlier, 0.0
        for label in beside[own, : sizes[own]]:
            plane = planes[label - 1]
            away = plane[0] * xyz[i, 0] + plane[1] * xyz[i, 1] + plane[2] * xyz[i, 2] - plane[3]
            cost = 0.5 * away * away * weights[label - 1]
            if label == own:
                mine = cost
            elif cost < cheapest:
                cheapest = cost
        others = 0
        for column in range(1, neighbours.shape[1]):
            if labels[neighbours[i, column]] != own:
                others += 1
        mine += smoothness * others / max(neighbours.shape[1] - 1, 1)
        worth[own - 1] += cheapest - mine


@kernel
def pieces_kernel(neighbours: NDArray[np.int64], labels: NDArray[np.int32], pieces: NDArray[np.int64]) -> int:
    """Number of connected pieces of equal label; `pieces` (N,) receives 0, 1, …, −1 for label 0."""
    queue = np.empty(len(labels), np.int64)
    heads = np.full(len(labels), -1, np.int64)
    width = neighbours.shape[1]
    following = np.full(len(labels) * width, -1, np.int64)
    for i in range(len(labels)):  # the reversed arcs, so that being a neighbour is mutual
        for column in range(1, width):
            j = neighbours[i, column]
            following[i * width + column] = heads[j]
            heads[j] = i * width + column
    pieces[:] = -1
    count = 0
    for seed in range(len(labels)):
        if labels[seed] == 0 or pieces[seed] >= 0:
            continue
        pieces[seed] = count
        queue[0] = seed
        head, length = 0, 1
        while head < length:
            i = queue[head]
            head += 1
            for column in range(1, width):
                j = neighbours[i, column]
                if labels[j] == labels[i] and pieces[j] < 0:
                    pieces[j] = count
                    queue[length] = j
                    length += 1
            arc = heads[i]
            while arc >= 0:
                j = arc // width
                if labels[j] == labels[i] and pieces[j] < 0:
                    pieces[j] = count
                    queue[length] = j
                    length += 1
                arc = following[arc]
        count += 1
    return count


def drop_crumbs(labels: Labels, neighbours: NDArray[np.int64], fewest: int) -> Labels:
    """Labels (N,) without the pieces of fewer than `fewest` points that lie apart from their plane."""
    pieces = np.zeros(len(labels), np.int64)
    count = pieces_kernel(neighbours, labels, pieces)
    if count == 0:
        return labels
    sizes = np.bincount(pieces[pieces >= 0], minlength=count)
    crumb = np.append(sizes < fewest, False)
    if not crumb.any():
        return labels
    return np.where(crumb[pieces], 0, labels).astype(np.int32)


def near_regions(labels: Labels, xyz: Points, count: int, gap: float) -> NDArray[np.bool_]:
    """Which of K regions come about as near as `gap` (m) in plan (K, K): cells that wide touch."""
    if count == 0 or len(xyz) == 0:
        return np.zeros((count, count), bool)
    cell = np.floor(xyz[:, :2] / gap).astype(np.int64)
    cell -= cell.min(axis=0) - 1
    columns = int(cell[:, 0].max()) + 2
    place = cell[:, 1] * columns + cell[:, 0]
    pairs = np.unique(place[labels > 0] * np.int64(count) + labels[labels > 0] - 1)
    where, label = pairs // count, pairs % count
    first = np.searchsorted(where, np.arange(int(place.max()) + columns + 3))
    return np.asarray(near_kernel(label, first, columns, count))


@kernel
def near_kernel(label: NDArray[np.int64], first: NDArray[np.int64], columns: int, count: int) -> Mask:
    """Which of K labels share a cell or have cells side by side (K, K), of a grid with a rim of empty ones.

    Cell c of rows of `columns` has the labels `first[c]` to `first[c + 1]`.
    """
    near = np.zeros((count, count), np.bool_)
    for cell in range(len(first) - 1):
        for one in range(first[cell], first[cell + 1]):
            for step in (0, 1, columns - 1, columns, columns + 1):
                for other in range(first[cell + step], first[cell + step + 1]):
                    near[label[one], label[other]] = near[label[other], label[one]] = True
    for one in range(count):
        near[one, one] = False
    return near
