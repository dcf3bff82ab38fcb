"""Each roof point of one epoch against the points of the other: is its surface still there?

A roof point with the plane of its neighbours says where the other epoch's points must lie. In a cylinder
around it they lie on that plane (the same roof), all below (it was not there yet, or is gone), all above
(raised, or hidden by a crown), or there are none (not seen).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.detect.toolkit.cells import Cells
from eaves.geometry.planes import local_planes
from eaves.kernels import kernel
from eaves.model import BUILDING, GROUND, Integers, Mask, Points, Values

UNSEEN, SAME, GROUND_BELOW, ROOF_BELOW, ROOF_ABOVE, OTHER_BELOW, HIDDEN = range(7)
"""State of a roof point in the other epoch: nothing; the same surface; the ground, another roof or
something else under it; a roof above it; only what is no roof above it."""

LEAST_NEIGHBOURS = 5
"""Fewer points decide nothing."""
NEIGHBOURS = 16
"""Number of nearest points that define a point's plane."""
STEEPEST = 2.5
"""Tangent of the steepest roof (68°)."""
BESIDE = 0.4
"""Points whose middle is farther from a place than this share of their radius lie beside it: those of half a
disc are, on the mean, by 0.42."""
STANDING = 0.2
"""Points of no roof make a surface where they are at least this share of those on and under it: at a corner
of a roof a quarter lies on it, and of a crown single leaves lie at the height of any roof."""
AT_ONCE = 20_000
"""Roof points that are faced together: with each go all points around it."""

ROUNDING = 1e-6
"""Width (m) by which cells are looked up beyond a radius: more than a sum of coordinates is rounded by."""


def point_planes(xyz: Points) -> tuple[NDArray[np.float64], Values]:
    """Slopes (N, 2) of the planes around points (N, 3), and how rough they are there (m, one standard
    deviation); level and NaN where there is none that could be a roof."""
    if len(xyz) < NEIGHBOURS:
        return np.zeros((len(xyz), 2)), np.full(len(xyz), np.nan)
    around = local_planes(xyz, NEIGHBOURS, NEIGHBOURS)
    slope = -around.normals[:, :2] / np.maximum(around.normals[:, 2:], 1e-3)
    rough = np.sqrt(around.eigenvalues[:, 0] * NEIGHBOURS / (NEIGHBOURS - 3))
    steep = np.hypot(*slope.T) > STEEPEST
    return np.where(steep[:, None], 0.0, slope), np.where(steep, np.nan, rough)


@kernel
def pairs_kernel(
    xyz: Points,
    others: Points,
    radius: float,
    corner: tuple[float, float],
    shape: tuple[int, int],
    order: Integers,
    first: Integers,
) -> tuple[Integers, Integers]:
    """The numbers (P,) of points (N, 3) and (P,) of others within a `radius` (m) of them in plan, the points
    in order; cells of the others, as wide: their north-western corner, rows and columns, order and starts, as
    `Cells` has them."""
    reach = radius + ROUNDING
    point, other = np.empty(len(xyz), np.int64), np.empty(len(xyz), np.int64)
    count = 0
    for number in range(len(xyz)):
        x, y = xyz[number, 0], xyz[number, 1]
        west = min(max(int(np.floor((x - reach - corner[0]) / radius)), 0), shape[1])
        east = max(min(int(np.floor((x + reach - corner[0]) / radius)) + 1, shape[1]), west)
        north = max(int(np.floor((corner[1] - y - reach) / radius)), 0)
        south = min(int(np.floor((corner[1] - y + reach) / radius)) + 1, shape[0])
        for row in range(north, south):
            start, end = first[row * shape[1] + west], first[row * shape[1] + east]
            while count + end - start > len(point):
                point, other = np.append(point, point), np.append(other, other)
            for place in range(start, end):
                dx, dy = others[order[place], 0] - x, others[order[place], 1] - y
                if dx * dx + dy * dy <= radius * radius:
                    point[count], other[count] = number, order[place]
                    count += 1
    return point[:count], other[:count]


def pairs_within(
    xyz: Points, slope: NDArray[np.float64], others: Points, radius: float, cells: Cells
) -> tuple[Integers, Integers, Values, Values]:
    """Pairs (P,) of roof points (N, 3) on planes with slopes (N, 2) and points of the other epoch within a
    `radius` (m) in plan: the numbers of both, the ways from the one to the other (P, 2) and how far the other
    lies over the plane (m); the `cells` are those of the others."""
    corner = cells.west, cells.north
    point, other = pairs_kernel(xyz, others, radius, corner, cells.shape, cells.order, cells.start)
    return point, other, *ways_kernel(xyz, slope, others, point, other)


@kernel
def ways_kernel(
    xyz: Points, slope: Values, others: Points, point: Integers, other: Integers
) -> tuple[Values, Values]:
    """The ways (P, 2) of pairs, and how far (P,) the others lie over the planes."""
    way, over = np.empty((len(point), 2)), np.empty(len(point))
    for pair in range(len(point)):
        one, two = point[pair], other[pair]
        dx, dy = others[two, 0] - xyz[one, 0], others[two, 1] - xyz[one, 1]
        way[pair, 0], way[pair, 1] = dx, dy
        over[pair] = others[two, 2] - xyz[one, 2] - (slope[one, 0] * dx + slope[one, 1] * dy)
    return way, over


