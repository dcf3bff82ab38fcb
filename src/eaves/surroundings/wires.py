"""Which points are wires and the towers that carry them, by ASPRS classes 14 and 15."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from eaves.model import Mask, PointCloud, Points, Values
from eaves.model.cloud import GROUND, UNCLASSIFIED
from eaves.raster.squares import grown_by_square

Cells = NDArray[np.int64]
Grid = NDArray[np.float64]


@dataclass(frozen=True)
class WireRules:
    """What counts as a wire: points in a row, in long straight lines with air beneath.

    The limits follow from how lines are built; they were chosen on simulated lines.
    """

    spacing: float = 0.6
    """In sparser scans (m) too few points of a span are neighbours."""
    cell: float = 1.0
    """Side (m) of the cells."""
    height: float = 4.0
    """Lowest height (m) over the terrain: lines along roads hang 5 m high and more."""
    air: float = 2.0
    """Empty height (m) beneath, at least, or above a roof: crowns reach down."""
    thick: float = 3.0
    """Range of heights (m) in a cell, at most: the conductors of a low line one over the other."""
    step: float = 0.5
    """One point is looked at in each cube (m): neighbours then show a row, not the noise."""
    neighbours: int = 4
    """So many neighbours of a point lie in a row with it."""
    few: int = 16
    """Points, one in each cube, in three by three cells and one layer, at most: a roof has 36, and half of
    it 18."""
    layer: float = 4.0
    """Height (m) of a layer."""
    reach: float = 4.0
    """Farther ones (m) are of another conductor."""
    across: float = 0.15
    """Standard deviation (m) across the row, at most: noise and sag."""
    slender: float = 0.15
    """The same, in standard deviations along it."""
    slope: float = 0.5
    """Rise of a row, at most, for each metre along it."""
    link: int = 2
    """Cells without points, at most, between two of a line."""
    length: float = 25.0
    """Least length (m): shorter are branches, gutters and handrails."""
    beside: int = 2
    """A tower stands within so many cells of a wire."""
    below: float = 3.0
    """Its top is no farther (m) under the wire."""
    upright: float = 4.0
    """Times higher than wide, at least, in the middle of its height: a tree is not."""
    arms: int = 16
    """It has no more cells as high as that: a mast and its arms; a crown is wider."""
    gap: float = 0.25
    """Largest gap among its heights, in its own height: a tree beneath a wire does not reach up to it."""
    root: float = 0.5
    """Its points begin below this share of its height."""


RULES = WireRules()


def find_wires(cloud: PointCloud, height: Values, spacing: float, rules: WireRules = RULES) -> Mask:
    """The points (N,) of wires.

    Parameters
    ----------
    cloud : classified, N points about the origin of a block.
    height : of the points over the terrain (N,), m.
    spacing : mean distance (m) of neighbouring points.
    rules : what counts as a wire.
    """
    found = np.zeros(len(cloud), bool)
    assert cloud.classification is not None
    high = (height >= rules.height) & (cloud.classification != GROUND) & ~cloud.noise
    if spacing > rules.spacing or not high.any():
        return found
    places = np.flatnonzero(high)
    xyz = cloud.xyz.take(places, axis=0)
    cell, shape = wire_cells(xyz, rules.cell)
    hanging = np.flatnonzero(top_in_air(cell, xyz[:, 2], shape, rules))
    thinned = hanging[one_each(xyz[hanging], rules.step)]
    thinned = thinned[few_around(cell[thinned], height[places[thinned]], shape, rules)]
    if len(thinned) <= rules.neighbours:
        return found
    row = wire_rows(xyz[thinned], rules)
    lines = lines_among(cell[thinned][row], shape, rules)
    wire = np.zeros(len(xyz), bool)
    wire[thinned[row & lines.ravel()[cell[thinned]]]] = True
    # what hangs as high beside a point of a line is of the line
    near = grown_by_square(lines, 3)
    rest = hanging[near.ravel()[cell[hanging]] & ~wire[hanging]]
    if wire.any() and len(rest):
        away, _ = cKDTree(xyz[wire]).query(xyz[rest], distance_upper_bound=rules.cell)
        wire[rest[np.isfinite(away)]] = True
    found[places[wire]] = True
    return found


def find_towers(
    cloud: PointCloud, wires: Mask, taken: Mask, height: Values, rules: WireRules = RULES
) -> Mask:
    """The points (N,) of slender groups that stand on the ground and are as high as a wire beside them.

    Parameters
    ----------
    cloud : classified, N points about the origin of a block.
    wires : the points of wires (N,).
    taken : points (N,) that are something else.
    height : of the points over the terrain (N,), m.
    rules : what counts as a tower.
    """
    found = np.zeros(len(cloud), bool)
    if not wires.any():
        return found
    assert cloud.classification is not None
    cell, shape = wire_cells(cloud.xyz, rules.cell)
    lowest = np.full(shape[0] * shape[1], np.inf)
    np.minimum.at(lowest, cell[wires], height[wires])
    beside = ndimage.minimum_filter(lowest.reshape(shape), 2 * rules.beside + 1)
    free = np.flatnonzero(
        (cloud.classification == UNCLASSIFIED) & ~wires & ~taken & np.isfinite(beside.ravel()[cell])
    )
    top = np.full(lowest.size, -np.inf)
    np.maximum.at(top, cell[free], height[free])
    group, count = ndimage.label(top.reshape(shape) >= beside - rules.below, np.ones((3, 3)))
    number = group.ravel()[cell[free]]
    for k in range(1, count + 1):
        mine = free[number == k]
        highest = float(height[mine].max())
        if len(np.unique(cell[mine])) > rules.arms:
            continue
        core = mine[(height[mine] > 0.2 * highest) & (height[mine] < 0.7 * highest)]
        steps = np.diff(np.sort(height[mine]))
        if len(core) == 0 or height[mine].min() > rules.root * highest or steps.max() > rules.gap * highest:
            continue
        width = float(np.ptp(cloud.xyz[core, :2], axis=0).max())
        found[mine] = highest >= rules.upright * width
    return found


def wire_cells(xyz: Points, side: float) -> tuple[Cells, tuple[int, int]]:
    """The flat number (N,) of each point's cell of a grid fixed to the world, and its rows and columns."""
    column, row = (np.floor(xyz[:, axis] / side).astype(np.int64) for axis in (0, 1))
    column -= column.min()
    row -= row.min()
    columns = int(column.max()) + 1
    return row * columns + column, (int(row.max()) + 1, columns)


