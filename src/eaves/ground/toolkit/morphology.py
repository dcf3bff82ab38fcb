"""Grey-scale morphology of rasters, with square windows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from eaves.kernels import kernel
from eaves.model import Grid


def openings(values: Grid, radii: Iterable[int]) -> Iterator[Grid]:
    """The highest surface (H, W) under `values` that a square of 2 r + 1 cells touches everywhere, for radii
    r that grow.

    `values` holds no NaN. Beyond the rim the surface goes on as it ends. The lowest values of a square are
    those of the square before, a little farther around.
    """
    lowest, before = np.ascontiguousarray(values, np.float32), 0
    for radius in radii:
        lowest, before = lowest_in_squares_kernel(lowest, radius - before), radius
        yield np.asarray(-lowest_in_squares_kernel(-lowest, radius))


@kernel
def lowest_in_squares_kernel(values: Grid, radius: int) -> Grid:
    """The lowest value within `radius` rows and columns of each cell (H, W).

    Along rows, then along columns, the minima of runs of 2, 4, 8 … cells are made from those of half as many;
    two runs that overlap cover the window. The inner loops go along rows, which a processor does many cells
    at a time.
    """
    rows, columns = values.shape
    width = 2 * radius + 1
    line, wider = np.empty(columns + 2 * radius, np.float32), np.empty(columns + 2 * radius, np.float32)
    runs = np.full((rows + 2 * radius, columns), np.inf, np.float32)
    for row in range(rows):
        line[:radius], line[radius + columns :] = np.inf, np.inf
        line[radius : radius + columns] = values[row]
        span = 1
        while 2 * span <= width:
            ahead = line[span:]
            for i in range(len(ahead)):
                wider[i] = line[i] if line[i] < ahead[i] else ahead[i]
            line, wider = wider, line
            span *= 2
        last, out = line[width - span :], runs[row + radius]
        for column in range(columns):
            out[column] = line[column] if line[column] < last[column] else last[column]
    span = 1
    while 2 * span <= width:
        for row in range(len(runs) - span):
            here, below = runs[row], runs[row + span]
            for column in range(columns):
                here[column] = here[column] if here[column] < below[column] else below[column]
        span *= 2
    lowest = np.empty((rows, columns), np.float32)
    for row in range(rows):
        first, last, out = runs[row], runs[row + width - span], lowest[row]
        for column in range(columns):
            out[column] = first[column] if first[column] < last[column] else last[column]
    return lowest
