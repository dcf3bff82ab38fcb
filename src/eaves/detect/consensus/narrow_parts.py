"""Narrow parts of buildings: fences, hedges and garden walls that run into them."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from eaves.detect.consensus.evidence import Evidence
from eaves.model import Mask
from eaves.raster.squares import closed_by_square, grown_by_square, opened_by_square


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