def top_in_air(cell: Cells, z: Values, shape: tuple[int, int], rules: WireRules) -> Mask:
    """Which of some high points (K,) are the topmost of their cell, near in height, with air beneath them.

    Looked at from above, the first gap of `air` ends them; a cell without one has none where it is thick.
    """
    order = np.lexsort((-z, cell))
    first = np.r_[True, np.diff(cell[order]) != 0]
    drop = np.r_[0.0, -np.diff(z[order])]
    fallen = np.cumsum((drop > rules.air) & ~first)
    start = np.maximum.accumulate(np.where(first, np.arange(len(z)), 0))
    uppermost = fallen == fallen[start]
    lowest = np.full(shape[0] * shape[1], np.inf)
    np.minimum.at(lowest, cell[order][uppermost], z[order][uppermost])
    thin = z[order][start] - lowest[cell[order]] <= rules.thick
    answer = np.zeros(len(z), bool)
    answer[order[uppermost & thin]] = True
    return answer


def one_each(xyz: Points, side: float) -> NDArray[np.int64]:
    """Numbers of the points (K, 3), the first of each cube of a side (m)."""
    place = np.floor(xyz / side).astype(np.int64)
    place -= place.min(axis=0)
    size = place.max(axis=0) + 1
    _, first = np.unique((place[:, 0] * size[1] + place[:, 1]) * size[2] + place[:, 2], return_index=True)
    return np.sort(first)


def few_around(cell: Cells, height: Values, shape: tuple[int, int], rules: WireRules) -> Mask:
    """Which points (K,), by cell and height, have so few about them that they may be of wires."""
    layer = (height / rules.layer).astype(np.int64)
    layers = int(layer.max()) + 1
    place = cell * layers + layer
    count = np.bincount(place, minlength=shape[0] * shape[1] * layers).astype(np.uint16)
    around = count.reshape(*shape, layers)
    for axis in (0, 1):
        one = np.moveaxis(around, axis, 0)
        total = one.copy()
        total[1:] += one[:-1]
        total[:-1] += one[1:]
        around = np.moveaxis(total, 0, axis)
    return np.asarray(around.reshape(-1)[place] <= rules.few, np.bool_)


def wire_rows(xyz: Points, rules: WireRules) -> Mask:
    """Which points (K, 3) lie in a row with their neighbours."""
    away, near = cKDTree(xyz).query(xyz, rules.neighbours + 1, distance_upper_bound=rules.reach)
    row, some = np.zeros(len(xyz), bool), np.flatnonzero(np.isfinite(away[:, rules.neighbours]))
    if not len(some):
        return row
    group = xyz[near[some]]
    group = group - group.mean(axis=1, keepdims=True)
    moments = np.einsum("nki,nkj->nij", group, group) / (rules.neighbours + 1)
    values, vectors = np.linalg.eigh(moments)
    along, across = (np.sqrt(np.maximum(values[:, k], 0.0)) for k in (2, 1))
    axis = vectors[:, :, 2]
    level = np.hypot(axis[:, 0], axis[:, 1])
    straight = (across <= rules.across) & (across <= rules.slender * along)
    row[some] = straight & (np.abs(axis[:, 2]) <= rules.slope * level)
    return row


def lines_among(cell: Cells, shape: tuple[int, int], rules: WireRules) -> Mask:
    """The cells (H, W) of long lines among the cells (K,) of points in rows."""
    there = np.zeros(shape[0] * shape[1], bool)
    there[cell] = True
    there = there.reshape(shape)
    joined = grown_by_square(there, (rules.link + 1) // 2 * 2 + 1)
    group, count = ndimage.label(joined, np.ones((3, 3)))
    group = np.where(there, group, 0)
    kept = np.zeros(count + 1, bool)
    for k, window in enumerate(ndimage.find_objects(group), 1):
        length = 0.0 if window is None else float(np.hypot(*(one.stop - one.start for one in window)))
        kept[k] = rules.cell * length >= rules.length
    return np.asarray(kept[group], np.bool_)