def face_points(
    xyz: Points,
    slope: NDArray[np.float64],
    others: Points,
    classes: NDArray[np.uint8],
    radius: float,
    tolerance: float,
) -> tuple[NDArray[np.uint8], Values]:
    """The state (N,) that points of another epoch (M, 3) with classes show within `radius` (m) of roof points
    (N, 3), and how far what they show lies over these (m)."""
    state, distance = np.full(len(xyz), UNSEEN, np.uint8), np.full(len(xyz), np.nan)
    if not len(others):
        return state, distance
    cells = Cells.of(others, radius, 0)
    for first in range(0, len(xyz), AT_ONCE):
        some = slice(first, first + AT_ONCE)
        point, other, way, over = pairs_within(xyz[some], slope[some], others, radius, cells)
        limit = tolerance * np.sqrt(1.0 + (slope[some] ** 2).sum(axis=1))
        state[some], distance[some] = states_of((point, way, over), classes[other], radius, limit)
    return state, distance


def states_of(
    places: tuple[Integers, Values, Values], kind: NDArray[np.uint8], radius: float, limit: Values
) -> tuple[NDArray[np.uint8], Values]:
    """States and distances (N,) of roof points, from the point, way and height of each of their pairs, and
    the classes (P,) of the others; what lies within a `limit` (N,) of the plane is on it."""
    numbers, heights, ground_way = tally_kernel(*places, kind, limit)
    seen, standing, built, below, ground = numbers
    top, roof_below, ground_top, roof_above = heights
    same = (built > 0) | ((standing > 0) & (standing >= STANDING * (standing + below)))
    under = np.isfinite(top) & (roof_below == top) & (-top <= roof_above)
    roof = np.where(under, top, roof_above)
    # the other roof must lie around the point: what lies to one side of it is seen past it
    level, level_way, rise = level_kernel(*places, roof, 4 * limit)
    roofed, grounded, nothing = np.isfinite(roof), ground > 0, np.full(len(limit), np.nan)
    cases = (
        (seen == 0, UNSEEN, nothing),
        (same, SAME, np.zeros(len(limit))),
        (
            roofed & ~is_beside(level, level_way, radius),
            np.where(under, ROOF_BELOW, ROOF_ABOVE),
            rise / np.maximum(level, 1),
        ),
        (grounded & ~is_beside(ground, ground_way, radius), GROUND_BELOW, ground_top),
        (roofed, HIDDEN, nothing),
        (grounded, UNSEEN, ground_top),
        (np.isfinite(top), OTHER_BELOW, top),
    )
    which, states, distances = zip(*cases, strict=True)
    return np.select(which, states, HIDDEN).astype(np.uint8), np.select(which, distances, np.nan)


def is_beside(number: Integers, way: Values, radius: float) -> Mask:
    """Mask (N,) of the roof points to one side of which the `number` (N,) of points lies that the ways (2, N)
    lead to in sum."""
    return np.asarray(np.hypot(*(way / np.maximum(number, 1))) > BESIDE * radius)


@kernel
def tally_kernel(
    point: Integers, way: Values, over: Values, kind: NDArray[np.uint8], limit: Values
) -> tuple[Integers, Values, Values]:
    """Of each roof point the numbers (5, N) of its pairs, of those on its plane, of these on a roof, of those
    below, of these on the ground; the heights (4, N) of the highest below, of roofs and of the ground there,
    and of the lowest roof above; the sum (2, N) of the ways to the ground below."""
    numbers, ground_way = np.zeros((5, len(limit)), np.int64), np.zeros((2, len(limit)))
    heights = np.full((4, len(limit)), -np.inf)
    heights[3] = np.inf
    for pair in range(len(point)):
        roof, height = point[pair], over[pair]
        numbers[0, roof] += 1
        if abs(height) <= limit[roof]:
            numbers[1, roof] += 1
            numbers[2, roof] += kind[pair] == BUILDING
        elif height < 0.0:
            numbers[3, roof] += 1
            heights[0, roof] = max(heights[0, roof], height)
            if kind[pair] == BUILDING:
                heights[1, roof] = max(heights[1, roof], height)
            elif kind[pair] == GROUND:
                numbers[4, roof] += 1
                heights[2, roof] = max(heights[2, roof], height)
                ground_way[0, roof] += way[pair, 0]
                ground_way[1, roof] += way[pair, 1]
        elif kind[pair] == BUILDING:
            heights[3, roof] = min(heights[3, roof], height)
    return numbers, heights, ground_way


@kernel
def level_kernel(
    point: Integers, way: Values, over: Values, height: Values, most: Values
) -> tuple[Integers, Values, Values]:
    """Of each roof point the number (N,) of its pairs within `most` (N,) of a `height` (N,) over its plane,
    and the sums of the ways (2, N) to them and of their heights (N,)."""
    number, ways, heights = np.zeros(len(most), np.int64), np.zeros((2, len(most))), np.zeros(len(most))
    for pair in range(len(point)):
        roof = point[pair]
        if abs(over[pair] - height[roof]) <= most[roof]:
            number[roof] += 1
            ways[0, roof] += way[pair, 0]
            ways[1, roof] += way[pair, 1]
            heights[roof] += over[pair]
    return number, ways, heights


def nearest_distances(
    xyz: Points, slope: NDArray[np.float64], others: Points, radius: float, most: float
) -> Values:
    """Distance (N,) of the other epoch's surface over roof points: of the nearest in plan of those no
    farther than `most` (m) from the plane; NaN where there is none."""
    distance = np.full(len(xyz), np.nan)
    point, _, way, over = pairs_within(xyz, slope, others, radius, Cells.of(others, radius, 0))
    on = np.flatnonzero(np.abs(over) <= most)
    point, over, square = point[on], over[on], (way[on] ** 2).sum(axis=1)
    least = np.full(len(xyz), np.inf)
    np.minimum.at(least, point, square)
    nearest = np.flatnonzero(square == least[point])
    distance[point[nearest]] = over[nearest]
    return distance
