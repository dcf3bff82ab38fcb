"""Exact predicates on integer coordinates: sides of a plane, crossings of triangles.

Coordinates are whole numbers below 2^29, so every sign is exact: first in floating point where that is safe,
else with the minors split in two halves of 30 bits.
"""

from __future__ import annotations

import numpy as np

from eaves.kernels import inlined_kernel, kernel
from eaves.model import Integers, Points

Place = Integers
"""Three coordinates, (3,); three of them are a triangle, (3, 3)."""
Vector = tuple[float, float, float]

HALF = 30
MASK = (1 << HALF) - 1


@kernel
def orient_kernel(a: Place, b: Place, c: Place, d: Place) -> int:
    """Sign of the volume of the tetrahedron a, b, c, d: +1 if d lies above counter-clockwise abc."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    wx, wy, wz = d[0] - a[0], d[1] - a[1], d[2] - a[2]
    mx, my, mz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    px, py, pz = float(wx) * float(mx), float(wy) * float(my), float(wz) * float(mz)
    value = px + py + pz
    if abs(value) > 1e-14 * (abs(px) + abs(py) + abs(pz)):
        return 1 if value > 0 else -1
    high = wx * (mx >> HALF) + wy * (my >> HALF) + wz * (mz >> HALF)
    low = wx * (mx & MASK) + wy * (my & MASK) + wz * (mz & MASK)
    total = high + (low >> HALF)
    if total != 0:
        return 1 if total > 0 else -1
    return 1 if (low & MASK) != 0 else 0


@kernel
def turn_kernel(a: Place, b: Place, c: Place, i: int, j: int) -> int:
    """Sign of the area of a, b, c on the axes i and j: +1 for a left turn."""
    value = (b[i] - a[i]) * (c[j] - a[j]) - (b[j] - a[j]) * (c[i] - a[i])
    return 1 if value > 0 else (-1 if value < 0 else 0)


@kernel
def plane_axes_kernel(a: Place, b: Place, c: Place) -> tuple[int, int]:
    """Two axes on which the triangle a, b, c has its largest shadow."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    mx, my, mz = abs(uy * vz - uz * vy), abs(uz * vx - ux * vz), abs(ux * vy - uy * vx)
    if mz >= mx and mz >= my:
        return 0, 1
    if mx >= my:
        return 1, 2
    return 2, 0


@kernel
def segments_meet_kernel(p: Place, q: Place, a: Place, b: Place, i: int, j: int) -> bool:
    """True if the closed segments p q and a b, on one plane, have a point in common."""
    t1, t2 = turn_kernel(p, q, a, i, j), turn_kernel(p, q, b, i, j)
    t3, t4 = turn_kernel(a, b, p, i, j), turn_kernel(a, b, q, i, j)
    if t1 == 0 and t2 == 0:
        return (
            max(p[i], q[i]) >= min(a[i], b[i])
            and max(a[i], b[i]) >= min(p[i], q[i])
            and max(p[j], q[j]) >= min(a[j], b[j])
            and max(a[j], b[j]) >= min(p[j], q[j])
        )
    return t1 * t2 <= 0 and t3 * t4 <= 0


@kernel
def in_triangle_kernel(p: Place, a: Place, b: Place, c: Place, i: int, j: int) -> bool:
    """True if p, on the plane of the triangle a, b, c, lies in it or on its rim."""
    t1, t2, t3 = turn_kernel(a, b, p, i, j), turn_kernel(b, c, p, i, j), turn_kernel(c, a, p, i, j)
    return (t1 >= 0 and t2 >= 0 and t3 >= 0) or (t1 <= 0 and t2 <= 0 and t3 <= 0)


@kernel
def segment_meets_triangle_kernel(p: Place, q: Place, a: Place, b: Place, c: Place) -> bool:
    """True if the closed segment p q and the closed triangle a, b, c have a point in common."""
    side_p, side_q = orient_kernel(a, b, c, p), orient_kernel(a, b, c, q)
    if side_p * side_q > 0:
        return False
    if side_p == 0 and side_q == 0:
        i, j = plane_axes_kernel(a, b, c)
        return (
            in_triangle_kernel(p, a, b, c, i, j)
            or segments_meet_kernel(p, q, a, b, i, j)
            or segments_meet_kernel(p, q, b, c, i, j)
            or segments_meet_kernel(p, q, c, a, i, j)
        )
    s1, s2, s3 = orient_kernel(p, q, a, b), orient_kernel(p, q, b, c), orient_kernel(p, q, c, a)
    return (s1 >= 0 and s2 >= 0 and s3 >= 0) or (s1 <= 0 and s2 <= 0 and s3 <= 0)


