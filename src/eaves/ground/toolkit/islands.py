"""A few seeds alone among objects: ground seen through a gap, a point on a wall, an echo gone astray."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from eaves.ground.toolkit.pits import StrayRules
from eaves.kernels import kernel
from eaves.model import Grid, Labels, Mask, Raster


def find_islands(surface: Raster, slope: Grid, ground: Mask, occupied: Mask, rules: StrayRules) -> Mask:
    """The ground cells (H, W) among objects that do not fit the terrain around.

    An island is up to `island_cells` cells of ground that touch no other. Echoes from inside a building or
    low on its wall make them, and so does ground between crowns. A plane through the nearest other ground
    tells them apart: an island that rises over it beside a much higher object goes; so does a single cell
    that lies lower than all that ground. Where the terrain slopes it may rise more.
    """
    most, count_near = rules.island_cells, rules.island_nearest
    strays = np.zeros(ground.shape, bool)
    island, count = ndimage.label(ground, np.ones((3, 3)))
    size = np.bincount(island.ravel(), minlength=count + 1)
    small = ground & (size[island] <= most)
    total = int(ground.sum())
    if not small.any() or total < count_near + most:
        return strays
    cell = surface.cell
    rows, columns = np.nonzero(small)
    nearest = others_kernel(np.asarray(island, np.int32), rows, columns, count_near)
    z = surface.values.astype(np.float64).ravel()
    mine, level = z[island.shape[1] * rows + columns], z[nearest].sum(axis=1) / count_near
    at = np.stack(np.divmod(nearest, island.shape[1]), axis=-1) * cell
    middle = at.sum(axis=1) / count_near
    offset = at - middle[:, None]
    spread = np.einsum("ijk,ijl->ikl", offset, offset) + count_near * cell**2 * np.eye(2)
    rise = np.einsum("ijk,ij->ik", offset, z[nearest])
    gradient = np.linalg.solve(spread, rise[..., None])[..., 0]
    over = mine - level - ((np.stack([rows, columns], axis=-1) * cell - middle) * gradient).sum(axis=1)
    lowest = z[nearest].min(axis=1)
    objects = np.where(occupied & ~ground, surface.values, -np.inf)
    beside = ndimage.maximum_filter(objects, 3)[small] > mine + rules.stray_under
    wrong = beside & (over > rules.stray_rise + cell * slope[small])
    wrong |= (size[island[small]] == 1) & (mine < lowest - rules.hole_depth)
    strays[rows[wrong], columns[wrong]] = True
    return strays


@kernel
def others_kernel(
    island: Labels, rows: NDArray[np.int64], columns: NDArray[np.int64], wanted: int
) -> NDArray[np.int64]:
    """Flat numbers (K, wanted) of the ground cells nearest to each of some (K,), out of other islands (H, W)
    than its own, of which there are so many; of two as near the first, row by row.
    """
    height, width = island.shape
    nearest = np.empty((len(rows), wanted), np.int64)
    square = np.empty(wanted, np.int64)
    for i in range(len(rows)):
        row, column, found, ring = rows[i], columns[i], 0, 1
        # cells on a ring are no nearer than its radius
        while found < wanted or square[wanted - 1] >= ring * ring:
            for r in range(max(0, row - ring), min(height, row + ring + 1)):
                step = 1 if abs(r - row) == ring else 2 * ring
                for c in range(column - ring, column + ring + 1, step):
                    if c < 0 or c >= width or island[r, c] == 0 or island[r, c] == island[row, column]:
                        continue
                    away, number = (r - row) ** 2 + (c - column) ** 2, r * width + c
                    place = min(found, wanted - 1)
                    if found == wanted:
                        last = nearest[i, place]
                        if away > square[place] or (away == square[place] and number > last):
                            continue
                    while place > 0 and (
                        away < square[place - 1]
                        or (away == square[place - 1] and number < nearest[i, place - 1])
                    ):
                        square[place], nearest[i, place] = square[place - 1], nearest[i, place - 1]
                        place -= 1
                    square[place], nearest[i, place] = away, number
                    found = min(found + 1, wanted)
            ring += 1
    return nearest
