"""What each cell of a scene tells for or against a roof: planes, echoes, ground seen through it, height."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from eaves.detect.cells import Cells
from eaves.geometry.plane_moments import Sums, sums_of
from eaves.model import Mask, Points, Scene, Values

WINDOW = 9
"""Cells of a window: three by three."""
LEAST_POINTS = 6
"""Points of a window that a plane is fitted to: three would always fit, six leave half for the residual."""
LEAST_WIDTH = 0.25
"""A window whose points are narrower than this share of a cell is a line, not a surface."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """Rasters (H, W) over the cells; values mean nothing where `candidate` is False."""

    cells: Cells
    candidate: Mask
    """Cells with at least one point that could be a roof."""
    top: Values
    """Height (m above the terrain's local zero) of the highest candidate point; -inf where there is none."""
    residual: Values
    """RMSE (m) across the plane of the best of the nine windows that hold the cell; inf where none fits."""
    east: Values
    north: Values
    level: Values
    """The best window's plane: slopes and its height at the middle of the cell."""
    several: Values
    """Share of the window's candidate points whose pulse had several returns; 0 without returns."""
    through: Values
    """Share of all points in the window that lie on or near the ground."""
    height: Values
    """Mean height (m) of the cell's candidate points over the terrain."""

    @property
    def shape(self) -> tuple[int, int]:
        return self.cells.shape


def gather_evidence(scene: Scene, xyz: Points, candidate: Mask, side: float) -> Evidence:
    """Evidence on cells of the given side (m).

    `candidate` (N,) marks the points that could be roofs; xyz (N, 3) counts heights from a level near them.
    """
    cells = Cells.of(xyz, side)
    shape = cells.shape
    chosen = np.flatnonzero(candidate)
    cell = cells.cell[chosen]
    count = np.bincount(cell, minlength=cells.size).reshape(shape)
    sums = sums_of(xyz[chosen], cell, cells.size).reshape(*shape, 10)
    slope_east, slope_north, level, residual = best_planes(sums, cells)
    top = cells.extreme(np.where(candidate, xyz[:, 2], -np.inf))

    around = window_sum(count.astype(np.float64))
    several = np.zeros(shape)
    if scene.cloud.has_returns and scene.cloud.number_of_returns is not None:
        many = chosen[scene.cloud.number_of_returns[chosen] > 1]
        several = window_sum(
            np.bincount(cells.cell[many], minlength=cells.size).reshape(shape).astype(np.float64)
        )
        several = several / np.maximum(around, 1)
    low = np.flatnonzero(~candidate & ~scene.cloud.noise)
    under = window_sum(np.bincount(cells.cell[low], minlength=cells.size).reshape(shape).astype(np.float64))
    height = np.bincount(cell, weights=scene.height[chosen], minlength=cells.size).reshape(shape)
    return Evidence(
        cells=cells,
        candidate=count > 0,
        top=top.reshape(shape),
        residual=residual,
        east=slope_east,
        north=slope_north,
        level=level,
        several=several,
        through=under / np.maximum(under + around, 1),
        height=height / np.maximum(count, 1),
    )


def window_sum(values: Values) -> Values:
    """Sum over the three by three cells around each cell, of (H, W) or (H, W, C)."""
    rows, columns = values.shape[:2]
    flat = np.ascontiguousarray(values, np.float64).reshape(rows, -1)
    return np.asarray(window_kernel(flat, flat.shape[1] // columns).reshape(values.shape))


@njit(cache=True)
def window_kernel(values: Values, channels: int) -> Values:
    """Sums over three rows and three columns of (H, W * channels), the channels of a cell side by side."""
    rows, width = values.shape
    total = np.empty((rows, width))
    line = np.zeros(width + 2 * channels)
    for row in range(rows):
        for i in range(width):
            above = values[row - 1, i] if row > 0 else 0.0
            below = values[row + 1, i] if row + 1 < rows else 0.0
            line[channels + i] = above + values[row, i] + below
        for i in range(width):
            total[row, i] = line[i] + line[i + channels] + line[i + 2 * channels]
    return total


def best_planes(sums: Sums, cells: Cells) -> tuple[Values, Values, Values, Values]:
    """The best window's plane of each cell: slopes, height at the cell's middle, residual; (H, W) each.

    Every cell lies in nine windows of three by three cells; near a ridge or an eaves at least one of them
    lies wholly on one face, and in a crown none of them is flat.
    """
    shape = cells.shape
    window = window_sum(sums)
    fitted = np.flatnonzero(window[..., 0] >= LEAST_POINTS)
    east, north, level, residual = (np.full(shape[0] * shape[1], fill) for fill in (0.0, 0.0, 0.0, np.inf))
    if len(fitted):
        a, b, mean, rmse, width = regress_planes(window.reshape(-1, 10)[fitted])
        east[fitted], north[fitted] = a, b
        level[fitted] = mean[:, 2] - a * mean[:, 0] - b * mean[:, 1]
        residual[fitted] = np.where(width >= LEAST_WIDTH * cells.side, rmse, np.inf)
    window_of = least_around_kernel(residual.reshape(shape))
    best = [plane.take(window_of) for plane in (east, north, level, residual)]
    x = cells.west + (np.arange(shape[1]) + 0.5) * cells.side
    y = cells.north - (np.arange(shape[0]) + 0.5) * cells.side
    at_middle = best[2] + best[0] * x[None, :] + best[1] * y[:, None]
    return best[0], best[1], at_middle, best[3]


@njit(cache=True)
def least_around_kernel(values: Values) -> NDArray[np.int64]:
    """Flat number (H, W) of the least of the three by three values around each cell; its own when equal."""
    rows, columns = values.shape
    least = np.empty((rows, columns), np.int64)
    for row in range(rows):
        for column in range(columns):
            best, number = values[row, column], row * columns + column
            for r in range(max(0, row - 1), min(rows, row + 2)):
                for c in range(max(0, column - 1), min(columns, column + 2)):
                    if values[r, c] < best:
                        best, number = values[r, c], r * columns + c
            least[row, column] = number
    return least


def regress_planes(sums: Sums) -> tuple[Values, Values, Points, Values, Values]:
    """Least squares planes z = ax + by + c of K sets.

    Answers a, b (K,), centroids (K, 3), RMSE across the plane with three degrees of freedom taken off (K,),
    and the lesser standard deviation in plan (K,).
    """
    n = sums[:, 0]
    mean = sums[:, 1:4] / n[:, None]
    x, y, z = mean.T
    xx, xy, xz, yy, yz, zz = (sums[:, 4:] / n[:, None]).T
    xx, xy, xz = xx - x * x, xy - x * y, xz - x * z
    yy, yz, zz = yy - y * y, yz - y * z, zz - z * z
    determinant = np.maximum(xx * yy - xy * xy, 1e-12)
    a = (xz * yy - yz * xy) / determinant
    b = (yz * xx - xz * xy) / determinant
    rest = np.maximum(zz - a * xz - b * yz, 0.0) * n / np.maximum(n - 3, 1)
    least = (xx + yy) / 2 - np.hypot((xx - yy) / 2, xy)
    return a, b, mean, np.sqrt(rest / (1 + a * a + b * b)), np.sqrt(np.maximum(least, 0.0))


def neighbour_pairs(mask: Mask) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Flat numbers of all pairs of eight-neighbouring cells that are both set in `mask` (H, W)."""
    rows, columns = mask.shape
    number = np.arange(rows * columns).reshape(rows, columns)
    one, two = [], []
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = (slice(0, rows - down), slice(max(0, -right), columns - max(0, right)))
        b = (slice(down, rows), slice(max(0, right), columns - max(0, -right)))
        both = mask[a] & mask[b]
        one.append(number[a][both])
        two.append(number[b][both])
    return np.concatenate(one), np.concatenate(two)
