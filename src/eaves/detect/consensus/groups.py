"""Groups of building cells: without narrow parts, and how far their rims go on in the terrain."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from eaves.detect.consensus.evidence import Evidence, carried_on, missed_by
from eaves.kernels import kernel
from eaves.model import Integers, Labels, Mask, Values
from eaves.raster.groups import closed_by_square, grown_by_square, opened_by_square


def without_narrow_parts(building: Mask, evidence: Evidence, least: float) -> Mask:
    """The building cells (H, W) without parts that no square of a side `least` (m) fits into.

    What lies within half that square of one that fits stays, so corners and eaves do, and so does all that is
    connected with none: a shed may be narrower than a room. Empty cells between building cells count as
    building: at one spacing a third of all cells is empty by chance.
    """
    size = int(least / evidence.cells.side + 1e-9)
    if size < 2:
        return building
    closed = building | (closed_by_square(building, 3) & evidence.empty)
    core = opened_by_square(closed, size)
    near = grown_by_square(core, size // 2 * 2 + 1)
    group, count = ndimage.label(closed, np.ones((3, 3)))
    broad = np.zeros(count + 1, bool)
    broad[group[core]] = True
    return np.asarray(building & (near | ~broad[group]))


def without_pores(building: Mask, surface: Labels, side: float, least: float) -> Mask:
    """The building cells (H, W) with all gaps that one surface, by its number (H, W), 0 for none, surrounds,
    and that are smaller than a square of a side `least` (m), or nowhere half as wide: what is seen through
    membranes, meshes and glass.

    `side` (m) is that of a cell; gaps are four-connected, so that chance joins few of them.
    """
    gap, count = ndimage.label(~building)
    small = np.bincount(gap.ravel(), minlength=count + 1) * side**2 < least**2
    narrow = np.ones(count + 1, bool)
    narrow[gap[opened_by_square(~building, int(0.5 * least / side + 0.5))]] = False
    small |= narrow
    first, last = np.full(count + 1, np.iinfo(np.int32).max), np.zeros(count + 1, np.int32)
    around = np.pad(np.where(building, surface, -1), 1)  # beyond the border there is no surface
    rows, columns = np.nonzero((gap > 0) & small[gap])
    number = gap[rows, columns]
    for south in range(3):
        for east in range(3):
            beside = around[rows + south, columns + east]
            known = beside >= 0
            np.minimum.at(first, number[known], beside[known])
            np.maximum.at(last, number[known], beside[known])
    filled = (first == last) & (last > 0)
    return np.asarray(building | filled[gap], np.bool_)


def attached_share(evidence: Evidence, region: Labels, count: int, continues: float) -> Values:
    """Share (count + 1,) of the rim of each region 0…`count` of cells (H, W) where terrain continues it: a
    roof ends at a step, a rock does not.

    Parameters
    ----------
    evidence : planes, highest candidate and highest low point of the cells.
    region : number of each cell's region, 0 for none.
    count : the largest number.
    continues : terrain that misses the carried-on surface by less (m) goes on from it.

    Returns
    -------
    Values
        Of all pairs of a region's cell and an eight-neighbour outside, the share in which the highest point
        of the outer cell that is no candidate lies on the inner cell's plane, or at the height of its top.
    """
    planes = evidence.level, evidence.east, evidence.north, evidence.cells.side
    size, hits = rims_kernel(
        region, count, evidence.empty, evidence.low, evidence.top, evidence.residual, *planes, continues
    )
    return np.asarray(hits / np.maximum(size, 1), np.float64)


@kernel
def rims_kernel(
    region: Labels,
    count: int,
    empty: Mask,
    low: Values,
    top: Values,
    residual: Values,
    level: Values,
    east: Values,
    north: Values,
    side: float,
    continues: float,
) -> tuple[Integers, Integers]:
    """Pairs (count + 1,) of a cell of each region and an eight-neighbour with points outside, and those among
    them in which the terrain continues it; see `attached_share`."""
    rows, columns = region.shape
    size, hits = np.zeros(count + 1, np.int64), np.zeros(count + 1, np.int64)
    for row in range(rows):
        for column in range(columns):
            number = region[row, column]
            if number == 0:
                continue
            for y in range(max(0, row - 1), min(rows, row + 2)):
                for x in range(max(0, column - 1), min(columns, column + 2)):
                    if region[y, x] or empty[y, x]:
                        continue
                    size[number] += 1
                    if np.isfinite(low[y, x]):
                        plane = carried_on(level, east, north, side, row, column, y - row, x - column)
                        hits[number] += missed_by(top, residual, low[y, x], plane, row, column) < continues
    return size, hits
