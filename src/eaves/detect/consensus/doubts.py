"""Where the evidence contradicts itself or is missing: places for a person to look at."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from eaves.detect.consensus.evidence import Evidence
from eaves.detect.stage import MIN_AREA_M2
from eaves.methods import Method, parameter
from eaves.model import Labels, Mask, Values
from eaves.model.doubt import Doubt
from eaves.raster.squares import grown_by_square

STAGE = "detect"


class DoubtRules(Method):
    """When a region is doubtful."""

    doubt_score: float = parameter(
        0.2, "A region with a score between this and one less this is doubtful.", ge=0.0, le=0.5
    )
    doubt_rim: float = parameter(
        0.1,
        "A region with more of its rim on the rim of the data is doubtful: chance gaps touch less.",
        ge=0.0,
        le=1.0,
    )
    doubt_afloat: float = parameter(
        0.6,
        "A region with water, or nothing, along more of its rim is doubtful: a house by a canal has land on "
        "three sides.",
        ge=0.0,
        le=1.0,
    )


def region_doubts(
    evidence: Evidence,
    region: Labels,
    score: Values,
    attached: Values,
    water: Mask,
    most_attached: float,
    limits: DoubtRules,
) -> list[Doubt]:
    """Doubts about regions 1…K of cells (H, W).

    Parameters
    ----------
    evidence : of the cells.
    region : number of each cell's region, 0 for none.
    score : how sure each region is, (K,).
    attached : share of the rim that continues the terrain, (K + 1,).
    water : cells with a point of water, (H, W).
    most_attached : the largest share of a building; half of it is doubtful.
    limits : from where on there is doubt.

    Returns
    -------
    list of Doubt
        In the order of the regions; a region may give several. Places are local metres.
    """
    found: list[Doubt] = []
    empty = (evidence.cells.count == 0).reshape(evidence.shape)
    outside = outside_of(empty)
    area = evidence.cells.side**2
    for number, window in enumerate(ndimage.find_objects(region), 1):
        if window is None:
            continue
        rows, columns = window
        around = (
            slice(max(0, rows.start - 1), rows.stop + 1),
            slice(max(0, columns.start - 1), columns.stop + 1),
        )
        of_region = region[around] == number
        size = float(of_region.sum()) * area
        rim = grown_by_square(of_region, 3) & ~of_region
        open_rim = rim & outside[around]

        def doubt(
            mask: Mask,
            reason: str,
            corner: tuple[int, int] = (around[0].start, around[1].start),
            size: float = size,
        ) -> Doubt:
            return doubt_at(evidence, mask, corner, size, reason)

        if size < MIN_AREA_M2:
            continue
        if limits.doubt_score <= score[number - 1] <= 1.0 - limits.doubt_score:
            found.append(doubt(of_region, f"a roof or not: score {score[number - 1]:.2f}"))
        if attached[number] > most_attached / 2:
            share = round(100 * attached[number])
            found.append(doubt(of_region, f"a roof or a rock: {share} % of its rim continues the terrain"))
        wet = rim & water[around]
        if wet.any() and (wet | (rim & empty[around])).sum() > limits.doubt_afloat * rim.sum():
            found.append(doubt(of_region, "a building or a ship: there is water all round"))
        if open_rim.sum() > limits.doubt_rim * rim.sum():
            found.append(doubt(open_rim, "a building on the rim of the data"))
    return found


def crown_doubts(region: Labels, evidence: Evidence, roofs: Mask, most: float) -> list[Doubt]:
    """Doubts about regions 1…K of cells (H, W) of which the middle residual is more than `most` times that of
    the cells of all `roofs` (H, W): where echoes tell nothing, an even crown passes for a roof."""
    known = np.isfinite(evidence.residual)
    if not (known & roofs).any():
        return []
    usual = float(np.median(evidence.residual[known & roofs]))
    found = []
    for number, window in enumerate(ndimage.find_objects(region), 1):
        if window is None:
            continue
        of_region = region[window] == number
        size = float(of_region.sum()) * evidence.cells.side**2
        own = evidence.residual[window][of_region & known[window]]
        if size < MIN_AREA_M2 or not len(own) or np.median(own) <= most * usual:
            continue
        times = float(np.median(own)) / max(usual, 1e-4)
        reason = (
            f"a roof or a crown: {times:.1f} times as uneven as the roofs of a scan that splits few pulses"
        )
        found.append(doubt_at(evidence, of_region, (window[0].start, window[1].start), size, reason))
    return found


def void_doubts(evidence: Evidence, void: Mask) -> list[Doubt]:
    """Doubts about the holes (H, W) that were taken for roofs because their rims are level and raised."""
    found, _ = ndimage.label(void)
    doubts = []
    for number, window in enumerate(ndimage.find_objects(found), 1):
        of_region = found[window] == number
        corner = (window[0].start, window[1].start)
        size = float(of_region.sum()) * evidence.cells.side**2
        doubts.append(
            doubt_at(evidence, of_region, corner, size, "a hole in the data, taken for a roof by its rim")
        )
    return doubts


def doubt_at(evidence: Evidence, mask: Mask, corner: tuple[int, int], area_m2: float, reason: str) -> Doubt:
    """The doubt in the middle of a mask (h, w) whose first cell is at `corner` (row, column)."""
    rows, columns = np.nonzero(mask)
    side = evidence.cells.side
    x = evidence.cells.west + (corner[1] + float(columns.mean()) + 0.5) * side
    y = evidence.cells.north - (corner[0] + float(rows.mean()) + 0.5) * side
    return Doubt(round(x, 2), round(y, 2), round(area_m2, 1), reason, STAGE)


def outside_of(empty: Mask) -> Mask:
    """The empty cells (H, W) that are connected with the border of the grid."""
    found, count = ndimage.label(empty)
    border = np.zeros(count + 1, bool)
    for line in (found[0], found[-1], found[:, 0], found[:, -1]):
        border[line] = True
    border[0] = False
    return np.asarray(border[found], np.bool_)
