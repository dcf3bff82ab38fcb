"""The evidence of each cell for or against a roof: planes, echoes, ground seen through it, height."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from eaves.detect.consensus.windows import WindowRules, best_planes, window_sum
from eaves.detect.toolkit.cells import Cells
from eaves.geometry.planes import sums_of
from eaves.model import Labels, Mask, Points, Scene, Values


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
    height: Values
    """Mean height (m) of the cell's candidate points over the terrain."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the cells."""
        return self.cells.shape


def gather_evidence(scene: Scene, xyz: Points, candidate: Mask, side: float, limits: WindowRules) -> Evidence:
    """Evidence on cells of the given side (m).

    `candidate` (N,) marks the points that could be roofs; xyz (N, 3) counts heights from a level near them.
    """
    cells = Cells.of(xyz, side)
    shape = cells.shape
    chosen, low = np.flatnonzero(candidate), np.flatnonzero(~candidate & ~scene.cloud.noise)
    cell = cells.cell[chosen]
    sums = sums_of(xyz[chosen], cell, cells.size).reshape(*shape, 10)
    slope_east, slope_north, level, residual = best_planes(sums, cells, limits)

    def counted(points: NDArray[np.int64]) -> NDArray[np.int64]:
        return np.bincount(cells.cell[points], minlength=cells.size).reshape(shape)

    def highest(points: Mask) -> Values:
        return cells.extreme(np.where(points, xyz[:, 2], -np.inf)).reshape(shape)

    count, returns = counted(chosen), scene.cloud.number_of_returns
    around, under = window_sum(count), window_sum(counted(low))
    many = chosen[:0] if returns is None else chosen[returns[chosen] > 1]
    height = np.bincount(cell, weights=scene.height[chosen], minlength=cells.size).reshape(shape)
    return Evidence(
        cells=cells,
        candidate=count > 0,
        top=highest(candidate),
        low=highest(~candidate & ~scene.cloud.noise),
        residual=residual,
        east=slope_east,
        north=slope_north,
        level=level,
        multi_return_share=window_sum(counted(many)) / np.maximum(around, 1),
        penetration=under / np.maximum(under + around, 1),
        height=height / np.maximum(count, 1),
    )


def level_at(evidence: Evidence, cells: NDArray[np.int64], towards: NDArray[np.int64]) -> Values:
    """Height (K,) of the planes of cells (K,), carried on to the middles of the cells `towards` (K,)."""
    row, column = np.divmod(cells, evidence.shape[1])
    to_row, to_column = np.divmod(towards, evidence.shape[1])
    side = evidence.cells.side
    level = evidence.level.ravel()[cells] + evidence.east.ravel()[cells] * (to_column - column) * side
    return np.asarray(level - evidence.north.ravel()[cells] * (to_row - row) * side, np.float64)


def missed_by(
    evidence: Evidence, cells: NDArray[np.int64], towards: NDArray[np.int64], height: Values
) -> Values:
    """Distance (m, (K,)) by which heights in the cells `towards` (K,) miss the surface of `cells` (K,): the
    plane extended, if they have one, or the highest point."""
    miss = np.abs(level_at(evidence, cells, towards) - height)
    miss[~np.isfinite(evidence.residual.ravel()[cells])] = np.inf
    return np.minimum(miss, np.abs(evidence.top.ravel()[cells] - height))


def groups_of(label: Labels) -> Iterator[tuple[int, tuple[slice, slice], Mask]]:
    """Number, window with a cell more all round, and cells (h, w) in it, of each group 1…K of (H, W)."""
    for number, window in enumerate(ndimage.find_objects(label), 1):
        if window is not None:
            rows, columns = (slice(max(0, one.start - 1), one.stop + 1) for one in window)
            yield number, (rows, columns), label[rows, columns] == number