@kernel
def one_side_kernel(t: Integers, u: Integers) -> bool:
    """True if all corners of triangle u lie strictly on one side of the plane of triangle t."""
    first = orient_kernel(t[0], t[1], t[2], u[0])
    return (
        first != 0
        and orient_kernel(t[0], t[1], t[2], u[1]) == first
        and orient_kernel(t[0], t[1], t[2], u[2]) == first
    )


@kernel
def triangles_meet_kernel(t: Integers, u: Integers, nt: Integers, nu: Integers) -> bool:
    """True if triangles t and u (3, 3) meet but in the corners and edges their numbers nt, nu share."""
    shared, own_t, own_u = 0, -1, -1
    for k in range(3):
        if nt[k] == nu[0] or nt[k] == nu[1] or nt[k] == nu[2]:
            shared += 1
        else:
            own_t = k
        if nu[k] != nt[0] and nu[k] != nt[1] and nu[k] != nt[2]:
            own_u = k
    if shared == 3:
        return True
    if shared == 2:
        a, b, c, d = t[(own_t + 1) % 3], t[(own_t + 2) % 3], t[own_t], u[own_u]
        if orient_kernel(a, b, c, d) != 0:
            return False
        i, j = plane_axes_kernel(a, b, c)
        return turn_kernel(a, b, c, i, j) == turn_kernel(a, b, d, i, j)
    if one_side_kernel(t, u) or one_side_kernel(u, t):
        return False
    if shared == 1:
        at_t, at_u = 0, 0
        for k in range(3):
            if nt[k] == nu[0] or nt[k] == nu[1] or nt[k] == nu[2]:
                at_t = k
            if nu[k] == nt[0] or nu[k] == nt[1] or nu[k] == nt[2]:
                at_u = k
        return segment_meets_triangle_kernel(
            t[(at_t + 1) % 3], t[(at_t + 2) % 3], u[0], u[1], u[2]
        ) or segment_meets_triangle_kernel(u[(at_u + 1) % 3], u[(at_u + 2) % 3], t[0], t[1], t[2])
    for k in range(3):
        if segment_meets_triangle_kernel(t[k], t[(k + 1) % 3], u[0], u[1], u[2]):
            return True
        if segment_meets_triangle_kernel(u[k], u[(k + 1) % 3], t[0], t[1], t[2]):
            return True
    return False


@kernel
def self_intersections_kernel(
    corners: Integers, numbers: Integers, face: Integers, shell: Integers
) -> Integers:
    """Pairs (K, 2) of faces of one shell that meet elsewhere than in shared corners and edges.

    `corners` (T, 3, 3) and `numbers` (T, 3) are the triangles' coordinates and vertex numbers, sorted by
    `shell` (T,) and within it by their lowest x; triangles of one `face` (T,) are not compared. Each pair is
    found once per pair of triangles.
    """
    count = len(face)
    low, high = np.empty((count, 3), np.int64), np.empty((count, 3), np.int64)
    for t in range(count):
        for k in range(3):
            low[t, k] = min(corners[t, 0, k], corners[t, 1, k], corners[t, 2, k])
            high[t, k] = max(corners[t, 0, k], corners[t, 1, k], corners[t, 2, k])
    pairs, hits = np.empty((16, 2), np.int64), 0
    for t in range(count):
        for u in range(t + 1, count):
            if shell[u] != shell[t] or low[u, 0] > high[t, 0]:
                break
            if face[t] == face[u] or low[u, 1] > high[t, 1] or low[t, 1] > high[u, 1]:
                continue
            if low[u, 2] > high[t, 2] or low[t, 2] > high[u, 2]:
                continue
            if triangles_meet_kernel(corners[t], corners[u], numbers[t], numbers[u]):
                if hits == len(pairs):
                    more = np.empty((2 * hits, 2), np.int64)
                    more[:hits] = pairs
                    pairs = more
                pairs[hits, 0], pairs[hits, 1] = min(face[t], face[u]), max(face[t], face[u])
                hits += 1
    return pairs[:hits]


CROSS, SAME_SIDE, OPPOSITE_SIDE = 1, 2, 4
"""Codes for triangles of two shells that meet: they cross; share area facing alike, or facing each other."""


@kernel
def pierces_kernel(p: Place, q: Place, t: Integers) -> bool:
    """True if the open segment p q passes through the open triangle t."""
    side_p, side_q = orient_kernel(t[0], t[1], t[2], p), orient_kernel(t[0], t[1], t[2], q)
    if side_p * side_q >= 0:
        return False
    first = orient_kernel(p, q, t[0], t[1])
    return (
        first != 0 and orient_kernel(p, q, t[1], t[2]) == first and orient_kernel(p, q, t[2], t[0]) == first
    )


