"""Pairs of neighbouring cells, and the groups of cells that some of the pairs join."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.geometry.components import connected_groups_kernel
from eaves.model import Integers, Labels, Mask, Values

Step = tuple[int, int]
BESIDE: tuple[Step, ...] = ((0, 1), (1, 0))
"""Steps down and right to two of the four cells that share a side with a cell: the others step back to it."""
ONWARD: tuple[Step, ...] = (*BESIDE, (1, 1), (1, -1))
"""The same to four of the eight neighbours."""
SORTED_FROM = 4
"""So many times as many values as there are lie between the least and the greatest: they are sorted."""


def steps_within(reach: int) -> tuple[Step, ...]:
    """Steps to half of the cells at most `reach` rows and columns away."""
    return tuple(
        (down, right)
        for down in range(reach + 1)
        for right in range(-reach, reach + 1)
        if down > 0 or right > 0
    )


def neighbour_pairs(mask: Mask, steps: tuple[Step, ...] = ONWARD) -> tuple[Integers, Integers]:
    """Flat numbers of all pairs of cells a step apart that are both set in `mask` (H, W)."""
    pairs = []
    for step in steps:
        a, b = shifted(mask.shape, step)
        pairs.append(numbers_in(mask[a] & mask[b], step, mask.shape))
    first, second = zip(*pairs, strict=True)
    return np.concatenate(first), np.concatenate(second)


def shifted(shape: tuple[int, ...], step: Step) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """The cells (H, W) from which a step down and right leads to another, and those it leads to."""
    (rows, columns), (down, right) = shape, step
    return (
        (slice(0, max(0, rows - down)), slice(max(0, -right), max(0, columns - max(0, right)))),
        (slice(down, rows), slice(max(0, right), max(0, columns - max(0, -right)))),
    )


def numbers_in(linked: Mask, step: Step, shape: tuple[int, ...]) -> tuple[Integers, Integers]:
    """Flat numbers in a raster of a shape (H, W) of the cells set among those of `shifted`, and of those that
    the step leads to."""
    row, column = np.nonzero(linked)
    here = row * shape[1] + column + max(0, -step[1])
    return here, here + step[0] * shape[1] + step[1]


def group_cells(mask: Mask, first: Integers, second: Integers) -> tuple[Labels, int]:
    """Numbers (H, W) of the groups of cells of a mask that pairs (K,) of them join, 0 elsewhere, in the order
    of their first cells; how many there are."""
    cells = np.flatnonzero(mask)
    place = np.zeros(mask.size, np.int64)
    place[cells] = np.arange(len(cells))
    group = connected_groups_kernel(place[first], place[second], len(cells))
    label = np.zeros(mask.shape, np.int32)
    label.ravel()[cells] = group + 1
    return label, int(group.max(initial=-1)) + 1


def grown_by_square(mask: Mask, size: int) -> Mask:
    """The cells (H, W) that a square of `size` cells about one of a mask (H, W) covers."""
    return any_near(mask, size // 2 - size + 1, size // 2)


def shrunk_by_square(mask: Mask, size: int) -> Mask:
    """The cells (H, W) about which a square of `size` cells lies in a mask (H, W), and in the raster."""
    inside = ~any_near(~mask, -(size // 2), size - 1 - size // 2)
    for axis in (0, 1):
        line = np.moveaxis(inside, axis, 0)
        line[: size // 2] = False
        line[max(0, len(line) - (size - 1 - size // 2)) :] = False
    return inside


def opened_by_square(mask: Mask, size: int) -> Mask:
    """The cells (H, W) of a mask that squares of `size` cells within it cover."""
    return grown_by_square(shrunk_by_square(mask, size), size)


def closed_by_square(mask: Mask, size: int) -> Mask:
    """The cells (H, W) that a mask grown by squares of `size` cells keeps when it is shrunk by them."""
    return shrunk_by_square(grown_by_square(mask, size), size)


def any_near(mask: Mask, first: int, last: int) -> Mask:
    """Mask (H, W) of the cells that have a set cell of a mask `first` to `last` rows, and columns, away."""
    for axis in (0, 1):
        grown = np.zeros(mask.shape, bool)
        line, source = np.moveaxis(grown, axis, 0), np.moveaxis(mask, axis, 0)
        for step in range(max(first, -len(line)), min(last, len(line)) + 1):
            line[max(0, -step) : len(line) - max(0, step)] |= source[max(0, step) : len(line) + min(0, step)]
        mask = grown
    return mask


def number_squares(xy: Values, side: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The number (N,), from west to east and in each column from south to north, of the square of a side (m)
    that each place (N, 2) lies in, among those that hold one; and how many places each holds (K,)."""
    column, row = (np.floor(values / side).astype(np.int64) for values in xy.T)
    row -= row.min()
    column -= column.min()
    return number_values(column * (row.max() + 1) + row)[1:]


def number_values(values: Integers) -> tuple[Integers, Integers, Integers]:
    """The values (K,) that occur among some (N,), rising; the number (N,) of each among these, and how often
    each occurs (K,). Values that lie close are counted, others sorted."""
    low = values.min(initial=0)
    if values.max(initial=0) - low > SORTED_FROM * len(values):
        unique, number, count = np.unique(values, return_inverse=True, return_counts=True)
        return unique, number.ravel(), count
    count = np.bincount(values - low)
    unique = np.flatnonzero(count)
    number = np.cumsum(count > 0) - 1
    return unique + low, number[values - low], count[unique]
