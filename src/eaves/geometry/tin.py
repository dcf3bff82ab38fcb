"""A triangulated irregular network: Delaunay, exact, and open to more points."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import inlined_kernel, kernel
from eaves.model import GRID_STEP, Bounds, Points, Values

Ids = NDArray[np.int32]
OUTSIDE = -1
"""The vertex at infinity: a triangle that has it stands for the outside of one hull edge."""

CURVE_BITS, CURVE_SIDE = 4, 16
"""Levels of the Hilbert curve that are looked up at once, and cells along a side of them."""
PLACE_BITS = 31
"""Bits of the numbers of points; with those of their position on the Hilbert curve they make 63."""
CLOSE_BITS = 30
"""Squared distances under 2 to this power of quanta (3.2 m) leave the in-circle determinant in 62 bits."""
NEAR_BITS = 39
"""Squared distances under 2 to this power of quanta (70 m) leave the in-circle determinant short."""


class Tin:
    """Delaunay triangulation of some of the points (N, 2 or 3) it was made with; others can be inserted
    later.

    Coordinates are taken as whole multiples of `GRID_STEP`, so every decision is exact and the result does
    not depend on rounding. Insertion follows a Hilbert curve and costs about half a microsecond a point.
    With no three points off one line there are no triangles: `locate` then returns -1 everywhere.

    Attributes
    ----------
    vertices
        (M, 3) the corners of each triangle, counter-clockwise; `OUTSIDE` among them marks a hull edge.
    neighbours
        (M, 3) the triangle across from each corner.
    waiting
        Numbers of the points inserted so far, while they all lie on one line.
    """

    def __init__(self, xy: Points, first: NDArray[np.int64] | None = None) -> None:
        self.xy = np.ascontiguousarray(xy, np.float64)
        bounds = Bounds.of(self.xy) if len(xy) else Bounds(0.0, 0.0, 0.0, 0.0)
        self.corner = np.array([bounds.west, bounds.south])
        self.whole = whole_kernel(self.xy, self.corner)
        capacity = 2 * len(xy) + 4
        self._vertices = np.empty((capacity, 3), np.int32)
        self._neighbours = np.empty((capacity, 3), np.int32)
        self._count = 0
        self.waiting = np.zeros(0, np.int64)
        self.insert(np.arange(len(xy)) if first is None else first)

    @property
    def vertices(self) -> Ids:
        """The three corners of each triangle."""
        return self._vertices[: self._count]

    @property
    def neighbours(self) -> Ids:
        """The three triangles beside each triangle."""
        return self._neighbours[: self._count]

    @property
    def triangles(self) -> Ids:
        """(K, 3) the corners of the finite triangles."""
        a, b, c = self.vertices.T
        real: Ids = self.vertices[(a >= 0) & (b >= 0) & (c >= 0)]
        return real

    def insert(self, numbers: NDArray[np.int64], hint: Ids | None = None) -> None:
        """Add points by their numbers; one that lies exactly on a vertex is passed over.

        `hint` (K,) are triangles near to where the points lie: from there a search begins.
        """
        near = np.zeros(0, np.int32) if hint is None or len(self.waiting) else hint
        numbers = np.concatenate([self.waiting, np.asarray(numbers, np.int64)])
        if len(numbers) == 0:
            return
        # sorting position and place in one number is stable, and ten times as fast as a stable argsort
        place = hilbert_kernel(self.whole.take(numbers, axis=0)) << PLACE_BITS | np.arange(len(numbers))
        order = np.sort(place) & ((1 << PLACE_BITS) - 1)
        numbers, near = numbers.take(order), near.take(order) if len(near) else near
        if self._count == 0:
            first = first_triangle_kernel(self.whole, numbers)
            if first[2] < 0:
                self.waiting = numbers
                return
            a, b, c = first
            self._vertices[:4] = [(a, b, c), (b, a, OUTSIDE), (c, b, OUTSIDE), (a, c, OUTSIDE)]
            self._neighbours[:4] = [(2, 3, 1), (3, 2, 0), (1, 3, 0), (2, 1, 0)]
            self._count = 4
            self.waiting = np.zeros(0, np.int64)
        self._count = insert_kernel(self.whole, numbers, near, self._vertices, self._neighbours, self._count)

    def locate(self, xy: Points, hint: Ids | None = None) -> Ids:
        """The triangle (N,) that holds each point; a hull triangle for points outside, -1 without triangles.

        `hint` (N,) is written to and read from: the triangle where the search for a point begins.
        """
        if self._count == 0:
            return np.full(len(xy), -1, np.int32)
        targets = whole_kernel(np.ascontiguousarray(xy), self.corner)
        start = np.full(len(xy), -1, np.int32) if hint is None else hint
        return np.asarray(locate_kernel(self.whole, targets, self.vertices, self.neighbours, start))

    def interpolate(self, heights: Values, xy: Points) -> Values:
        """Linear heights (N,) at points (N, 2 or 3), from `heights` of all points; NaN outside the hull."""
        triangle = self.locate(xy)
        if self._count == 0:
            return np.full(len(xy), np.nan)
        return np.asarray(
            linear_kernel(
                self.xy,
                np.asarray(heights, np.float64),
                self.vertices,
                triangle,
                np.ascontiguousarray(xy),
            )
        )


@kernel
def whole_kernel(xy: Points, corner: NDArray[np.float64]) -> NDArray[np.int64]:
    """Plan coordinates (N, 2) of points (N, 2 or 3) about the corner, in quanta."""
    steps = np.empty((len(xy), 2), np.int64)
    for i in range(len(xy)):
        for axis in range(2):
            steps[i, axis] = int(np.rint((xy[i, axis] - corner[axis]) / GRID_STEP))
    return steps


def hilbert_table() -> NDArray[np.int32]:
    """Position of 16 by 16 cells along a Hilbert curve, times 4, plus how the curve lies inside each cell.

    (4, 16, 16): for each of the four ways the curve can lie. Bit 0 of a way says that it is turned over, bit
    1 that x and y change places.
    """
    turn, x, y = np.indices((4, CURVE_SIDE, CURVE_SIDE))
    position = np.zeros_like(turn)
    for level in range(CURVE_BITS - 1, -1, -1):
        over, swapped = turn & 1, turn >> 1
        bit_x, bit_y = (x >> level & 1) ^ over, (y >> level & 1) ^ over
        right, up = np.where(swapped, bit_y, bit_x), np.where(swapped, bit_x, bit_y)
        position = position << 2 | (3 * right) ^ up
        turn = (over ^ (right & (1 - up))) | (swapped ^ (1 - up)) << 1
    return np.asarray(position << 2 | turn, np.int32)


HILBERT = hilbert_table()


@kernel
def hilbert_kernel(steps: NDArray[np.int64]) -> NDArray[np.int64]:
    """Position (N,) of whole coordinates (N, 2) along a Hilbert curve."""
    count = len(steps)
    key = np.empty(count, np.int64)
    if count == 0:
        return key
    low_x, low_y, top = steps[0, 0], steps[0, 1], 1
    for i in range(count):
        low_x, low_y = min(low_x, steps[i, 0]), min(low_y, steps[i, 1])
    for i in range(count):
        top = max(top, steps[i, 0] - low_x, steps[i, 1] - low_y)
    shift, levels = 0, 16
    while (top >> shift) >= (1 << levels):
        shift += 1
    for i in range(count):
        x, y, position, turn = (steps[i, 0] - low_x) >> shift, (steps[i, 1] - low_y) >> shift, 0, 0
        for level in range(levels - CURVE_BITS, -1, -CURVE_BITS):
            at = HILBERT[turn, (x >> level) & (CURVE_SIDE - 1), (y >> level) & (CURVE_SIDE - 1)]
            position, turn = position << 2 * CURVE_BITS | at >> 2, at & 3
        key[i] = position
    return key


@inlined_kernel
def orientation(steps: NDArray[np.int64], a: int, b: int, x: int, y: int) -> Any:
    """Positive when (x, y) lies left of the line from a to b; exact."""
    return (steps[b, 0] - steps[a, 0]) * (y - steps[a, 1]) - (steps[b, 1] - steps[a, 1]) * (x - steps[a, 0])


@inlined_kernel
def in_circle(steps: NDArray[np.int64], a: int, b: int, c: int, p: int) -> Any:
    """True if p lies strictly inside the circle through a, b, c (counter-clockwise); exact up to 50 km."""
    x, y = steps[p, 0], steps[p, 1]
    ax, ay = steps[a, 0] - x, steps[a, 1] - y
    bx, by = steps[b, 0] - x, steps[b, 1] - y
    cx, cy = steps[c, 0] - x, steps[c, 1] - y
    ma, mb, mc = bx * cy - cx * by, cx * ay - ax * cy, ax * by - bx * ay
    la, lb, lc = ax * ax + ay * ay, bx * bx + by * by, cx * cx + cy * cy
    largest = la | lb | lc
    if largest >> CLOSE_BITS == 0:
        return la * ma + lb * mb + lc * mc > 0
    if largest >> NEAR_BITS:
        return sum_is_positive(la, lb, lc, ma, mb, mc)
    # a factor under 2^39 in limbs of 20 bits: each product and sum is within 64
    mask = (1 << 20) - 1
    low = (la & mask) * ma + (lb & mask) * mb + (lc & mask) * mc
    high = (la >> 20) * ma + (lb >> 20) * mb + (lc >> 20) * mc + (low >> 20)
    return high > 0 or (high == 0 and (low & mask) > 0)


@kernel
def sum_is_positive(la: int, lb: int, lc: int, ma: int, mb: int, mc: int) -> bool:
    """True if la ma + lb mb + lc mc > 0, for factors under 2^61."""
    # in three limbs of 31 bits, each product and sum within 64 bits
    limb, mask = 31, (1 << 31) - 1
    high = (la >> limb) * (ma >> limb) + (lb >> limb) * (mb >> limb) + (lc >> limb) * (mc >> limb)
    low = 0
    middle = 0
    carry = 0
    for k in range(3):
        lift, minor = (la, ma) if k == 0 else ((lb, mb) if k == 1 else (lc, mc))
        l1, l0, m1, m0 = lift >> limb, lift & mask, minor >> limb, minor & mask
        product = l0 * m0
        low += product & mask
        middle += product >> limb
        first, second = l1 * m0, l0 * m1
        middle += (first & mask) + (second & mask)
        carry += (first >> limb) + (second >> limb)
    middle += low >> limb
    low &= mask
    carry += middle >> limb
    middle &= mask
    high += carry
    return high > 0 or (high == 0 and (middle > 0 or low > 0))


@kernel
def first_triangle_kernel(steps: NDArray[np.int64], numbers: NDArray[np.int64]) -> tuple[int, int, int]:
    """Three of the points off one line, counter-clockwise; the last is -1 when there are none."""
    a = numbers[0]
    b = -1
    for i in range(1, len(numbers)):
        p = numbers[i]
        if b < 0:
            if steps[p, 0] != steps[a, 0] or steps[p, 1] != steps[a, 1]:
                b = p
            continue
        turn = orientation(steps, a, b, steps[p, 0], steps[p, 1])
        if turn > 0:
            return a, b, p
        if turn < 0:
            return b, a, p
    return a, b, -1


@inlined_kernel
def walk(steps: NDArray[np.int64], vertices: Ids, neighbours: Ids, start: int, x: int, y: int) -> Any:
    """The triangle that holds (x, y), or the hull triangle whose edge it lies beyond; walks from `start`."""
    here = start
    for k in range(3):
        if vertices[here, k] == OUTSIDE:
            here = neighbours[here, k]
            break
    came = OUTSIDE
    while True:
        a, b, c = vertices[here, 0], vertices[here, 1], vertices[here, 2]
        if a == OUTSIDE or b == OUTSIDE or c == OUTSIDE:
            break
        ax, ay, bx, by = steps[a, 0] - x, steps[a, 1] - y, steps[b, 0] - x, steps[b, 1] - y
        cx, cy = steps[c, 0] - x, steps[c, 1] - y
        onward = OUTSIDE
        if bx * cy < by * cx and neighbours[here, 0] != came:
            onward = neighbours[here, 0]
        elif cx * ay < cy * ax and neighbours[here, 1] != came:
            onward = neighbours[here, 1]
        elif ax * by < ay * bx and neighbours[here, 2] != came:
            onward = neighbours[here, 2]
        if onward == OUTSIDE:
            break
        came, here = here, onward
    return here


@inlined_kernel
def conflicts(steps: NDArray[np.int64], vertices: Ids, triangle: int, p: int) -> Any:
    """True if inserting p destroys the triangle."""
    a, b, c = vertices[triangle, 0], vertices[triangle, 1], vertices[triangle, 2]
    if a != OUTSIDE and b != OUTSIDE and c != OUTSIDE:
        return in_circle(steps, a, b, c, p)
    if a == OUTSIDE:
        a, b = b, c
    elif b == OUTSIDE:
        a, b = c, a
    turn = orientation(steps, a, b, steps[p, 0], steps[p, 1])
    if turn != 0:
        return turn > 0
    along = (steps[p, 0] - steps[a, 0]) * (steps[b, 0] - steps[p, 0])
    along += (steps[p, 1] - steps[a, 1]) * (steps[b, 1] - steps[p, 1])
    return along > 0


@kernel
def insert_kernel(
    steps: NDArray[np.int64],
    numbers: NDArray[np.int64],
    near: Ids,
    vertices: Ids,
    neighbours: Ids,
    count: int,
) -> int:
    """Insert points one by one (Bowyer 1981, Watson 1981), in place; the new number of triangles.

    A search begins in the triangle `near` (K,), or where there are none in the last one made. The triangles
    that a point destroys form a tree about it: gone through edge by edge, counter-clockwise, it gives the rim
    in order.
    """
    # room for a cavity of all triangles, hardly ever touched: arrays that grew here would slow each access
    cavity = np.empty(len(vertices), np.int32)
    rim_from, rim_to = np.empty_like(cavity), np.empty_like(cavity)
    rim_outer, rim_side = np.empty_like(cavity), np.empty_like(cavity)
    ahead, edge = np.empty_like(cavity), np.empty_like(cavity)
    here = 0
    for i in range(len(numbers)):
        p = numbers[i]
        start = near[i] if len(near) else here
        here = walk(steps, vertices, neighbours, start, steps[p, 0], steps[p, 1])
        duplicate = False
        for k in range(3):
            v = vertices[here, k]
            if v != OUTSIDE and steps[v, 0] == steps[p, 0] and steps[v, 1] == steps[p, 1]:
                duplicate = True
            ahead[k], edge[k] = here, 2 - k
        if duplicate:
            continue
        cavity[0], size, rim, left = here, 1, 0, 3
        while left > 0:
            left -= 1
            inside = ahead[left]
            outer = neighbours[inside, edge[left]]
            side = 0 if neighbours[outer, 0] == inside else (1 if neighbours[outer, 1] == inside else 2)
            after = side + 1 if side < 2 else 0
            before = after + 1 if after < 2 else 0
            if conflicts(steps, vertices, outer, p):
                cavity[size] = outer
                size += 1
                ahead[left], edge[left] = outer, before
                ahead[left + 1], edge[left + 1] = outer, after
                left += 2
            else:
                rim_from[rim], rim_to[rim] = vertices[outer, before], vertices[outer, after]
                rim_outer[rim], rim_side[rim] = outer, side
                rim += 1
        # of a tree of triangles the rim has two edges more, and closes
        cavity[size], cavity[size + 1], cavity[rim], last = count, count + 1, here, count + 1
        for k in range(rim):
            slot = cavity[k]
            vertices[slot, 0], vertices[slot, 1], vertices[slot, 2] = rim_from[k], rim_to[k], p
            neighbours[slot, 0], neighbours[slot, 1], neighbours[slot, 2] = cavity[k + 1], last, rim_outer[k]
            neighbours[rim_outer[k], rim_side[k]] = slot
            last = slot
        count += 2
    return count


@kernel
def locate_kernel(
    steps: NDArray[np.int64], targets: NDArray[np.int64], vertices: Ids, neighbours: Ids, hint: Ids
) -> Ids:
    """The triangle of each target (N, 2); `hint` (N,) starts each search and receives its end."""
    last = 0
    for i in range(len(targets)):
        start = hint[i] if hint[i] >= 0 else last
        last = walk(steps, vertices, neighbours, start, targets[i, 0], targets[i, 1])
        hint[i] = last
    return hint


@kernel
def linear_kernel(xy: Points, heights: Values, vertices: Ids, triangle: Ids, targets: Points) -> Values:
    """Height (N,) of the facet at each target, NaN in hull triangles."""
    values = np.full(len(targets), np.nan)
    for i in range(len(targets)):
        a, b, c = vertices[triangle[i], 0], vertices[triangle[i], 1], vertices[triangle[i], 2]
        if a == OUTSIDE or b == OUTSIDE or c == OUTSIDE:
            continue
        ux, uy = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1]
        vx, vy = xy[c, 0] - xy[a, 0], xy[c, 1] - xy[a, 1]
        wx, wy = targets[i, 0] - xy[a, 0], targets[i, 1] - xy[a, 1]
        area = ux * vy - uy * vx
        if area == 0.0:  # three points whose turn is below the precision of a double
            values[i] = heights[a]
            continue
        s, t = (wx * vy - wy * vx) / area, (ux * wy - uy * wx) / area
        values[i] = heights[a] + s * (heights[b] - heights[a]) + t * (heights[c] - heights[a])
    return values


@kernel
def areas_and_radii(xy: Points, triangles: Ids) -> tuple[Values, Values]:
    """Area (T,), m², of triangles (T, 3) of points (N, 2 or 3) in plan, and radius (T,), m, of the circle
    around each; infinite without an area."""
    area, radius = np.empty(len(triangles)), np.full(len(triangles), np.inf)
    for t in range(len(triangles)):
        a, b, c = triangles[t]
        ux, uy = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1]
        vx, vy = xy[c, 0] - xy[b, 0], xy[c, 1] - xy[b, 1]
        wx, wy = xy[a, 0] - xy[c, 0], xy[a, 1] - xy[c, 1]
        area[t] = 0.5 * abs(ux * vy - uy * vx)
        if area[t] > 1e-12:
            sides = (ux * ux + uy * uy) * (vx * vx + vy * vy) * (wx * wx + wy * wy)
            radius[t] = np.sqrt(sides) / (4.0 * area[t])
    return area, radius
