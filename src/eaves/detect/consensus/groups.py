"""Groups of building cells: without narrow parts, and how far their rims go on in the terrain."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from eaves.detect.consensus.evidence import Evidence, missed_by
from eaves.model import Labels, Mask, Values
from eaves.raster.groups import closed_by_square, grown_by_square, neighbour_pairs, opened_by_square


def without_narrow_parts(building: Mask, evidence: Evidence, least: float) -> Mask:
    """The building cells (H, W) without parts that no square of a side `least` (m) fits into.

    What lies within half that square of one that fits stays, so corners and eaves do, and so does all that is
    connected with none: a shed may be narrower than a room. Empty cells between building cells count as
    building: at one spacing a third of all cells is empty by chance.
    """
    size = int(least / evidence.cells.side + 1e-9)
    if size < 2:
        return building
    empty = (evidence.cells.count == 0).reshape(evidence.shape)
    closed = building | (closed_by_square(building, 3) & empty)
    core = opened_by_square(closed, size)
    near = grown_by_square(core, size // 2 * 2 + 1)
    group, count = ndimage.label(closed, np.ones((3, 3)))
    broad = np.zeros(count + 1, bool)
    broad[group[core]] = True
    return np.asarray(building & (near | ~broad[group]))


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
    number = region.ravel()
    occupied = (evidence.cells.count > 0).reshape(evidence.shape)
    one, two = neighbour_pairs(occupied | (region > 0), region > 0)
    inner, outer = np.r_[one, two], np.r_[two, one]
    rim = (number[inner] > 0) & (number[outer] == 0)
    inner, outer = inner[rim], outer[rim]
    low = evidence.low.ravel()[outer]
    goes_on = np.isfinite(low)
    goes_on &= missed_by(evidence, inner, outer, np.where(goes_on, low, 0.0)) < continues
    size = np.bincount(number[inner], minlength=count + 1)
    hits = np.bincount(number[inner[goes_on]], minlength=count + 1)
    return np.asarray(hits / np.maximum(size, 1), np.float64)
