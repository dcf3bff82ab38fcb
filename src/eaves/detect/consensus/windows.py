"""Planes through windows of cells, and for each cell the best of the windows that hold it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from eaves.detect.toolkit.cells import Cells
from eaves.geometry.planes import Sums
from eaves.kernels import kernel
from eaves.methods import Method, parameter
from eaves.model import Values

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


def best_planes(sums: Sums, cells: Cells, limits: WindowRules) -> tuple[Values, Values, Values, Values]:
    """The best window's plane of each cell: slopes, height at the cell's middle, residual; (H, W) each.

    Every cell lies in nine windows of three by three cells and in four of two by two; near a ridge or an
    eaves at least one of them lies wholly on one face, and in a crown none of them is flat.
    """
    best = np.zeros((4, *cells.shape))
    best[3] = np.inf
    for size, price in ((WINDOW, 1.0), (2, limits.window_price)):
        planes = planes_of_windows(sums, cells, size, limits)
        planes[3] *= price
        which = least_around_kernel(planes[3].reshape(cells.shape), size)
        better = np.flatnonzero(planes[3, which.ravel()] < best[3].ravel())
        best.reshape(4, -1)[:, better] = planes[:, which.ravel()[better]]
    x = cells.west + (np.arange(cells.shape[1]) + 0.5) * cells.side
    y = cells.north - (np.arange(cells.shape[0]) + 0.5) * cells.side
    return best[0], best[1], best[2] + best[0] * x[None, :] + best[1] * y[:, None], best[3]


def planes_of_windows(sums: Sums, cells: Cells, size: int, limits: WindowRules) -> NDArray[np.float64]:
    """Slopes, height at the origin and residual (4, H · W) of each cell's window; inf where none fits."""
    planes = np.zeros((4, *cells.shape))
    planes[3] = np.inf
    planes_kernel(sums, size, limits.window_points, limits.window_width * cells.side, planes)
    return planes.reshape(4, -1)


@kernel
def planes_kernel(
    sums: Sums, size: int, least_points: int, least_width: float, planes: NDArray[np.float64]
) -> None:
    """Least squares planes z = ax + by + c through the windows of `size` by `size` cells, into (4, H, W).

    The residual is the RMSE across the plane with three degrees of freedom taken off; windows with fewer
    points, or whose points have a lesser standard deviation in plan, are left alone. `sums` is (H, W, 10).
    """
    rows, columns, channels = sums.shape
    total, beside = np.empty(channels), np.empty(channels)
    for row in range(rows):
        first, last = max(0, row - 1), min(rows, row + size - 1)
        for column in range(columns):
            left, right = max(0, column - 1), min(columns, column + size - 1)
            n = 0.0
            for r in range(first, last):
                for c in range(left, right):
                    n += sums[r, c, 0]
            if n < least_points:
                continue
            total[:] = 0.0
            for c in range(left, right):
                beside[:] = 0.0
                for r in range(first, last):
                    for k in range(channels):
                        beside[k] += sums[r, c, k]
                for k in range(channels):
                    total[k] += beside[k]
            x, y, z = total[1] / n, total[2] / n, total[3] / n
            xx, xy, xz = total[4] / n - x * x, total[5] / n - x * y, total[6] / n - x * z
            yy, yz, zz = total[7] / n - y * y, total[8] / n - y * z, total[9] / n - z * z
            least = (xx + yy) / 2 - np.hypot((xx - yy) / 2, xy)
            if least < least_width * least_width or xx * yy <= xy * xy:
                continue
            determinant = xx * yy - xy * xy
            a = (xz * yy - yz * xy) / determinant
            b = (yz * xx - xz * xy) / determinant
            planes[0, row, column], planes[1, row, column] = a, b
            planes[2, row, column] = z - a * x - b * y
            rest = max(zz - a * xz - b * yz, 0.0) * n / max(n - 3, 1.0)
            planes[3, row, column] = np.sqrt(rest / (1 + a * a + b * b))


def window_sum(values: NDArray[Any]) -> Values:
    """Sum (H, W) over the three by three cells around each, of whole numbers (H, W)."""
    ones = np.ones(WINDOW)
    total = ndimage.convolve1d(values.astype(np.float64), ones, 0, mode="constant")
    return np.asarray(ndimage.convolve1d(total, ones, 1, mode="constant"), np.float64)


@kernel
def least_around_kernel(values: Values, size: int) -> NDArray[np.int64]:
    """Flat number (H, W) of the window, of those that hold each cell, with the least value (H, W)."""
    rows, columns = values.shape
    least = np.empty((rows, columns), np.int64)
    for row in range(rows):
        for column in range(columns):
            best, number = values[row, column], row * columns + column
            for r in range(max(0, row + 2 - size), min(rows, row + 2)):
                for c in range(max(0, column + 2 - size), min(columns, column + 2)):
                    if values[r, c] < best:
                        best, number = values[r, c], r * columns + c
            least[row, column] = number
    return least
