"""Roofs that swallow the beam (glass, water, wet bitumen): holes in the data with a level rim."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from eaves.detect.consensus.evidence import Evidence
from eaves.detect.consensus.segments import inner_width
from eaves.model import Mask, Values
from eaves.raster.squares import grown_by_square


@dataclass(frozen=True)
class VoidLimits:
    """Which holes in the data are roofs."""

    area: float
    """Smaller holes (m²) are closed by the outline."""
    most_area: float
    """Larger ones (m²) are courts, ponds or the outside of the survey."""
    width: float
    width_cells: float
    """Chance leaves single cells empty, and the shadow of a wall is a strip: least width (m; cells)."""
    rim_share: float
    """Share of the rim, at least, well above the terrain."""
    rim_spread: float
    """Range (m), at most, of the rim's heights without the lowest and the highest tenth."""
    rim_several: float
    """Share, at most, of the rim's points from pulses with several returns: it is no crown."""


def find_roof_voids(evidence: Evidence, limits: VoidLimits) -> tuple[Mask, Mask]:
    """Empty cells (H, W) that a level, raised rim surrounds, and the raised cells of those rims (H, W)."""
    empty = (evidence.cells.count == 0).reshape(evidence.shape)
    found, count = ndimage.label(empty)
    side = evidence.cells.side
    area = np.bincount(found.ravel(), minlength=count + 1)[1:] * side * side
    width = inner_width(np.asarray(found, np.int32), count)
    wide = (width >= limits.width_cells) & (width * side >= limits.width)
    void, rims = np.zeros(evidence.shape, bool), np.zeros(evidence.shape, bool)
    likely = np.flatnonzero(wide & (area >= limits.area) & (area <= limits.most_area)) + 1
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
        if raised.sum() < limits.rim_share * rim.sum():
            continue
        low, high = np.percentile(evidence.height[window][raised], (10, 90))
        if (
            high - low <= limits.rim_spread
            and evidence.multi_return_share[window][raised].mean() <= limits.rim_several
        ):
            void[window] |= hole
            rims[window] |= raised
    return void, rims


def raise_rims(odds: Values, rims: Mask, least: float) -> Values:
    """The odds (H, W) with those of the rims of roof voids raised to `least`."""
    return np.where(rims, np.maximum(odds, least), odds)
