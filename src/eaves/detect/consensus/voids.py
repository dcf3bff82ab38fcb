"""Roofs that swallow the beam (glass, water, wet bitumen): holes in the data with a level rim."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from eaves.detect.consensus.evidence import Evidence
from eaves.detect.consensus.segments import inner_width
from eaves.model import Mask, Values

LEAST_M2, MOST_M2 = 6.0, 400.0
"""Smaller holes are closed by the outline; larger ones are courts, ponds or the outside of the survey."""
LEAST_WIDTH_M, LEAST_WIDTH_CELLS = 2.0, 3.0
"""Chance leaves single cells empty, and the shadow of a wall is a strip; a roof is neither."""
RIM_SHARE = 0.7
"""So much of the rim stands well above the terrain."""
RIM_SPREAD_M = 1.0
"""The rim of a roof is level: its heights, without the lowest and the highest tenth, differ by no more."""
RIM_SEVERAL = 0.5
"""The rim is no crown: at most so many of its points came from a pulse with several returns."""


def find_roof_voids(evidence: Evidence) -> tuple[Mask, Mask]:
    """Empty cells (H, W) that a level, raised rim surrounds, and the raised cells of those rims (H, W)."""
    empty = (evidence.cells.count == 0).reshape(evidence.shape)
    found, count = ndimage.label(empty)
    side = evidence.cells.side
    area = np.bincount(found.ravel(), minlength=count + 1)[1:] * side * side
    width = inner_width(np.asarray(found, np.int32), count)
    wide = (width >= LEAST_WIDTH_CELLS) & (width * side >= LEAST_WIDTH_M)
    void, rims = np.zeros(evidence.shape, bool), np.zeros(evidence.shape, bool)
    likely = np.flatnonzero(wide & (area >= LEAST_M2) & (area <= MOST_M2)) + 1
    number_of = np.zeros(count + 1, np.int32)
    number_of[likely] = np.arange(1, len(likely) + 1)
    holes = number_of[found]
    for number, (rows, columns) in enumerate(ndimage.find_objects(holes), 1):
        window = (
            slice(max(0, rows.start - 1), rows.stop + 1),
            slice(max(0, columns.start - 1), columns.stop + 1),
        )
        hole = holes[window] == number
        rim = ndimage.binary_dilation(hole, np.ones((3, 3), bool)) & ~hole
        raised = rim & evidence.candidate[window]
        if raised.sum() < RIM_SHARE * rim.sum():
            continue
        low, high = np.percentile(evidence.height[window][raised], (10, 90))
        if high - low <= RIM_SPREAD_M and evidence.multi_return_share[window][raised].mean() <= RIM_SEVERAL:
            void[window] |= hole
            rims[window] |= raised
    return void, rims


def raise_rims(odds: Values, rims: Mask, least: float) -> Values:
    """The odds (H, W) with those of the rims of roof voids raised to `least`."""
    return np.where(rims, np.maximum(odds, least), odds)
