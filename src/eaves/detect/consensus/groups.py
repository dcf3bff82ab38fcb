"""Groups of building cells: without narrow parts, and how far their rims go on in the terrain."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from eaves.detect.consensus.evidence import Evidence, carried_on, groups_of, missed_by
from eaves.detect.stage import MIN_AREA_M2, MOST, ROOM_M
from eaves.kernels import kernel
from eaves.methods import Method, parameter
from eaves.model import Integers, Labels, Mask, Points, Values
from eaves.model.scene import ROOF, WALL
from eaves.raster.blur import closed_by_square, grown_by_square, opened_by_square, shrunk_by_square

UNIT = 100.0
"""Capacities are whole numbers: hundredths of a unit of log odds (a definition, not a threshold)."""


def cut_cells(evidence: Evidence, odds: Values, sure: float, smoothness: float, max_jump: float) -> Mask:
    """The building cells (H, W): the labelling of least energy.

    The energy is the sum of `odds` (log odds for a building, (H, W)) over the cells called otherwise, and of
    a price for each pair of neighbours called differently: `smoothness` where their surfaces continue each
    other, little where the height jumps by more than `max_jump` (m). Cells whose odds exceed `sure` either
    way are settled beforehand.
    """
    building = evidence.candidate & (odds >= sure)
    unsettled = evidence.candidate & (np.abs(odds) < sure)
    nodes = np.flatnonzero(unsettled)
    if not len(nodes):
        return building
    number = np.full(unsettled.size, -1, np.int32)
    number[nodes] = np.arange(len(nodes))
    one, two, gap = gaps_kernel(
        evidence.candidate,
        unsettled,
        evidence.top,
        evidence.residual,
        evidence.level,
        evidence.east,
        evidence.north,
        evidence.cells.side,
    )
    price = smoothness * np.exp(-((gap / max_jump) ** 2))
    columns = evidence.shape[1]
    beside = (one // columns == two // columns) | (one % columns == two % columns)
    price = np.where(beside, price, np.sqrt(0.5) * price)

    gain = np.maximum(odds.ravel()[nodes], 0.0)
    loss = np.maximum(-odds.ravel()[nodes], 0.0)
    for inner, outer in ((one, two), (two, one)):
        rim = unsettled.ravel()[inner] & ~unsettled.ravel()[outer]
        yes, no = rim & building.ravel()[outer], rim & ~building.ravel()[outer]
        gain += np.bincount(number[inner[yes]], weights=price[yes], minlength=len(nodes))
        loss += np.bincount(number[inner[no]], weights=price[no], minlength=len(nodes))
    both = unsettled.ravel()[one] & unsettled.ravel()[two]
    pairs = (number[one[both]], number[two[both]], price[both])
    del one, two, price, beside, both  # of a wide scene they would be alive at the peak of memory
    building.ravel()[nodes[source_side(gain, loss, pairs)]] = True
    return building


def source_side(
    gain: Values, loss: Values, pairs: tuple[NDArray[np.int32], NDArray[np.int32], Values]
) -> Mask:
    """Mask (N,) of the nodes that the least cut leaves with the source.

    `gain` and `loss` (N,) are the prices of cutting a node off the source and off the sink; `pairs` holds two
    nodes and the price of parting them, (P,) each.
    """
    whole = [np.rint(UNIT * values).astype(np.int32) for values in (gain, loss, pairs[2])]
    return np.asarray(cut_kernel(whole[0] - whole[1], pairs[0], pairs[1], whole[2]))


@kernel
def cut_kernel(
    spare: NDArray[np.int32], one: NDArray[np.int32], two: NDArray[np.int32], price: NDArray[np.int32]
) -> Mask:
    """Mask (N,) of the nodes that the least cut leaves with the source, by maximum flow [dinic1970].

    `spare` (N,) is what the source can send to a node, or where it is negative what the node can send to the
    sink, and is used up; `price` (P,) is what `one` and `two` (P,) can send each other.
    """
    count, pairs = len(spare), len(one)
    start, path, queue = np.zeros(count + 1, np.int64), np.empty(count, np.int64), np.empty(count, np.int64)
    for pair in range(pairs):
        start[one[pair] + 1] += 1
        start[two[pair] + 1] += 1
    for node in range(count):
        start[node + 1] += start[node]
    arc, level = start[:-1].copy(), np.empty(count, np.int64)
    to, back, left = (
        np.empty(2 * pairs, np.int64),
        np.empty(2 * pairs, np.int64),
        np.empty(2 * pairs, np.int32),
    )
    for pair in range(pairs):
        there, here = arc[one[pair]], arc[two[pair]]
        to[there], to[here], back[there], back[here] = two[pair], one[pair], here, there
        left[there] = left[here] = price[pair]
        arc[one[pair]] += 1
        arc[two[pair]] += 1
    while True:
        head = tail = 0
        open_ = False
        for node in range(count):
            level[node] = 0 if spare[node] > 0 else -1
            if spare[node] > 0:
                queue[tail] = node
                tail += 1
        sources = tail
        while head < tail:
            node = queue[head]
            head += 1
            open_ = open_ or spare[node] < 0
            for a in range(start[node], start[node + 1]):
                if left[a] > 0 and level[to[a]] < 0:
                    level[to[a]], queue[tail] = level[node] + 1, to[a]
                    tail += 1
        if not open_:
            return level >= 0
        arc[:] = start[:-1]  # the first arc of each node that may still lead to the sink
        for source in queue[:sources]:
            node, depth = source, 0
            while spare[source] > 0:
                if spare[node] < 0:
                    flow = min(spare[source], -spare[node])
                    for a in path[:depth]:
                        flow = min(flow, left[a])
                    spare[source] -= flow
                    spare[node] += flow
                    for step in range(depth - 1, -1, -1):
                        a = path[step]
                        left[a] -= flow
                        left[back[a]] += flow
                        if left[a] == 0:  # the search goes on from before the first arc that is full
                            node, depth = to[back[a]], step
                    continue
                a = arc[node]
                if a == start[node + 1]:
                    if depth == 0:
                        break
                    depth -= 1
                    node = to[back[path[depth]]]
                    arc[node] += 1
                elif left[a] > 0 and level[to[a]] == level[node] + 1:
                    path[depth], node, depth = a, to[a], depth + 1
                else:
                    arc[node] += 1


@kernel
def gaps_kernel(
    mask: Mask,
    subset: Mask,
    top: Values,
    residual: Values,
    level: Values,
    east: Values,
    north: Values,
    side: float,
) -> tuple[Integers, Integers, Values]:
    """Flat numbers (P,) of both of each pair of eight-neighbours of a mask (H, W) of which one is in a subset
    (H, W), and the distance (P,), in m, by which the highest points of both miss each other's surface: the
    least of both ways."""
    rows, columns = mask.shape
    most = 8 * np.count_nonzero(subset)
    one, two, gap, count = np.empty(most, np.int64), np.empty(most, np.int64), np.empty(most), 0
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        for row in range(rows - down):
            for column in range(max(0, -right), columns - max(0, right)):
                y, x = row + down, column + right
                if not (mask[row, column] and mask[y, x] and (subset[row, column] or subset[y, x])):
                    continue
                plane = carried_on(level, east, north, side, row, column, down, right)
                there = missed_by(top, residual, top[y, x], plane, row, column)
                plane = carried_on(level, east, north, side, y, x, -down, -right)
                back = missed_by(top, residual, top[row, column], plane, y, x)
                one[count], two[count], gap[count] = row * columns + column, y * columns + x, min(there, back)
                count += 1
    return one[:count], two[:count], gap[:count]


def part_of_points(
    xyz: Points,
    number: Labels,
    evidence: Evidence,
    region: Labels,
    max_residual: float,
    below_plane: float,
) -> NDArray[np.uint8]:
    """Codes (N,) for the points (N, 3) of regions `number` (N,), 0 for the others.

    Walls show only at the rim of a region; whatever lies inside it (chimneys, machinery, the floor of a
    light well) counts as roof. There a point `below_plane` (m) under its cell's plane is on the wall, and in
    a cell without a plane one twice as far under the highest.
    """
    part = np.where(number > 0, ROOF, 0).astype(np.uint8)
    inner = shrunk_by_square(region > 0, 5)
    flat = evidence.residual < max_residual
    lowest = np.where(flat, evidence.level - below_plane, evidence.top - 2.0 * below_plane)
    lowest = np.where(inner, -np.inf, lowest).ravel()
    some = np.flatnonzero(number > 0)
    part[some[xyz[some, 2] < lowest[evidence.cells.cell[some]]]] = WALL
    return part


class VehicleRules(Method):
    """The measures of road vehicles."""

    vehicle_width: float = parameter(
        ROOM_M,
        "Largest width of a vehicle, less than any room's: the legal limit is 2.55 m, and points stop "
        "short of edges.",
        unit="m",
        ge=0.0,
    )
    vehicle_length: float = parameter(1.9, "Least ratio of a vehicle's length to its width.", ge=0.0)
    vehicle_height: float = parameter(4.2, "Largest height of a vehicle's top.", unit="m", ge=0.0)
    vehicle_level: float = parameter(
        0.6,
        "Half the range of heights on top of a vehicle; what leaves it is something else.",
        unit="m",
        gt=0.0,
    )
    vehicle_flat: float = parameter(
        MOST,
        "Share at that level of what rises over half of it, and share of this in all: where walls are soft "
        "the middle of a narrow top alone is level.",
        ge=0.0,
        le=1.0,
    )


def find_vehicles(xyz: Points, height: Values, number: Labels, count: int, limits: VehicleRules) -> Mask:
    """Mask of the regions 0…`count` - 1 of points (N, 3), of which `number` (N,) tells the region, that are
    as long, narrow, low and level as a van or a lorry.

    Length and width are those of the rectangle with the same second moments as the points at the level of the
    region's middle height: what hangs over it, or stands beside it, does not count.
    """
    inside = np.flatnonzero(number > 0)
    low = middle_of_groups(height[inside], number[inside], count)
    middle_height = low[number[inside]]
    above = height[inside] - middle_height
    level = inside[np.abs(above) < limits.vehicle_level]
    raised = (above < limits.vehicle_level) & (above > -middle_height / 2)
    which = number[level]
    size = np.bincount(which, minlength=count)

    def mean(values: Values) -> Values:
        return np.asarray(np.bincount(which, values, count) / np.maximum(size, 1), np.float64)

    x, y = (xyz[level, axis] - mean(xyz[level, axis])[which] for axis in (0, 1))
    xx, xy, yy = mean(x * x), mean(x * y), mean(y * y)
    middle, spread = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    length = np.sqrt(12 * (middle + spread))
    width = np.sqrt(12 * np.maximum(middle - spread, 0.0))
    narrow = (width < limits.vehicle_width) & (length > limits.vehicle_length * width)
    body = np.bincount(number[inside[raised]], minlength=count)
    every = np.bincount(number[inside], minlength=count)
    flat = (size >= limits.vehicle_flat * body) & (body >= limits.vehicle_flat * every)
    return np.asarray(narrow & flat & (low < limits.vehicle_height) & (size > 0), np.bool_)


def middle_of_groups(values: Values, which: Labels, count: int) -> Values:
    """Median (count,) of the values (N,) of each group (N,) 0…count-1; zero where a group is empty."""
    order = np.lexsort((values, which))
    size = np.bincount(which, minlength=count)
    start = np.cumsum(size) - size
    middle = np.zeros(count)
    some = size > 0
    middle[some] = values[order][(start + size // 2)[some]]
    return middle


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


def without_narrow_parts(building: Mask, evidence: Evidence, least: float) -> Mask:
    """The building cells (H, W) without parts that no square of a side `least` (m) fits into.

    What lies within half that square of one that fits stays, so corners and eaves do, and so does all that is
    connected with none: a shed may be narrower than a room. Empty cells between building cells count as
    building: at one spacing a third of all cells is empty by chance.
    """
    size = int(least / evidence.cells.side + 1e-9)
    if size < 2:
        return building
    closed = building | (closed_by_square(building, 3) & evidence.empty)
    core = opened_by_square(closed, size)
    near = grown_by_square(core, size // 2 * 2 + 1)
    group, count = ndimage.label(closed, np.ones((3, 3)))
    broad = np.zeros(count + 1, bool)
    broad[group[core]] = True
    return np.asarray(building & (near | ~broad[group]))


def without_pores(building: Mask, surface: Labels, side: float, least: float) -> Mask:
    """The building cells (H, W) with all gaps that one surface, by its number (H, W), 0 for none, surrounds,
    and that are smaller than a square of a side `least` (m), or nowhere half as wide: what is seen through
    membranes, meshes and glass.

    `side` (m) is that of a cell; gaps are four-connected, so that chance joins few of them.
    """
    gap, count = ndimage.label(~building)
    small = np.bincount(gap.ravel(), minlength=count + 1) * side**2 < least**2
    narrow = np.ones(count + 1, bool)
    narrow[gap[opened_by_square(~building, int(0.5 * least / side + 0.5))]] = False
    small |= narrow
    first, last = np.full(count + 1, np.iinfo(np.int32).max), np.zeros(count + 1, np.int32)
    around = np.pad(np.where(building, surface, -1), 1)  # beyond the border there is no surface
    rows, columns = np.nonzero((gap > 0) & small[gap])
    number = gap[rows, columns]
    for south in range(3):
        for east in range(3):
            beside = around[rows + south, columns + east]
            known = beside >= 0
            np.minimum.at(first, number[known], beside[known])
            np.maximum.at(last, number[known], beside[known])
    filled = (first == last) & (last > 0)
    return np.asarray(building | filled[gap], np.bool_)


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
    planes = evidence.level, evidence.east, evidence.north, evidence.cells.side
    size, hits = rims_kernel(
        region, count, evidence.empty, evidence.low, evidence.top, evidence.residual, *planes, continues
    )
    return np.asarray(hits / np.maximum(size, 1), np.float64)


@kernel
def rims_kernel(
    region: Labels,
    count: int,
    empty: Mask,
    low: Values,
    top: Values,
    residual: Values,
    level: Values,
    east: Values,
    north: Values,
    side: float,
    continues: float,
) -> tuple[Integers, Integers]:
    """Pairs (count + 1,) of a cell of each region and an eight-neighbour with points outside, and those among
    them in which the terrain continues it; see `attached_share`."""
    rows, columns = region.shape
    size, hits = np.zeros(count + 1, np.int64), np.zeros(count + 1, np.int64)
    for row in range(rows):
        for column in range(columns):
            number = region[row, column]
            if number == 0:
                continue
            for y in range(max(0, row - 1), min(rows, row + 2)):
                for x in range(max(0, column - 1), min(columns, column + 2)):
                    if region[y, x] or empty[y, x]:
                        continue
                    size[number] += 1
                    if np.isfinite(low[y, x]):
                        plane = carried_on(level, east, north, side, row, column, y - row, x - column)
                        hits[number] += missed_by(top, residual, low[y, x], plane, row, column) < continues
    return size, hits
