"""Density and neighbourhoods of points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import kernel
from eaves.model import Integers, Points, Values
from eaves.model.checks import check_positive

POINTS_PER_CELL = 8
"""Mean number of points in a cell that is occupied: of mean 8, one Poisson cell in 3,000 is empty."""
FINEST_M = 0.5
"""Side of the first cells that are tried; a power of two, so that counting is exact at every width."""
TABLE_CELLS = 64
"""Cells are counted in a table of no more cells for each point; points farther apart are rare, and sorted."""


SPACINGS_PER_CELL = 2.0
"""Side of the cells, in spacings, in which the nearest points are looked for: four points in each."""


def nearest(queries: Points, xyz: Points, count: int) -> tuple[Integers, Values]:
    """The `count` nearest (M, K) of points (N, 3) to queries (M, 3), nearest first, K = min(count, N), and
    their distances (M, K)."""
    side = SPACINGS_PER_CELL * measure_spacing(xyz)
    neighbours, squares = nearest_kernel(queries, xyz, side, min(count, len(xyz)))
    return neighbours, np.sqrt(squares)


@kernel
def nearest_kernel(queries: Points, xyz: Points, side: float, count: int) -> tuple[Integers, Values]:
    """The numbers (M, count) and squared distances (M, count) of the points nearest to queries (M, 3).

    Points (N, 3), N ≥ `count`, are looked up by cells of plan of a `side` (m), ring by ring around the cell
    of the query, until what is left is farther than those found; of equals the first in the table is first.
    """
    west, south, east, north = np.inf, np.inf, -np.inf, -np.inf
    for i in range(len(xyz)):
        west, east = min(west, xyz[i, 0]), max(east, xyz[i, 0])
        south, north = min(south, xyz[i, 1]), max(north, xyz[i, 1])
    while ((east - west) / side + 1.0) * ((north - south) / side + 1.0) > TABLE_CELLS * len(xyz):
        side *= 2.0
    columns, rows = int((east - west) / side) + 1, int((north - south) / side) + 1
    cell, first = np.empty(len(xyz), np.int64), np.zeros(columns * rows + 1, np.int64)
    for i in range(len(xyz)):
        cell[i] = int((xyz[i, 1] - south) / side) * columns + int((xyz[i, 0] - west) / side)
        first[cell[i] + 1] += 1
    for number in range(columns * rows):
        first[number + 1] += first[number]
    last, order, table = first[:-1].copy(), np.empty(len(xyz), np.int64), np.empty((len(xyz), 3))
    for i in range(len(xyz)):
        place = last[cell[i]]
        order[place], last[cell[i]] = i, place + 1
        table[place, 0], table[place, 1], table[place, 2] = xyz[i, 0], xyz[i, 1], xyz[i, 2]
    neighbours, squares = np.empty((len(queries), count), np.int64), np.full((len(queries), count), np.inf)
    for query in range(len(queries) if count else 0):
        x, y, z = queries[query, 0], queries[query, 1], queries[query, 2]
        own_column, own_row = int(np.floor((x - west) / side)), int(np.floor((y - south) / side))
        inward = min(x - west - own_column * side, y - south - own_row * side)
        inward = min(inward, side - (x - west - own_column * side), side - (y - south - own_row * side))
        ranked, numbers, ring, farthest = squares[query], neighbours[query], 0, np.inf
        while farthest > max((ring - 1) * side + inward, 0.0) ** 2 or ring == 0:
            for row in range(max(own_row - ring, 0), min(own_row + ring, rows - 1) + 1):
                step = 1 if abs(row - own_row) == ring else 2 * ring
                for column in range(own_column - ring, own_column + ring + 1, step):
                    if column < 0 or column >= columns:
                        continue
                    for place in range(first[row * columns + column], first[row * columns + column + 1]):
                        dx, dy, dz = table[place, 0] - x, table[place, 1] - y, table[place, 2] - z
                        square = dx * dx + dy * dy + dz * dz
                        if square >= farthest:
                            continue
                        slot = count - 1
                        while slot > 0 and ranked[slot - 1] > square:
                            ranked[slot], numbers[slot] = ranked[slot - 1], numbers[slot - 1]
                            slot -= 1
                        ranked[slot], numbers[slot] = square, order[place]
                        farthest = ranked[count - 1]
            ring += 1
    return neighbours, squares


@kernel
def thin_kernel(quanta: NDArray[np.int32], last: NDArray[np.uint8], side: int) -> Integers:
    """The number (N,) of the point that stands for each: one for all those of a cell and of as much height,
    counted from the lowest there, the middle by height.

    Parameters
    ----------
    quanta : ndarray (N, 3) of int32
        Points, in whole steps of `GRID_STEP`, x and y ≥ 0. The answer does not depend on their order.
    last : ndarray (N,) of uint8
        Decides between points at one place.
    side : int
        Side of the cells (steps, below 2,048), which begin at (0, 0), and height of their levels.
    """
    columns, south = quanta[:, 0].max() // side + 1, quanta[:, 1].min() // side
    rows = quanta[:, 1].max() // side + 1 - south
    first = np.zeros(rows * columns + 1, np.int64)
    cell, stands = np.empty(len(quanta), np.int64), np.empty(len(quanta), np.int64)
    for i in range(len(quanta)):
        cell[i] = (quanta[i, 1] // side - south) * columns + quanta[i, 0] // side
        first[cell[i] + 1] += 1
    for number in range(rows * columns):
        first[number + 1] += first[number]
    free, order, keys = first[:-1].copy(), np.empty(len(quanta), np.int64), np.empty(len(quanta), np.int64)
    for i in range(len(quanta)):
        place = free[cell[i]]
        free[cell[i]] = place + 1
        # by height, then by y and x within the cell: 32 + 11 + 11 + 8 bits
        level = (np.int64(quanta[i, 2]) * 2048 + quanta[i, 1] % side) * 2048 + quanta[i, 0] % side
        order[place], keys[place] = i, level * 256 + last[i]
    for number in range(rows * columns):
        start, end = first[number], first[number + 1]
        gap = (end - start) // 2
        while gap > 0:  # Shell's order: few are there, but for walls
            for place in range(start + gap, end):
                key, i, hole = keys[place], order[place], place
                while hole >= start + gap and keys[hole - gap] > key:
                    keys[hole], order[hole] = keys[hole - gap], order[hole - gap]
                    hole -= gap
                keys[hole], order[hole] = key, i
            gap //= 2
        low = start
        while low < end:
            level = ((keys[low] >> 30) - (keys[start] >> 30)) // side
            high = low
            while high < end and ((keys[high] >> 30) - (keys[start] >> 30)) // side == level:
                high += 1
            stands[order[low:high]] = order[low + (high - low) // 2]
            low = high
    return stands


def measure_spacing(xyz: Points) -> float:
    """Mean spacing (m) of points (N, 2 or 3) in plan: 1 / √density over the area where there are points.

    The area is counted in cells widened until the occupied ones hold `POINTS_PER_CELL` on average, so
    that gaps (water, the outside of an oblique scene) do not lower the density.
    """
    if len(xyz) < 2:
        return 1.0
    return float(spacing_kernel(xyz))


def given_spacing(spacing: float | None, xyz: Points) -> float:
    """A spacing (m) that was given, checked, or that of points (N, 2 or 3) that have coordinates."""
    if spacing is None:
        return measure_spacing(xyz)
    check_positive(spacing, "spacing")
    return spacing


@kernel
def spacing_kernel(xyz: Points) -> float:
    """The spacing (m) as `measure_spacing` says."""
    count = len(xyz)
    west, south, east, north = np.inf, np.inf, -np.inf, -np.inf
    for i in range(count):
        west, east = min(west, xyz[i, 0]), max(east, xyz[i, 0])
        south, north = min(south, xyz[i, 1]), max(north, xyz[i, 1])
    side = FINEST_M
    occupied = np.zeros((0, 0), np.bool_)
    while True:
        scale = 1.0 / side  # exact, as sides are powers of two
        columns, rows = int((east - west) * scale) + 1, int((north - south) * scale) + 1
        filled = 0
        if columns * rows > TABLE_CELLS * count:
            cell = np.empty(count, np.int64)
            for i in range(count):
                cell[i] = int((xyz[i, 1] - south) * scale) * columns + int((xyz[i, 0] - west) * scale)
            cell.sort()
            for i in range(count):
                filled += i == 0 or cell[i] != cell[i - 1]
        else:
            finer = occupied
            occupied = np.zeros((rows, columns), np.bool_)
            if finer.size == 0:
                for i in range(count):
                    occupied[int((xyz[i, 1] - south) * scale), int((xyz[i, 0] - west) * scale)] = True
            else:  # cells twice as wide hold four whole ones
                for row in range(finer.shape[0]):
                    for column in range(finer.shape[1]):
                        if finer[row, column]:
                            occupied[row // 2, column // 2] = True
            for row in range(rows):
                for column in range(columns):
                    filled += occupied[row, column]
        if count >= POINTS_PER_CELL * filled or filled == 1:
            return float(np.sqrt(filled * side * side / count))
        side *= 2.0
