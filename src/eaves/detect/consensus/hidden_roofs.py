"""Roofs under crowns: planes of buildings carried on below the foliage, as far as points lie on them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.detect.consensus.evidence import Evidence
from eaves.model import Labels, Mask, Points, Values


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
