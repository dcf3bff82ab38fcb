"""Exact tests for points inside polygons."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.kernels import kernel
from eaves.model import Integers, Labels, Mask, Points, Values


@kernel
def connected_groups_kernel(first: Integers, second: Integers, count: int) -> Integers:
    """The group (N,) of each of `count` nodes, edges joining `first` (E,) to `second` (E,).

    Groups are numbered in the order of their first nodes.
    """
    head = np.arange(count)
    for edge in range(len(first)):
        unite_kernel(head, first[edge], second[edge])
    groups = 0
    for node in range(count):
        if head[node] == node:
            head[node] = groups
            groups += 1
        else:  # the head of a node comes before it, and bears its number already
            head[node] = head[head[node]]
    return head


@kernel
def unite_kernel(head: Integers, a: int, b: int) -> None:
    """Make the groups of two nodes one; following `head` (N,) leads to a group's first node, its own head."""
    while head[a] != a:
        head[a] = head[head[a]]
        a = head[a]
    while head[b] != b:
        head[b] = head[head[b]]
        b = head[b]
    if a < b:
        head[b] = a
    else:
        head[a] = b


def members(group: Labels | Integers, count: int) -> list[Integers]:
    """The numbers of the members of each of `count` groups, ascending; of group -1 there is no list."""
    order = np.argsort(group, kind="stable")
    return np.split(order, np.searchsorted(group[order], np.arange(count + 1)))[1:-1]


@kernel
def members_kernel(group: Integers, count: int) -> tuple[Integers, Integers]:
    """The numbers (N,) of the members of `count` groups, group by group, ascending, and where those of each
    begin (count + 1,)."""
    first = np.zeros(count + 1, np.int64)
    for one in group:
        first[one + 1] += 1
    for one in range(count):
        first[one + 1] += first[one]
    place, order = first[:-1].copy(), np.empty(len(group), np.int64)
    for number in range(len(group)):
        order[place[group[number]]] = number
        place[group[number]] += 1
    return order, first


POINTS_PER_CELL = 12
"""Mean number of points in a cell of plan in which they are looked up, and in a row of those of a polygon."""
ROUNDING = 1e-15
"""Share of its terms by which a cross product may be wrong; nearer to zero its sign is found exactly."""


def edges_of(
    polygons: NDArray[np.object_],
) -> tuple[Values, Values, Integers]:
    """Start and end of the edges of polygons (E, 2), (E, 2), and the polygon of each (E,), ascending."""
    rings, owner = shapely.get_rings(polygons, return_index=True)
    places, ring = shapely.get_coordinates(rings, return_index=True)
    goes_on = ring[:-1] == ring[1:]
    return places[:-1][goes_on], places[1:][goes_on], owner[ring[:-1][goes_on]].astype(np.int64)


def points_in_polygons(
    points: Points, start: Values, end: Values, owner: Integers, count: int
) -> tuple[Integers, Integers]:
    """Pairs of point and polygon (K,), (K,): points inside or on the border, in the order of the points.

    `points` are (N, 2 or 3), the edges of `count` polygons go from `start` to `end` (E, 2), all of a polygon
    together: `owner` (E,) ascends.
    """
    first = np.searchsorted(owner, np.arange(count + 1))
    x, y = np.ascontiguousarray(points[:, :2].T)
    point, polygon, sure = inside_kernel(x, y, start, end, first)
    for number in np.flatnonzero(~sure).tolist():
        edges = slice(first[polygon[number]], first[polygon[number] + 1])
        sure[number] = is_inside(x[point[number]], y[point[number]], start[edges], end[edges])
    return (point, polygon) if sure.all() else (point[sure], polygon[sure])


