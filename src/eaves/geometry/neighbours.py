"""Density and neighbourhoods of points."""

from __future__ import annotations

import numpy as np

from eaves.kernels import kernel
from eaves.model import Integers, Points, Values

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


def thin(xyz: Points, side: float) -> tuple[Integers, Integers, Integers]:
    """One point for all those of a cell of `side` (m) and of as much height, counted from the lowest there.

    Parameters
    ----------
    xyz : ndarray (N, 3)
        Local metres.
    side : float
        Side (m) of the cells, which begin at (0, 0).

    Returns
    -------
    chosen : ndarray (K,) of int64
        The numbers of the points that are kept, ascending: of each group the middle by height.
    others : ndarray (N - K,) of int64
        The numbers of the rest, group by group in the order of `chosen`.
    counts : ndarray (K,) of int64
        How many of `others` each group has.
    """
    column, row = np.floor(xyz[:, :2] / side).astype(np.int64).T
    order = np.lexsort((xyz[:, 2], column, row))
    column, row, height = column[order], row[order], xyz[order, 2]
    first = np.ones(len(order), bool)
    first[1:] = (np.diff(column) != 0) | (np.diff(row) != 0)
    lowest = height[first][np.cumsum(first) - 1]
    level = ((height - lowest) / side).astype(np.int64)
    first[1:] |= np.diff(level) != 0
    start, group = np.flatnonzero(first), np.cumsum(first) - 1
    size = np.diff(start, append=len(order))
    middle = start + size // 2
    rank = np.argsort(order[middle])
    place = np.empty(len(start), np.int64)
    place[rank] = np.arange(len(start))
    rest = np.ones(len(order), bool)
    rest[middle] = False
    by_group = np.argsort(place[group[rest]], kind="stable")
    return order[middle][rank], order[rest][by_group], size[rank] - 1


def measure_spacing(xyz: Points) -> float:
    """Mean spacing (m) of points (N, 2 or 3) in plan: 1 / √density over the area where there are points.

    The area is counted in cells widened until the occupied ones hold `POINTS_PER_CELL` on average, so
    that gaps (water, the outside of an oblique scene) do not lower the density.
    """
    if len(xyz) < 2:
        return 1.0
    return float(spacing_kernel(xyz))


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
