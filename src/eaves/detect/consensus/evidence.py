"""The evidence of each cell for or against a roof: planes, echoes, ground seen through it, height."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eaves.detect.consensus.windows import WindowRules, best_planes, window_sum
from eaves.detect.toolkit.cells import Cells
from eaves.detect.toolkit.plane_moments import sums_of
from eaves.model import Integers, Labels, Mask, Points, Scene, Values
from eaves.raster.groups import ONWARD, numbers_in, shifted


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
    chosen = np.flatnonzero(candidate)
    cell = cells.cell[chosen]
    count = np.bincount(cell, minlength=cells.size).reshape(shape)
    sums = sums_of(xyz[chosen], cell, cells.size).reshape(*shape, 10)
    slope_east, slope_north, level, residual = best_planes(sums, cells, limits)
    top = cells.extreme(np.where(candidate, xyz[:, 2], -np.inf))

    around = window_sum(count.astype(np.float64))
    multi_return_share = np.zeros(shape)
    if scene.cloud.has_returns and scene.cloud.number_of_returns is not None:
        many = chosen[scene.cloud.number_of_returns[chosen] > 1]
        multi_return_share = window_sum(
            np.bincount(cells.cell[many], minlength=cells.size).reshape(shape).astype(np.float64)
        )
        multi_return_share = multi_return_share / np.maximum(around, 1)
    floor = cells.extreme(np.where(~candidate & ~scene.cloud.noise, xyz[:, 2], -np.inf))
    low = np.flatnonzero(~candidate & ~scene.cloud.noise)
    under = window_sum(np.bincount(cells.cell[low], minlength=cells.size).reshape(shape).astype(np.float64))
    height = np.bincount(cell, weights=scene.height[chosen], minlength=cells.size).reshape(shape)
    return Evidence(
        cells=cells,
        candidate=count > 0,
        top=top.reshape(shape),
        low=floor.reshape(shape),
        residual=residual,
        east=slope_east,
        north=slope_north,
        level=level,
        multi_return_share=multi_return_share,
        penetration=under / np.maximum(under + around, 1),
        height=height / np.maximum(count, 1),
    )


def rim_pairs(region: Labels, occupied: Mask) -> tuple[Integers, Integers]:
    """Flat numbers of the cells of regions (H, W) and of their eight-neighbours that are in none and
    occupied (H, W), pair by pair."""
    inside, beside = region > 0, occupied & (region == 0)
    inner: list[Integers] = []
    outer: list[Integers] = []
    for step in ONWARD:
        a, b = shifted(region.shape, step)
        for first, second, this, that in ((inside, beside, inner, outer), (beside, inside, outer, inner)):
            here, there = numbers_in(first[a] & second[b], step, region.shape)
            this.append(here)
            that.append(there)
    return np.concatenate(inner), np.concatenate(outer)
