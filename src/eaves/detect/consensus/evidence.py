"""The evidence of each cell for or against a roof: planes, echoes, ground seen through it, height."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy import ndimage

from eaves.detect.consensus.measures import signs_of_leaves
from eaves.detect.consensus.windows import WindowRules, best_planes, window_sum
from eaves.detect.toolkit.cells import Cells
from eaves.geometry.planes import Sums, add_point_kernel
from eaves.kernels import inlined_kernel, kernel
from eaves.model import Integers, Labels, Mask, Points, Scene, Values


@dataclass(frozen=True, eq=False)
class Evidence:
    """Rasters (H, W) over the cells; values mean nothing where `candidate` is False."""

    cells: Cells
    candidate: Mask
    """Cells with at least one point that could be a roof."""
    top: Values
    """Height (m above the terrain's local zero) of the highest candidate point; -inf where there is none."""
    low: Values
    """Height of the highest other point but noise (terrain, and what is low over it); -inf where none is."""
    residual: Values
    """RMSE (m) across the plane of the best of the windows that hold the cell; inf where none fits."""
    east: Values
    north: Values
    level: Values
    """The best window's plane: slopes and its height at the middle of the cell."""
    multi_return_share: Values
    """Share of the window's candidate points whose pulse had several returns; 0 without returns."""
    penetration: Values
    """Share of all points in the window that lie on or near the ground."""
    inner_share: Values
    inner_penetration: Values
    """The least of both in the candidate cells among the three by three about each: a surface is judged by
    its inside."""
    height: Values
    """Mean height (m) of the cell's candidate points over the terrain."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the cells."""
        return self.cells.shape

    @cached_property
    def empty(self) -> Mask:
        """The cells (H, W) without points."""
        return np.asarray((self.cells.count == 0).reshape(self.shape))

    @cached_property
    def gaps(self) -> tuple[Labels, int]:
        """Numbers (H, W) of the groups of empty cells that share sides, 0 elsewhere; how many there are."""
        label, count = ndimage.label(self.empty)
        return np.asarray(label), int(count)


def gather_evidence(scene: Scene, xyz: Points, candidate: Mask, side: float, limits: WindowRules) -> Evidence:
    """Evidence on cells of the given side (m).

    `candidate` (N,) marks the points that could be roofs; xyz (N, 3) counts heights from a level near them.
    """
    cells = Cells.of(xyz, side)
    shape, noise, several = cells.shape, scene.cloud.noise, signs_of_leaves(scene.cloud)
    place, sums, height, counts, tops = gather_kernel(
        xyz, cells.cell, candidate, noise, several, scene.height, cells.size
    )
    place, (count, many, under) = place.reshape(shape), counts.reshape(3, *shape)
    slope_east, slope_north, level, residual = best_planes(sums, place, count, cells, limits)
    around, below, seen = window_sum(count), window_sum(under), count > 0
    share, penetration = window_sum(many) / np.maximum(around, 1), below / np.maximum(below + around, 1)
    return Evidence(
        cells=cells,
        candidate=seen,
        top=tops[0].reshape(shape),
        low=tops[1].reshape(shape),
        residual=residual,
        east=slope_east,
        north=slope_north,
        level=level,
        multi_return_share=share,
        penetration=penetration,
        inner_share=least_around_kernel(share, seen),
        inner_penetration=least_around_kernel(penetration, seen),
        height=height.reshape(shape) / np.maximum(count, 1),
    )


@kernel
def gather_kernel(
    xyz: Points,
    cell: Integers,
    candidate: Mask,
    noise: Mask,
    several: Values,
    height: Values,
    size: int,
) -> tuple[Integers, Sums, Values, Values, Values]:
    """What the points (N,) of `size` cells say, each visited once.

    Returns
    -------
    place : ndarray (size,)
        Row of `sums` of each cell with a candidate, -1 of the others.
    sums : ndarray (K, 10)
        The ten sums of the candidates of those cells.
    height : ndarray (size,)
        Sum of their heights over the terrain.
    counts : ndarray (3, size)
        Number of candidates, of those among them whose pulse had several returns, and of other points but
        noise.
    tops : ndarray (2, size)
        The highest candidate and the highest other point but noise; -inf where there is none.
    """
    place, occupied = np.full(size, -1), 0
    total, counts, tops = np.zeros(size), np.zeros((3, size)), np.full((2, size), -np.inf)
    sums = np.empty((min(size, int(candidate.sum())), 10))
    for i in range(len(xyz)):
        here, z = cell[i], xyz[i, 2]
        if candidate[i]:
            if place[here] < 0:
                place[here], sums[occupied] = occupied, 0.0
                occupied += 1
            add_point_kernel(sums[place[here]], xyz[i, 0], xyz[i, 1], z, 1.0)
            total[here] += height[i]
            counts[0, here] += 1.0
            counts[1, here] += several[i]
            tops[0, here] = max(tops[0, here], z)
        elif not noise[i]:
            counts[2, here] += 1.0
            tops[1, here] = max(tops[1, here], z)
    return place, sums[:occupied], total, counts, tops


@kernel
def least_around_kernel(values: Values, mask: Mask) -> Values:
    """The least value of the cells of a mask (H, W) among the three by three around each of them; 0 beside
    the mask."""
    rows, columns = values.shape
    least = np.zeros((rows, columns))
    for row in range(rows):
        for column in range(columns):
            if mask[row, column]:
                least[row, column] = values[row, column]
                for r in range(max(0, row - 1), min(rows, row + 2)):
                    for c in range(max(0, column - 1), min(columns, column + 2)):
                        if mask[r, c] and values[r, c] < least[row, column]:
                            least[row, column] = values[r, c]
    return least


@inlined_kernel
def carried_on(
    level: Values, east: Values, north: Values, side: float, row: int, column: int, down: int, right: int
) -> Any:
    """Height of the plane of a cell, carried on to the middle of the cell so many steps down and right."""
    return level[row, column] + east[row, column] * right * side - north[row, column] * down * side


@inlined_kernel
def missed_by(top: Values, residual: Values, height: float, on_plane: float, row: int, column: int) -> Any:
    """Distance (m) by which a height in another cell misses the surface of a cell: its plane extended, if it
    has one, or its highest point."""
    miss = abs(top[row, column] - height)
    return min(miss, abs(on_plane - height)) if np.isfinite(residual[row, column]) else miss


def groups_of(label: Labels) -> Iterator[tuple[int, tuple[slice, slice], Mask]]:
    """Number, window with a cell more all round, and cells (h, w) in it, of each group 1…K of (H, W)."""
    for number, window in enumerate(ndimage.find_objects(label), 1):
        if window is not None:
            rows, columns = (slice(max(0, one.start - 1), one.stop + 1) for one in window)
            yield number, (rows, columns), label[rows, columns] == number
