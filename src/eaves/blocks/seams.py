"""By how much two inputs differ in height where they overlap or adjoin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from eaves.model import Block, Bounds, Points
from eaves.raster.blur import number_squares

Heights = Mapping[tuple[int, int], NDArray[np.float64]]
"""Pair of inputs, by number → differences (N,) of the heights of the second and the first (m)."""

CELLS = 1.5, 3.0, 6.0
"""Sides (m) of the cells in which each input has a plane; those that allow more comparisons are taken. Whole
cells fill a block."""
REACH = 6.0
"""Distance (m) from the area that two inputs share of the points that are compared."""
LOW = 0.5
"""The ground of a cell is among the points that lie so little (m) over its lowest: no crown, no car."""
FEWEST_POINTS, ROUGH, STEEP, NARROW = 6, 0.1, 1.0, 0.005
"""A plane takes so many points, which lie within so much (m) of it (root mean square); it rises by less than
this, and the variance of the points is over this share of the cell's area in every direction."""
ENOUGH_POINTS, ENOUGH_PLACES = 60_000, 200
"""Of so many points of an input in a block, and of so many places there, those evenly spread are taken."""
PLACES, STEP, AGREE = 12, 0.2, 75.0
"""A step takes so many places and metres, and in so many of a hundred places it is met within its half: walls
that stand along a part of a seam are none."""


@dataclass(frozen=True, eq=False)
class Planes:
    """Planes of an input, a cell each: column and row (N, 2), rising; centre (N, 3), slopes (N, 2)."""

    cell: NDArray[np.int64]
    centre: Points
    slope: NDArray[np.float64]


def shared_places(boxes: NDArray[np.float64], block: Block) -> Bounds | None:
    """Bounds within a block and its rim where boxes (N, 4) of inputs overlap or adjoin; None for nowhere."""
    window = np.array(list(block.bounds.buffered(REACH)))
    low, high = np.maximum(boxes[:, :2], window[:2]), np.minimum(boxes[:, 2:], window[2:])
    found = None
    for a, b in combinations(np.flatnonzero((low < high).all(axis=1)), 2):
        corner, end = np.maximum(low[a], low[b]) - REACH, np.minimum(high[a], high[b]) + REACH
        if (end - corner > REACH).all():
            corner, end = np.maximum(corner, window[:2]), np.minimum(end, window[2:])
            place = Bounds(*map(float, (*corner, *end)))
            found = place if found is None else found.union(place)
    return found


def compare_heights(block: Block, points: Mapping[int, Sequence[Points]]) -> Heights:
    """The differences of the heights of inputs in a block.

    Each input has a plane in every cell where its lowest points are flat. Two planes in one cell, or in cells
    side by side, are compared half-way between their centres: slopes are no steps, and what is rough is left
    out.

    Parameters
    ----------
    block : Block
        The block; a pair of cells counts where the first of them lies in it.
    points : mapping
        Number of an input to its points (N, 3) about the block's corner (m), in pieces.
    """
    clouds = {number: np.concatenate(points[number]) for number in sorted(points)}
    found: dict[tuple[int, int], NDArray[np.float64]] = {}
    for cell in CELLS:
        planes = {number: planes_of(xyz, cell) for number, xyz in clouds.items()}
        for a, b in combinations(planes, 2):
            values = differences(planes[a], planes[b], round(block.side / cell))
            if len(values) > len(found.get((a, b), ())):
                found[a, b] = values
    return {pair: values[:: -(-len(values) // ENOUGH_PLACES)] for pair, values in found.items()}


def planes_of(xyz: Points, side: float) -> Planes:
    """The planes of the lowest of points (N, 3) in the cells of a side (m) where these are flat."""
    xyz = xyz[:: max(len(xyz) // ENOUGH_POINTS, 1)]
    place = np.floor(xyz[:, :2] / side).astype(np.int64)
    of, count = number_squares(xyz[:, :2], side)
    cell, lowest = np.empty((len(count), 2), np.int64), np.full(len(count), np.inf)
    cell[of] = place
    np.minimum.at(lowest, of, xyz[:, 2])
    low = xyz[:, 2] < lowest[of] + LOW
    xyz, of = xyz[low], of[low]
    many = np.bincount(of, minlength=len(cell))
    centre = np.column_stack([np.bincount(of, values, len(cell)) / many for values in xyz.T])
    x, y, z = (xyz - centre[of]).T
    xx, xy, yy, xz, yz, zz = (
        np.bincount(of, a * b, len(cell)) / many for a, b in ((x, x), (x, y), (y, y), (x, z), (y, z), (z, z))
    )
    least = (xx + yy) / 2 - np.hypot((xx - yy) / 2, xy)
    wide = (many >= FEWEST_POINTS) & (least > NARROW * side**2)
    area = np.where(wide, xx * yy - xy**2, 1.0)
    slope = np.column_stack([yy * xz - xy * yz, xx * yz - xy * xz]) / area[:, None]
    rest = (zz - slope[:, 0] * xz - slope[:, 1] * yz) * many / np.maximum(many - 3, 1)
    flat = wide & (rest < ROUGH**2) & (np.abs(slope).max(axis=1, initial=0.0) < STEEP)
    return Planes(cell[flat], centre[flat], slope[flat])


def differences(first: Planes, second: Planes, count: int) -> NDArray[np.float64]:
    """By how much (N,) planes of the second input lie over those of the first in the same cells of a block of
    `count` cells a side, and in those side by side."""
    pieces = [rises(first, second, right, up, count) for right, up in ((0, 0), (1, 0), (0, 1))]
    pieces += [-rises(second, first, right, up, count) for right, up in ((1, 0), (0, 1))]
    return np.concatenate(pieces)


def rises(first: Planes, second: Planes, right: int, up: int, count: int) -> NDArray[np.float64]:
    """By how much (N,) the second planes lie over the first ones that are `right` and `up` cells to the west
    and south."""
    inside = np.flatnonzero(((first.cell >= 0) & (first.cell < count)).all(axis=1))
    width = count + round(4 * REACH / min(CELLS))  # with the rim
    key = (first.cell[inside] + (right, up)) @ (width, 1)
    _, i, j = np.intersect1d(key, second.cell @ (width, 1), assume_unique=True, return_indices=True)
    i = inside[i]
    half = (second.centre[j, :2] - first.centre[i, :2]) / 2
    rise = ((first.slope[i] + second.slope[j]) * half).sum(axis=1)
    between: NDArray[np.float64] = second.centre[j, 2] - first.centre[i, 2] - rise
    return between


def find_steps(heights: Sequence[Heights]) -> list[tuple[float, int, int, int]]:
    """The steps between inputs, of the differences in some blocks, the highest first: metres, both inputs,
    and the number of places."""
    found = []
    for a, b in sorted({pair for block in heights for pair in block}):
        values = np.concatenate([block[a, b] for block in heights if (a, b) in block])
        step = float(np.median(values))
        off = float(np.percentile(np.abs(values - step), AGREE))
        if len(values) >= PLACES and abs(step) > max(STEP, 2 * off):
            found.append((step, a, b, len(values)))
    return sorted(found, key=lambda entry: -abs(entry[0]))