@kernel
def share_area_kernel(t: Integers, u: Integers, i: int, j: int) -> bool:
    """True if two triangles on one plane overlap in an area: no edge of either separates them."""
    turn_t, turn_u = turn_kernel(t[0], t[1], t[2], i, j), turn_kernel(u[0], u[1], u[2], i, j)
    for k in range(3):
        apart_t, apart_u = True, True
        for m in range(3):
            if turn_kernel(t[k], t[(k + 1) % 3], u[m], i, j) * turn_t > 0:
                apart_t = False
            if turn_kernel(u[k], u[(k + 1) % 3], t[m], i, j) * turn_u > 0:
                apart_u = False
        if apart_t or apart_u:
            return False
    return turn_t != 0 and turn_u != 0


@kernel
def crossings_kernel(first: Integers, second: Integers) -> int:
    """Sum of the codes above that occur where two sets of triangles (N, 3, 3) and (M, 3, 3) meet."""
    result = 0
    for n in range(len(first)):
        t = first[n]
        for m in range(len(second)):
            u = second[m]
            apart = False
            for k in range(3):
                if min(t[0, k], t[1, k], t[2, k]) > max(u[0, k], u[1, k], u[2, k]):
                    apart = True
                if min(u[0, k], u[1, k], u[2, k]) > max(t[0, k], t[1, k], t[2, k]):
                    apart = True
            if apart or one_side_kernel(t, u) or one_side_kernel(u, t):
                continue
            if (
                orient_kernel(t[0], t[1], t[2], u[0]) == 0
                and orient_kernel(t[0], t[1], t[2], u[1]) == 0
                and orient_kernel(t[0], t[1], t[2], u[2]) == 0
            ):
                i, j = plane_axes_kernel(t[0], t[1], t[2])
                if share_area_kernel(t, u, i, j):
                    alike = turn_kernel(t[0], t[1], t[2], i, j) == turn_kernel(u[0], u[1], u[2], i, j)
                    result |= SAME_SIDE if alike else OPPOSITE_SIDE
                continue
            for k in range(3):
                if pierces_kernel(t[k], t[(k + 1) % 3], u) or pierces_kernel(u[k], u[(k + 1) % 3], t):
                    result |= CROSS
    return result


@inlined_kernel
def between(p: Place, q: Place) -> Vector:
    """The vector from one place to another."""
    return float(q[0] - p[0]), float(q[1] - p[1]), float(q[2] - p[2])


@inlined_kernel
def dot(u: Vector, v: Vector) -> float:
    """The product of two vectors."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@inlined_kernel
def cross(u: Vector, v: Vector) -> Vector:
    """The vector upright on two."""
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


MARGIN = 0.01
"""A place this near (steps) to a shell lies on it."""


@kernel
def enclosed_kernel(samples: Points, triangles: Integers) -> Integers:
    """For samples (N, 3) in a shell of triangles (T, 3, 3): 1 inside, 0 on the shell, -1 outside.

    The solid angle under which the shell is seen [vanoosterom1983] is ±4π inside and 0 outside; near the
    shell the distance to the triangles decides.
    """
    result, angle = np.empty(len(samples), np.int64), np.zeros(len(samples))
    for t in triangles:
        ab, bc, ca = between(t[0], t[1]), between(t[1], t[2]), between(t[2], t[0])
        normal = cross(ab, bc)
        reach = MARGIN * np.sqrt(dot(normal, normal))
        left_ab, left_bc, left_ca = cross(normal, ab), cross(normal, bc), cross(normal, ca)
        size_ab, size_bc, size_ca = np.sqrt(dot(ab, ab)), np.sqrt(dot(bc, bc)), np.sqrt(dot(ca, ca))
        for n, place in enumerate(samples):
            a, b, c = between(place, t[0]), between(place, t[1]), between(place, t[2])
            volume = dot(a, normal)
            if (
                abs(volume) <= reach
                and dot(a, left_ab) <= reach * size_ab
                and dot(b, left_bc) <= reach * size_bc
                and dot(c, left_ca) <= reach * size_ca
            ):
                angle[n] = np.nan
            la, lb, lc = np.sqrt(dot(a, a)), np.sqrt(dot(b, b)), np.sqrt(dot(c, c))
            below = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb
            angle[n] += 2.0 * np.arctan2(volume, below)
    for n, solid_angle in enumerate(angle):
        result[n] = 0 if np.isnan(solid_angle) else (1 if abs(solid_angle) > 2.0 * np.pi else -1)
    return result
