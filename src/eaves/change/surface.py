"""Each roof point of one epoch against the points of the other: is its surface still there?

A roof point with the plane of its neighbours says where the other epoch's points must lie. In a cylinder
around it they lie on that plane (the same roof), all below (it was not there yet, or is gone), all above
(raised, or hidden by a crown), or there are none (not seen).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eaves.detect import Cells
from eaves.flow import FEWEST
from eaves.geometry import local_planes
from eaves.kernels import inlined_kernel, kernel
from eaves.model import BUILDING, GROUND, Integers, Mask, Points, Values

TRIM = 3.0
"""Robust standard deviations beyond which pairs are taken for changes."""

ROUNDS = 8
"""Rounds of trimming and fitting; they settle after three or four."""

SPREAD = 0.05
"""Where slopes scatter less (a town of flat roofs), the ridge holds dx and dy near 0."""


@dataclass(frozen=True)
class Shift:
    """The new epoch's place against the old one's (m), the pairs' robust spread (m), and their number."""

    east: float
    north: float
    up: float
    noise: float
    pairs: int

    @property
    def vector(self) -> NDArray[np.float64]:
        """East, north, up (3,)."""
        return np.array([self.east, self.north, self.up])


def robust_spread(values: Values) -> float:
    """1.4826 times the median distance from the median: the standard deviation of what has no outliers."""
    return float(1.4826 * np.median(np.abs(values - np.median(values)))) if len(values) else 0.0


def fit_shift(slope: NDArray[np.float64], distance: Values) -> Shift:
    """The shift of pairs with slopes (N, 2) and vertical distances (N,)."""
    known = np.isfinite(distance)
    slope, distance = slope[known], distance[known]
    if len(distance) < FEWEST:
        return Shift(0.0, 0.0, 0.0, 0.0, len(distance))
    steepness = np.sqrt(1.0 + (slope**2).sum(axis=1))
    columns = np.column_stack([-slope, np.ones(len(slope))])
    place, ridge = np.array([0.0, 0.0, np.median(distance)]), np.diag([SPREAD**2, SPREAD**2, 0.0])
    for _ in range(ROUNDS):
        left = (distance - columns @ place) / steepness
        kept = np.abs(left) <= TRIM * max(robust_spread(left), 0.01)
        some = columns[kept]
        place = np.linalg.solve(some.T @ some + len(some) * ridge, some.T @ distance[kept])
    east, north, up = map(float, place)
    return Shift(east, north, up, robust_spread(left[kept]), int(kept.sum()))


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


@inlined_kernel
def rows_near(
    y: float, radius: float, corner: tuple[float, float], shape: tuple[int, int]
) -> tuple[int, int]:
    """First row of cells within a radius (m) of a height on the map, and the first behind them."""
    north = max(int(np.floor((corner[1] - y - radius - ROUNDING) / radius)), 0)
    return north, min(int(np.floor((corner[1] - y + radius + ROUNDING) / radius)) + 1, shape[0])


@inlined_kernel
def run_near(
    x: float,
    row: int,
    radius: float,
    corner: tuple[float, float],
    shape: tuple[int, int],
    first: Integers,
) -> tuple[int, int]:
    """The run, in the order of cells, of the points in a row of cells within a radius (m) of a place."""
    west = min(max(int(np.floor((x - radius - ROUNDING - corner[0]) / radius)), 0), shape[1])
    east = max(min(int(np.floor((x + radius + ROUNDING - corner[0]) / radius)) + 1, shape[1]), west)
    return first[row * shape[1] + west], first[row * shape[1] + east]


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
    others, classes = others.take(cells.order, axis=0), classes.take(cells.order)
    near = xyz, slope, others, cells.start, (cells.west, cells.north), cells.shape, radius
    limit = tolerance * np.sqrt(1.0 + (slope**2).sum(axis=1))
    numbers, heights, ground_way = tally_kernel(*near, classes, limit)
    seen, standing, built, below, ground = numbers
    top, roof_below, ground_top, roof_above = heights
    same = (built > 0) | ((standing > 0) & (standing >= STANDING * (standing + below)))
    under = np.isfinite(top) & (roof_below == top) & (-top <= roof_above)
    roof = np.where(under, top, roof_above)
    # the other roof must lie around the point: what lies to one side of it is seen past it
    level, level_way, rise = level_kernel(*near, roof, 4 * limit)
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
    xyz: Points,
    slope: Values,
    others: Points,
    first: Integers,
    corner: tuple[float, float],
    shape: tuple[int, int],
    radius: float,
    classes: NDArray[np.uint8],
    limit: Values,
) -> tuple[Integers, Values, Values]:
    """The points of another epoch around each of some roof points.

    Parameters
    ----------
    xyz, slope : ndarray (N, 3), (N, 2)
        Roof points, and the slopes of their planes.
    others, classes : ndarray (M, 3), (M,)
        Points of the other epoch in the order of cells as wide as `radius`, and their classes.
    first, corner, shape
        Starts, north-western corner, and rows and columns of those cells, as `Cells` has them.
    radius : float
        Largest distance (m) in plan.
    limit : ndarray (N,)
        Distance (m) from the plane, upright, up to which a point is on it.

    Returns
    -------
    numbers : ndarray (5, N)
        Of the points within the radius, of those on the plane, of these on a roof, of those below, of these
        on the ground.
    heights : ndarray (4, N)
        Over the plane, of the highest below, of roofs and of the ground there; of the lowest roof above.
    ground_way : ndarray (2, N)
        Sum of the ways to the ground below.
    """
    numbers, ground_way = np.zeros((5, len(xyz)), np.int64), np.zeros((2, len(xyz)))
    heights = np.full((4, len(xyz)), -np.inf)
    heights[3] = np.inf
    for roof in range(len(xyz)):
        x, y, z = xyz[roof, 0], xyz[roof, 1], xyz[roof, 2]
        north, south = rows_near(y, radius, corner, shape)
        for row in range(north, south):
            start, end = run_near(x, row, radius, corner, shape, first)
            for other in range(start, end):
                dx, dy, kind = others[other, 0] - x, others[other, 1] - y, classes[other]
                if dx * dx + dy * dy > radius * radius:
                    continue
                height = others[other, 2] - z - (slope[roof, 0] * dx + slope[roof, 1] * dy)
                numbers[0, roof] += 1
                if abs(height) <= limit[roof]:
                    numbers[1, roof] += 1
                    numbers[2, roof] += kind == BUILDING
                elif height < 0.0:
                    numbers[3, roof] += 1
                    heights[0, roof] = max(heights[0, roof], height)
                    if kind == BUILDING:
                        heights[1, roof] = max(heights[1, roof], height)
                    elif kind == GROUND:
                        numbers[4, roof] += 1
                        heights[2, roof] = max(heights[2, roof], height)
                        ground_way[0, roof] += dx
                        ground_way[1, roof] += dy
                elif kind == BUILDING:
                    heights[3, roof] = min(heights[3, roof], height)
    return numbers, heights, ground_way


