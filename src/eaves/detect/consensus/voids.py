"""Roofs that swallow the beam (glass, water, wet bitumen): holes in the data with a level rim."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from eaves.detect.consensus.evidence import Evidence
from eaves.detect.consensus.segments import inner_width
from eaves.detect.consensus.windows import WINDOW
from eaves.detect.stage import MIN_AREA_M2, MOST
from eaves.methods import Method, parameter
from eaves.model import Mask
from eaves.raster.squares import grown_by_square


class VoidRules(Method):
    """Which holes in the data are roofs."""

    void_rim_share: float = parameter(
        MOST, "Share of a hole's rim, at least, well above the terrain.", ge=0.0, le=1.0
    )
    void_rim_spread: float = parameter(
        1.0,
        "Range of the rim's heights, at most, without the lowest and the highest tenth: it is level.",
        unit="m",
        gt=0.0,
    )
    void_rim_several: float = parameter(
        0.5,
        "Share, at most, of the rim's points from pulses with several returns: it is no crown.",
        ge=0.0,
        le=1.0,
    )


def find_roof_voids(evidence: Evidence, limits: VoidRules) -> tuple[Mask, Mask]:
    """Empty cells (H, W) that a level, raised rim surrounds, and the raised cells of those rims (H, W). Holes
    narrower than a window are chance."""
    empty = (evidence.cells.count == 0).reshape(evidence.shape)
    found, count = ndimage.label(empty)
    side = evidence.cells.side
    area = np.bincount(found.ravel(), minlength=count + 1)[1:] * side * side
    width = inner_width(np.asarray(found, np.int32), count)
    wide = width >= WINDOW
    void, rims = np.zeros(evidence.shape, bool), np.zeros(evidence.shape, bool)
    likely = np.flatnonzero(wide & (area >= MIN_AREA_M2)) + 1
    number_of = np.zeros(count + 1, np.int32)
    number_of[likely] = np.arange(1, len(likely) + 1)
    holes = number_of[found]
    for number, (rows, columns) in enumerate(ndimage.find_objects(holes), 1):
        window = (
            slice(max(0, rows.start - 1), rows.stop + 1),
            slice(max(0, columns.start - 1), columns.stop + 1),
        )
        hole = holes[window] == number
        rim = grown_by_square(hole, 3) & ~hole
        raised = rim & evidence.candidate[window]
        if raised.sum() < limits.void_rim_share * rim.sum():
            continue
        low, high = np.percentile(evidence.height[window][raised], (10, 90))
        if (
            high - low <= limits.void_rim_spread
            and evidence.multi_return_share[window][raised].mean() <= limits.void_rim_several
        ):
            void[window] |= hole
            rims[window] |= raised
    return void, rims
