"""Planes through windows of cells, and for each cell the best of the windows that hold it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.detect.toolkit.cells import Cells
from eaves.geometry.planes import Sums
from eaves.kernels import kernel
from eaves.methods import Method, parameter
from eaves.model import Integers, Values

WINDOW = 3
"""Cells a side of the widest window; what depends on how far cells share points follows from it."""


class WindowRules(Method):
    """Rules for windows that have a plane, and for comparing those of two sizes."""

    window_points: int = parameter(
        6,
        "Points of a window with a plane: three would always fit, six leave half for the residual.",
        ge=4,
    )
    window_width: float = parameter(
        0.25, "A window whose points are narrower than this share of a cell is a line.", ge=0.0
    )
    window_price: float = parameter(
        2.0, "Factor on the residual of a window two cells wide, as few points fit by chance.", gt=0.0
    )


def best_planes(
    sums: Sums, place: Integers, count: Values, cells: Cells, limits: WindowRules
) -> tuple[Values, Values, Values, Values]:
    """The best window's plane of each cell: slopes, height at the cell's middle, residual; (H, W) each.

    `sums` (K, 10) are those of the cells with points, `place` (H, W) each cell's row of them and `count`
    (H, W) its number of points. Every cell lies in nine windows of three by three cells and in four of two by
    two; near a ridge or an eaves at least one of them lies wholly on one face, and in a crown none of them is
    flat.
    """
    best = np.zeros((4, *cells.shape))
    best[3] = np.inf
    for size, price in ((WINDOW, 1.0), (2, limits.window_price)):
        planes = planes_kernel(
            sums, place, count, size, limits.window_points, limits.window_width * cells.side
        )
        take_best_kernel(planes, size, price, cells.west, cells.north, cells.side, best)
    return best[0], best[1], best[2], best[3]


@kernel
def planes_kernel(
    sums: Sums, place: Integers, count: Values, size: int, least_points: int, least_width: float
) -> NDArray[np.float64]:
    """Least squares planes z = ax + by + c (4, H, W) through the windows of `size` by `size` cells: a, b, c
    and the residual, which is the RMSE across the plane with three degrees of freedom taken off.

    Windows with fewer points, or whose points have a lesser standard deviation in plan, have no more than a
    residual of inf. `sums`, `place` and `count` are those of `best_planes`.
    """
    rows, columns = count.shape
    upright = np.empty((columns, 10))
    planes = np.zeros((4, rows, columns))
    planes[3] = np.inf
    for row in range(rows):
        upright[:] = 0.0  # the sums of the window's cells in each column
        for r in range(max(0, row - 1), min(rows, row + size - 1)):
            for column in range(columns):
                if count[r, column] > 0.0:
                    for k in range(10):
                        upright[column, k] += sums[place[r, column], k]
        for column in range(columns):
            left, right = max(0, column - 1), min(columns, column + size - 1)
            n = 0.0
            for c in range(left, right):
                n += upright[c, 0]
            if n < least_points:
                continue
            x = y = z = xx = xy = xz = yy = yz = zz = 0.0
            for c in range(left, right):
                line = upright[c]
                x, y, z = x + line[1], y + line[2], z + line[3]
                xx, xy, xz = xx + line[4], xy + line[5], xz + line[6]
                yy, yz, zz = yy + line[7], yz + line[8], zz + line[9]
            x, y, z = x / n, y / n, z / n
            xx, xy, xz = xx / n - x * x, xy / n - x * y, xz / n - x * z
            yy, yz, zz = yy / n - y * y, yz / n - y * z, zz / n - z * z
            least = (xx + yy) / 2 - np.sqrt(((xx - yy) / 2) ** 2 + xy * xy)
            if least < least_width * least_width or xx * yy <= xy * xy:
                continue
            determinant = xx * yy - xy * xy
            a = (xz * yy - yz * xy) / determinant
            b = (yz * xx - xz * xy) / determinant
            planes[0, row, column], planes[1, row, column] = a, b
            planes[2, row, column] = z - a * x - b * y
            rest = max(zz - a * xz - b * yz, 0.0) * n / max(n - 3, 1.0)
            planes[3, row, column] = np.sqrt(rest / (1 + a * a + b * b))
    return planes


@kernel
def take_best_kernel(
    planes: NDArray[np.float64],
    size: int,
    price: float,
    west: float,
    north: float,
    side: float,
    best: NDArray[np.float64],
) -> None:
    """Write into `best` (4, H, W) the plane of the window of `size` by `size` cells, of those (4, H, W) that
    hold a cell, with the least residual, where that times `price` is less than its own; heights are those at
    the middles of the cells, which lie about (`west`, `north`)."""
    residual = planes[3]
    rows, columns = residual.shape
    for row in range(rows):
        for column in range(columns):
            least, y, x = residual[row, column], row, column
            for r in range(max(0, row + 2 - size), min(rows, row + 2)):
                for c in range(max(0, column + 2 - size), min(columns, column + 2)):
                    if residual[r, c] < least:
                        least, y, x = residual[r, c], r, c
            if least * price < best[3, row, column]:
                a, b = planes[0, y, x], planes[1, y, x]
                east, up = west + (column + 0.5) * side, north - (row + 0.5) * side
                best[0, row, column], best[1, row, column] = a, b
                best[2, row, column] = planes[2, y, x] + a * east + b * up
                best[3, row, column] = least * price


def window_sum(values: Values) -> Values:
    """Sum (H, W) over the three by three cells around each, of whole numbers (H, W)."""
    for axis in (0, 1):
        line, total = np.moveaxis(values, axis, 0), values.copy()
        beside = np.moveaxis(total, axis, 0)
        beside[1:] += line[:-1]
        beside[:-1] += line[1:]
        values = total
    return values