@kernel
def level_kernel(
    xyz: Points,
    slope: Values,
    others: Points,
    first: Integers,
    corner: tuple[float, float],
    shape: tuple[int, int],
    radius: float,
    level: Values,
    most: Values,
) -> tuple[Integers, Values, Values]:
    """Number (N,) of the points around each roof point within `most` (N,) of a `level` (N,) over its plane,
    the sums of the ways (2, N) to them and of their heights (N,); the other arguments are those of
    `tally_kernel`."""
    number, ways, heights = np.zeros(len(xyz), np.int64), np.zeros((2, len(xyz))), np.zeros(len(xyz))
    for roof in range(len(xyz)):
        x, y, z = xyz[roof, 0], xyz[roof, 1], xyz[roof, 2]
        north, south = rows_near(y, radius, corner, shape)
        for row in range(north, south if np.isfinite(level[roof]) else north):
            start, end = run_near(x, row, radius, corner, shape, first)
            for other in range(start, end):
                dx, dy = others[other, 0] - x, others[other, 1] - y
                height = others[other, 2] - z - (slope[roof, 0] * dx + slope[roof, 1] * dy)
                if dx * dx + dy * dy <= radius * radius and abs(height - level[roof]) <= most[roof]:
                    number[roof] += 1
                    ways[0, roof] += dx
                    ways[1, roof] += dy
                    heights[roof] += height
    return number, ways, heights


def nearest_distances(
    xyz: Points, slope: NDArray[np.float64], others: Points, radius: float, most: float
) -> Values:
    """Distance (N,) of the other epoch's surface over roof points: of the nearest in plan of those no
    farther than `most` (m) from the plane; NaN where there is none."""
    cells = Cells.of(others, radius, 0)
    others, corner = others.take(cells.order, axis=0), (cells.west, cells.north)
    return np.asarray(
        nearest_surface_kernel(xyz, slope, others, cells.start, corner, cells.shape, radius, most)
    )


@kernel
def nearest_surface_kernel(
    xyz: Points,
    slope: Values,
    others: Points,
    first: Integers,
    corner: tuple[float, float],
    shape: tuple[int, int],
    radius: float,
    most: float,
) -> Values:
    """See `nearest_distances`; the arguments are those of `tally_kernel`. Of equals it is the last."""
    distance, least = np.full(len(xyz), np.nan), np.full(len(xyz), radius * radius)
    for roof in range(len(xyz)):
        x, y, z = xyz[roof, 0], xyz[roof, 1], xyz[roof, 2]
        north, south = rows_near(y, radius, corner, shape)
        for row in range(north, south):
            start, end = run_near(x, row, radius, corner, shape, first)
            for other in range(start, end):
                dx, dy = others[other, 0] - x, others[other, 1] - y
                over = others[other, 2] - z - (slope[roof, 0] * dx + slope[roof, 1] * dy)
                if abs(over) <= most and dx * dx + dy * dy <= least[roof]:
                    distance[roof], least[roof] = over, dx * dx + dy * dy
    return distance
