"""Roofs that show no points of their own: holes in the data with a level rim (glass, water, wet bitumen), and
planes of buildings carried on below crowns, as far as points lie on them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.detect.consensus.evidence import Evidence, groups_of
from eaves.detect.stage import MIN_AREA_M2, MOST
from eaves.methods import Method, parameter
from eaves.model import Labels, Mask, Points, Values
from eaves.raster.groups import grown_by_square


class VoidRules(Method):
    """Rules for the holes in the data that are roofs."""

    void_rim_share: float = parameter(
        MOST, "Least share of a hole's rim that is well above the terrain.", ge=0.0, le=1.0
    )
    void_rim_spread: float = parameter(
        1.0,
        "Largest range of the rim's heights, without the lowest and the highest tenth: it is level.",
        unit="m",
        gt=0.0,
    )
    void_rim_several: float = parameter(
        0.5,
        "Largest share of the rim's points from pulses with several returns: it is no crown.",
        ge=0.0,
        le=1.0,
    )


def find_roof_voids(evidence: Evidence, limits: VoidRules) -> tuple[Mask, Mask]:
    """Empty cells (H, W) that a level, raised rim surrounds, and the raised cells of those rims (H, W). Holes
    narrower than a window are chance."""
    found, count = evidence.gaps
    area = np.bincount(found.ravel()) * evidence.cells.side**2
    inner = found[1:-1, 1:-1]
    wide = (found[:-2, 1:-1] > 0) & (found[2:, 1:-1] > 0) & (found[1:-1, :-2] > 0) & (found[1:-1, 2:] > 0)
    likely = (np.bincount(inner[wide], minlength=count + 1) > 0) & (area >= MIN_AREA_M2)
    likely[0] = False
    void, rims = np.zeros(evidence.shape, bool), np.zeros(evidence.shape, bool)
    for _, around, hole in groups_of(np.where(likely[found], found, 0)):
        rim = grown_by_square(hole, 3) & ~hole
        raised = rim & evidence.candidate[around]
        if raised.sum() < limits.void_rim_share * rim.sum():
            continue
        low, high = np.percentile(evidence.height[around][raised], (10, 90))
        several = evidence.multi_return_share[around][raised].mean()
        if high - low <= limits.void_rim_spread and several <= limits.void_rim_several:
            void[around] |= hole
            rims[around] |= raised
    return void, rims


def find_hidden_roofs(
    evidence: Evidence,
    xyz: Points,
    usable: Mask,
    region: Labels,
    surface: Mask,
    tolerance: float,
    reach: float,
) -> NDArray[np.int32]:
    """The region of each point (N,) on a building's plane carried on below a crown, 0 for the others.

    `region` (H, W) numbers the buildings' cells, `surface` (H, W) marks cells with a roof plane, and `usable`
    (N,) the points that are no noise; a plane is carried on by `reach` (m), where points lie on it to a
    `tolerance` (m) and at most half as many below: beyond a roof the beam goes on to the ground. From each
    round's cells the plane of the neighbour that most points lie on is taken over; ties go to the smaller
    cell number.
    """
    columns, side = evidence.shape[1], evidence.cells.side
    east, north, level = (plane.ravel().copy() for plane in (evidence.east, evidence.north, evidence.level))
    owner = np.where(surface, region, 0).astype(np.int32).ravel()
    open_ = (evidence.candidate & (region == 0)).ravel()
    hidden = np.zeros(len(owner), np.int32)
    front = np.flatnonzero(owner)

    def above_plane(points: NDArray[np.int64], cells: NDArray[np.int64]) -> Values:
        row, column = np.divmod(cells, columns)
        x = xyz[points, 0] - evidence.cells.west - (column + 0.5) * side
        y = xyz[points, 1] - evidence.cells.north + (row + 0.5) * side
        return np.asarray(xyz[points, 2] - level[cells] - east[cells] * x - north[cells] * y, np.float64)

    for _ in range(round(reach / side)):
        source = np.repeat(front, 8)
        target = (front[:, None] + evidence.cells.neighbours).ravel()
        free = open_[target]
        source, target = source[free], target[free]
        which, points = evidence.cells.points_of(target)
        which, points = which[usable[points]], points[usable[points]]
        rise = above_plane(points, source[which])
        on = np.bincount(which[np.abs(rise) <= tolerance], minlength=len(target))
        below = np.bincount(which[rise < -tolerance], minlength=len(target))
        good = (on > 0) & (below <= 0.5 * on)
        source, target, on = source[good], target[good], on[good]
        order = np.lexsort((source, -on, target))
        source, target = source[order], target[order]
        first = np.flatnonzero(np.diff(target, prepend=-1))
        source, front = source[first], target[first]
        if not len(front):
            break
        down, right = front // columns - source // columns, front % columns - source % columns
        level[front] = level[source] + side * (east[source] * right - north[source] * down)
        east[front], north[front] = east[source], north[source]
        hidden[front] = owner[front] = owner[source]
        open_[front] = False

    found = np.zeros(len(xyz), np.int32)
    inside = np.flatnonzero((hidden[evidence.cells.cell] > 0) & usable)
    inside = inside[np.abs(above_plane(inside, evidence.cells.cell[inside])) <= tolerance]
    found[inside] = hidden[evidence.cells.cell[inside]]
    return found
