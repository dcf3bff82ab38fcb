"""A few seeds alone among objects: ground seen through a gap, a point on a wall, an echo gone astray."""

from __future__ import annotations

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from eaves.ground.strays import ABOVE_M, HOLE_M, WALL_M
from eaves.model import Grid, Mask, Raster

ISLAND_CELLS = 3
"""More cells of ground together are taken for what they are."""
NEAREST = 12
"""The terrain at an island is foretold by so many of the nearest cells of ground outside it."""


def find_islands(surface: Raster, slope: Grid, ground: Mask, occupied: Mask) -> Mask:
    """The ground cells (H, W) among objects that do not fit the terrain around.

    An island is up to `ISLAND_CELLS` cells of ground that touch no other. Echoes from inside a building or
    low on its wall make them, and so does ground between crowns. A plane through the nearest other ground
    tells them apart: an island that rises over it beside a much higher object goes; so does a single cell
    that lies lower than all that ground. Where the terrain slopes it may rise more.
    """
    strays = np.zeros(ground.shape, bool)
    island, count = ndimage.label(ground, np.ones((3, 3)))
    size = np.bincount(island.ravel(), minlength=count + 1)
    small = ground & (size[island] <= ISLAND_CELLS)
    total = int(ground.sum())
    if not small.any() or total < NEAREST + ISLAND_CELLS:
        return strays
    cell = surface.cell
    at = np.argwhere(ground) * cell
    mine = np.flatnonzero(small[ground])
    number, z = island[ground], surface.values[ground].astype(np.float64)
    nearest = np.asarray(cKDTree(at).query(at[mine], k=NEAREST + ISLAND_CELLS)[1])
    other = number[nearest] != number[mine][:, None]
    weight = (other & (np.cumsum(other, axis=1) <= NEAREST)).astype(np.float64)[..., None]
    middle = (at[nearest] * weight).sum(axis=1) / NEAREST
    level = (z[nearest] * weight[..., 0]).sum(axis=1) / NEAREST
    offset = (at[nearest] - middle[:, None]) * weight
    spread = np.einsum("ijk,ijl->ikl", offset, offset) + NEAREST * cell**2 * np.eye(2)
    rise = np.einsum("ijk,ij->ik", offset, z[nearest])
    gradient = np.linalg.solve(spread, rise[..., None])[..., 0]
    over = z[mine] - level - ((at[mine] - middle) * gradient).sum(axis=1)
    lowest = np.where(weight[..., 0] > 0, z[nearest], np.inf).min(axis=1)
    objects = np.where(occupied & ~ground, surface.values, -np.inf)
    beside = ndimage.maximum_filter(objects, 3)[ground][mine] > z[mine] + ABOVE_M
    wrong = beside & (over > WALL_M + cell * slope[ground][mine])
    wrong |= (size[number[mine]] == 1) & (z[mine] < lowest - HOLE_M)
    rows, columns = np.argwhere(ground)[mine[wrong]].T
    strays[rows, columns] = True
    return strays
