"""Doubts: places for manual review, where the evidence contradicts itself or is missing."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from eaves.detect.consensus.evidence import Evidence, groups_of
from eaves.detect.stage import HOUSE_M2, MIN_AREA_M2, OBJECT
from eaves.methods import Method, parameter
from eaves.model import Doubt, Labels, Mask, Values
from eaves.raster.groups import grown_by_square

STAGE = "detect"


class DoubtRules(Method):
    """When a region is doubtful."""

    doubt_score: float = parameter(
        0.2, "A region with a score between this and one less this is doubtful.", ge=0.0, le=0.5
    )
    doubt_rim: float = parameter(
        0.1,
        "Share of a region's rim on the rim of the data above which it is doubtful: chance gaps touch less.",
        ge=0.0,
        le=1.0,
    )
    doubt_afloat: float = parameter(
        0.6,
        "Share of a region's rim along water or voids above which it is doubtful: a house by a canal has "
        "land on three sides.",
        ge=0.0,
        le=1.0,
    )
    doubt_uneven: float = parameter(
        2.2,
        "Unevenness, in multiples of that of the scan's roofs, from which a region is doubtful where "
        "echoes tell little.",
        ge=1.0,
    )


def region_doubts(
    evidence: Evidence,
    region: Labels,
    score: Values,
    attached: Values,
    water: Mask,
    most_attached: float,
    unevenness: Values,
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
    unevenness : how many times as uneven as roofs each cell is, (H, W), NaN where it does not matter.
    limits : from where on there is doubt.

    Returns
    -------
    list of Doubt
        A region may give several. Places are local metres.
    """
    found: list[Doubt] = []
    empty, outside = evidence.empty, outside_of(*evidence.gaps)
    for number, around, cells in groups_of(region):
        if cells.sum() * evidence.cells.side**2 < MIN_AREA_M2:
            continue
        sure, share = score[number - 1], attached[number]
        rim = grown_by_square(cells, 3) & ~cells
        open_rim, wet = rim & outside[around], rim & water[around]
        known = unevenness[around][cells & np.isfinite(unevenness[around])]
        uneven = float(np.median(known)) if len(known) else 0.0
        said = {
            f"a roof or not: score {sure:.2f}": limits.doubt_score <= sure <= 1.0 - limits.doubt_score,
            f"a roof or a rock: {round(100 * share)} % of its rim continues the terrain": share
            > most_attached / 2,
            "a building or a ship: there is water all round": wet.any()
            and (wet | (rim & empty[around])).sum() > limits.doubt_afloat * rim.sum(),
            f"a roof or a crown: {uneven:.1f} times as uneven as the roofs of a scan that splits few "
            "pulses": uneven > limits.doubt_uneven,
        }
        found += [doubt_at(evidence, around, cells, cells, reason) for reason, holds in said.items() if holds]
        if open_rim.sum() > limits.doubt_rim * rim.sum():
            found.append(doubt_at(evidence, around, open_rim, cells, "a building on the rim of the data"))
    return found


def object_doubts(
    evidence: Evidence, taken: Mask, odds: Values, most: float, least_height: float
) -> list[Doubt]:
    """Doubts about what rises as a house does and was not taken for one, in a scan that splits no pulse.

    Parameters
    ----------
    evidence : of the cells.
    taken : cells of buildings, (H, W).
    odds : log odds of the cells for a roof, (H, W).
    most : the largest residual (m) of a roof.
    least_height : the least height (m) of a building.
    """
    risen = evidence.candidate & ~taken & (evidence.height >= least_height)
    found, _ = ndimage.label(risen, np.ones((3, 3)))
    doubts = list[Doubt]()
    for _, around, cells in groups_of(found):
        if not HOUSE_M2[0] <= cells.sum() * evidence.cells.side**2 <= HOUSE_M2[1]:
            continue
        rough = float(np.median(evidence.residual[around][cells]))
        against = float(np.median(odds[around][cells]))
        why = (
            f"its top misses planes by {rough:.2f} m, a roof may by {most:.2f} m"
            if most < rough < np.inf
            else f"height, shape and colours speak against a roof (log odds {against:.1f})"
        )
        doubts.append(doubt_at(evidence, around, cells, cells, f"{OBJECT}: {why}"))
    return doubts


def unevenness_of(evidence: Evidence, roofs: Mask) -> Values:
    """Unevenness (H, W) of each cell as a multiple of the median of `roofs` (H, W), NaN where no plane fits:
    where echoes tell nothing, an even crown passes for a roof."""
    residual = np.where(np.isfinite(evidence.residual), evidence.residual, np.nan)
    some = residual[roofs & np.isfinite(residual)]
    return residual / max(float(np.median(some)), 1e-4) if len(some) else np.full(roofs.shape, np.nan)


def void_doubts(evidence: Evidence, void: Mask) -> list[Doubt]:
    """Doubts about the holes (H, W) that were taken for roofs because their rims are level and raised."""
    found, _ = ndimage.label(void)
    reason = "a hole in the data, taken for a roof by its rim"
    return [doubt_at(evidence, around, hole, hole, reason) for _, around, hole in groups_of(found)]


def doubt_at(evidence: Evidence, around: tuple[slice, slice], mask: Mask, cells: Mask, reason: str) -> Doubt:
    """The doubt in the middle of a mask (h, w) about so many cells (h, w), both in a window of the grid."""
    rows, columns = np.nonzero(mask)
    side = evidence.cells.side
    x = evidence.cells.west + (around[1].start + float(columns.mean()) + 0.5) * side
    y = evidence.cells.north - (around[0].start + float(rows.mean()) + 0.5) * side
    return Doubt(round(x, 2), round(y, 2), round(float(cells.sum()) * side**2, 1), reason, STAGE)


def outside_of(found: Labels, count: int) -> Mask:
    """The cells (H, W) of groups (H, W) 1…`count` that reach the border of the grid."""
    border = np.zeros(count + 1, bool)
    for line in (found[0], found[-1], found[:, 0], found[:, -1]):
        border[line] = True
    border[0] = False
    return np.asarray(border[found], np.bool_)
