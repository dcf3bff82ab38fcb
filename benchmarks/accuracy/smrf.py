"""SMRF [pingel2013] with one set of five numbers: the plain rival beside every table of the ground."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from eaves.model import Mask, Points, Values

Grid = NDArray[np.float64]
CELL_M, WINDOW_M, SLOPE, THRESHOLD_M, SCALER = 1.0, 18.0, 0.15, 0.5, 1.25
"""Side of cells; radius of the widest window; slope that makes an object; distance of ground from the
surface, and what is added to it for each unit of slope."""
PIT_SLOPE, PASSES = 5.0, 50
"""Slope of low outliers [pingel2013]; passes of a mean that smooths filled holes: the paper has springs."""


def filled(grid: Grid) -> Grid:
    """A grid (H, W) whose empty cells have the value of the nearest, smoothed."""
    empty = np.isnan(grid)
    if not empty.any():
        return grid
    nearest = ndimage.distance_transform_edt(empty, return_distances=False, return_indices=True)
    whole: Grid = grid[tuple(nearest)]
    for _ in range(PASSES):
        whole[empty] = ndimage.uniform_filter(whole, 3)[empty]
    return whole


def stands_out(grid: Grid, widest: int, slope: float) -> Mask:
    """The cells (H, W) that rise over an opening by discs of 1 to `widest` cells by more than the slope."""
    objects, before = np.zeros(grid.shape, bool), grid
    for radius in range(1, widest + 1):
        row, column = np.ogrid[-radius : radius + 1, -radius : radius + 1]
        opened = ndimage.grey_opening(
            before, footprint=row * row + column * column <= radius**2, mode="nearest"
        )
        objects |= before - opened > slope * radius * CELL_M
        before = opened
    return objects


def ground_by_smrf(xyz: Points) -> Mask:
    """The mask (N,) of the ground among points (N, 3)."""
    place = (xyz[:, :2] - np.floor(xyz[:, :2].min(axis=0))) / CELL_M
    column, row = place.astype(np.int64).T
    low = np.full((row.max() + 1, column.max() + 1), np.inf)
    np.minimum.at(low, (row, column), xyz[:, 2])
    low = filled(np.where(np.isinf(low), np.nan, low))
    pits = stands_out(-low, 1, PIT_SLOPE)
    low = filled(np.where(pits, np.nan, low))
    terrain = filled(np.where(stands_out(low, round(WINDOW_M / CELL_M), SLOPE) | pits, np.nan, low))
    slope = np.hypot(*np.gradient(terrain, CELL_M))

    def at(grid: Grid) -> Values:
        return np.asarray(
            ndimage.map_coordinates(grid, place[:, ::-1].T - 0.5, order=1, mode="nearest"), np.float64
        )

    return np.asarray(np.abs(xyz[:, 2] - at(terrain)) <= THRESHOLD_M + SCALER * at(slope))
