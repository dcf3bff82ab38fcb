"""The lowest and the highest values in squares about each cell."""

from __future__ import annotations

import numpy as np

from eaves.kernels import kernel
from eaves.model import Grid


def lowest_in_squares(values: Grid, radius: int) -> Grid:
    """The lowest value within `radius` rows and columns of each cell (H, W); `values` holds no NaN."""
    return np.asarray(extreme_in_squares_kernel(values, radius, np.float32(1.0)))


def highest_in_squares(values: Grid, radius: int) -> Grid:
    """The highest value within `radius` rows and columns of each cell (H, W); `values` holds no NaN."""
    return np.asarray(extreme_in_squares_kernel(values, radius, np.float32(-1.0)))


@kernel
def least_of(first: Grid, second: Grid, third: Grid, fourth: Grid, least: Grid) -> None:
    """Write the least of four values, one from each array (K,), into a fifth."""
    for i in range(len(least)):
        a = first[i] if first[i] < second[i] else second[i]
        b = third[i] if third[i] < fourth[i] else fourth[i]
        least[i] = a if a < b else b


@kernel
def extreme_in_squares_kernel(values: Grid, radius: int, sign: float) -> Grid:
    """The value within `radius` rows and columns of each cell (H, W) that is least times a `sign`: the lowest
    by 1, the highest by -1.

    Along rows, then along columns, the minima of runs of 4, 16 … cells are made from those of a quarter; four
    runs that overlap cover the window. The inner loops go along rows, which a processor does many cells at a
    time.
    """
    (rows, columns), width, reach = values.shape, 2 * radius + 1, 1
    while 4 * reach <= width:
        reach *= 4
    second, third, last = min(reach, width - reach), min(2 * reach, width - reach), width - reach
    line, longer = np.empty(columns + 2 * radius, np.float32), np.empty(columns + 2 * radius, np.float32)
    runs = np.full((rows + 2 * radius, columns), np.inf, np.float32)
    for row in range(rows):
        line[:], inside, here, run = np.inf, line[radius:], values[row], 1
        for column in range(columns):
            inside[column] = sign * here[column]
        while run < reach:
            ahead = line[3 * run :]
            least_of(line, line[run:], line[2 * run :], ahead, longer[: len(ahead)])
            line, longer, run = longer, line, 4 * run
        least_of(line, line[second:], line[third:], line[last:], runs[row + radius])
    taller, run = np.empty_like(runs), 1
    while run < reach:
        for row in range(len(runs) - 3 * run):
            least_of(runs[row], runs[row + run], runs[row + 2 * run], runs[row + 3 * run], taller[row])
        runs, taller, run = taller, runs, 4 * run
    extreme = np.empty((rows, columns), np.float32)
    for row in range(rows):
        out = extreme[row]
        least_of(runs[row], runs[row + second], runs[row + third], runs[row + last], out)
        for column in range(columns):
            out[column] *= sign
    return extreme