@kernel
def inside_kernel(
    x: Values, y: Values, start: Values, end: Values, first: Integers
) -> tuple[Integers, Integers, Mask]:
    """Pairs of point and polygon (K,), (K,) that lie inside or may do so, in their order, and which are sure
    (K,).

    Points at `x`, `y` (N,) are looked up by cells of plan; the edges of polygon p are `first[p]` to
    `first[p + 1]`. Counts the edges that a ray to the east of the point crosses.
    """
    west, south, east, north = np.inf, np.inf, -np.inf, -np.inf
    for i in range(len(x)):
        west, east = min(west, x[i]), max(east, x[i])
        south, north = min(south, y[i]), max(north, y[i])
    width, height = max(east - west, 0.0), max(north - south, 0.0)
    share = POINTS_PER_CELL / max(len(x), 1)
    per_m = 1.0 / max(np.sqrt(width * height * share), max(width, height) * share, 1e-9)
    columns, rows = int(width * per_m) + 1, int(height * per_m) + 1
    cell = np.empty(len(x), np.int64)
    for i in range(len(x)):
        cell[i] = int((y[i] - south) * per_m) * columns + int((x[i] - west) * per_m)
    order, opens = members_kernel(cell, rows * columns)
    room, hits = len(x) + 16, 0
    point, polygon = np.empty(room, np.int64), np.empty(room, np.int64)
    sure, candidates = np.empty(room, np.bool_), np.empty(len(x), np.int64)
    odd, border = np.zeros(len(x), np.bool_), np.zeros(len(x), np.bool_)
    unsure = np.zeros(len(x), np.bool_)
    for number in range(len(first) - 1):
        edges = range(first[number], first[number + 1])
        if len(edges) == 0:
            continue
        left, bottom, right, top = np.inf, np.inf, -np.inf, -np.inf
        for edge in edges:
            left, right = min(left, start[edge, 0]), max(right, start[edge, 0])
            bottom, top = min(bottom, start[edge, 1]), max(top, start[edge, 1])
        if bottom > north or top < south or left > east or right < west:
            continue
        begin, finish = int(max(left - west, 0.0) * per_m), int((min(right, east) - west) * per_m) + 1
        lowest, highest = int(max(bottom - south, 0.0) * per_m), int((min(top, north) - south) * per_m)
        count = 0
        for row in range(lowest, highest + 1):
            for place in range(opens[row * columns + begin], opens[row * columns + finish]):
                k = order[place]
                if left <= x[k] <= right and bottom <= y[k] <= top:
                    candidates[count] = k
                    odd[count] = border[count] = unsure[count] = False
                    count += 1
        strips = max(count // POINTS_PER_CELL, 1)
        per_row = strips / max(top - bottom, 1e-9)
        turn, begins = rows_kernel(y, candidates[:count], bottom, per_row, strips)
        candidates[:count] = candidates[turn]
        for edge in edges:
            ax, ay, bx, by = start[edge, 0], start[edge, 1], end[edge, 0], end[edge, 1]
            low, high = min(ay, by), max(ay, by)
            farthest = max(ax, bx)
            since = begins[min(int((low - bottom) * per_row), strips - 1)]
            until = begins[min(int((high - bottom) * per_row), strips - 1) + 1]
            for k in range(since, until):
                px, py = x[candidates[k]], y[candidates[k]]
                if px > farthest or py < low or py > high:
                    continue
                if (px == bx and py == by) or (low == high and px >= min(ax, bx)):
                    border[k] = True
                elif low <= py < high:
                    one_way, other_way = (ax - px) * (by - py), (ay - py) * (bx - px)
                    cross = one_way - other_way
                    if abs(cross) < ROUNDING * (abs(one_way) + abs(other_way)):
                        unsure[k] = True
                    elif cross == 0.0:
                        border[k] = True
                    elif (cross > 0.0) == (by > ay):
                        odd[k] = not odd[k]
        for k in range(count):
            if odd[k] or border[k] or unsure[k]:
                if hits == room:
                    room *= 2
                    longer = np.empty((2, room), np.int64)
                    longer[0, :hits], longer[1, :hits] = point, polygon
                    point, polygon = longer[0], longer[1]
                    surer = np.empty(room, np.bool_)
                    surer[:hits] = sure
                    sure = surer
                point[hits], polygon[hits] = candidates[k], number
                sure[hits] = border[k] or not unsure[k]
                hits += 1
    turn, _ = members_kernel(point[:hits], len(x))
    return point[turn], polygon[turn], sure[turn]


@kernel
def rows_kernel(
    y: Values, which: Integers, south: float, per_m: float, rows: int
) -> tuple[Integers, Integers]:
    """The places (K,) in `which` of some of those at `y` (N,; m), row by row, so many to a metre, and where
    rows open."""
    row = np.empty(len(which), np.int64)
    for i in range(len(which)):
        row[i] = min(int((y[which[i]] - south) * per_m), rows - 1)
    order, opens = members_kernel(row, rows)
    return order, opens


def is_inside(x: float, y: float, start: Values, end: Values) -> bool:
    """True if a place is inside a polygon with edges from `start` to `end` (E, 2), or on its border, in exact
    arithmetic.
    """
    px, py = Fraction(float(x)), Fraction(float(y))
    odd = False
    for corner, following in zip(start.tolist(), end.tolist(), strict=True):
        ax, ay, bx, by = (Fraction(value) for value in (*corner, *following))
        cross = (ax - px) * (by - py) - (ay - py) * (bx - px)
        if cross == 0 and min(ax, bx) <= px <= max(ax, bx) and min(ay, by) <= py <= max(ay, by):
            return True
        if min(ay, by) <= py < max(ay, by) and (cross > 0) == (by > ay):
            odd = not odd
    return odd
