"""Into how many pieces the voids of a solid cut its interior (code 404).

Voids may touch the outer shell along edges. Closed surfaces part space into one piece more than there are
independent ones among them (Alexander's duality), and all pieces but the outside and the voids are interior.
Sheets of faces between the edges that more than two share close where their borders cancel: independent
closed surfaces are as many as there are sheets less the rank of the matrix of their borders.
"""

from __future__ import annotations

from collections import defaultdict

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.geometry.components import connected_groups_kernel
from eaves.validate.boundaries import Integers
from eaves.validate.exact import orient_kernel

NEAR = 1e-3
"""Grid (steps) on which faces are cut."""

STEP = 16 * NEAR
"""Corners of cut faces nearer than this (steps) are one."""

Cell = NDArray[np.float64]
"""(M, 3) ring of a piece of a face, counter-clockwise from outside."""

Place = tuple[int, int, int]


def count_interior_pieces(shells: list[Integers]) -> int:
    """Number of pieces of the interior of a solid whose shells (T, 3, 3) neither cross nor share area."""
    cells = _cut_faces(shells)
    points = {_key(point): point for cell in cells for point in cell}
    rings = [_with_points_on_sides(cell, points) for cell in cells]
    sides: dict[tuple[Place, Place], list[tuple[int, int]]] = defaultdict(list)
    for number, ring in enumerate(rings):
        for start, end in zip(ring, ring[1:] + ring[:1], strict=True):
            sides[min(start, end), max(start, end)].append((number, 1 if start < end else -1))
    links = [[number for number, _ in users] for users in sides.values() if len(users) == 2]
    one, two = np.array(links, np.int64).reshape(-1, 2).T.copy()
    sheet = connected_groups_kernel(one, two, len(cells))
    shared = [users for users in sides.values() if len(users) > 2]
    boundary = np.zeros((len(shared) + 1, int(sheet.max()) + 1))
    for row, users in zip(boundary, shared, strict=False):
        for number, way in users:
            row[sheet[number]] += way
    surfaces = boundary.shape[1] - int(np.linalg.matrix_rank(boundary))
    return surfaces - (len(shells) - 1)


def _cut_faces(shells: list[Integers]) -> list[Cell]:
    """The triangles of all shells, cut along the edges of other shells that lie in them."""
    cells: list[Cell] = []
    for number, shell in enumerate(shells):
        others = np.concatenate([other for k, other in enumerate(shells) if k != number])
        starts = others.reshape(-1, 3)
        ends = np.roll(others, -1, axis=1).reshape(-1, 3)
        for triangle in shell:
            low, high = triangle.min(axis=0), triangle.max(axis=0)
            near = (np.minimum(starts, ends) <= high).all(axis=1) & (np.maximum(starts, ends) >= low).all(
                axis=1
            )
            lines = [
                (p, q)
                for p, q in zip(starts[near], ends[near], strict=True)
                if orient_kernel(*triangle, p) == 0 and orient_kernel(*triangle, q) == 0
            ]
            cells += _cut_triangle(triangle.astype(np.float64), lines)
    return cells


def _cut_triangle(triangle: Cell, lines: list[tuple[Integers, Integers]]) -> list[Cell]:
    """The cells into which lines on its plane cut a triangle."""
    if not lines:
        return [triangle]
    origin, along = triangle[0], triangle[1] - triangle[0]
    along = along / np.linalg.norm(along)
    normal = np.cross(along, triangle[2] - origin)
    across = np.cross(normal / np.linalg.norm(normal), along)
    frame = np.stack([along, across])
    flat = shapely.Polygon((triangle - origin) @ frame.T)
    cuts = [shapely.LineString((np.stack(line) - origin) @ frame.T) for line in lines]
    drawn = shapely.union_all([flat.exterior, *cuts], grid_size=NEAR)
    pieces = shapely.get_parts(shapely.polygonize([drawn]))
    inside = [piece for piece in pieces if flat.buffer(NEAR).contains(piece.representative_point())]
    rings = [np.asarray(shapely.orient_polygons(piece).exterior.coords)[:-1] for piece in inside]
    return [origin + ring @ frame for ring in rings]


def _key(point: NDArray[np.float64]) -> Place:
    x, y, z = np.rint(point / STEP).astype(np.int64)
    return int(x), int(y), int(z)


def _with_points_on_sides(cell: Cell, points: dict[Place, NDArray[np.float64]]) -> list[Place]:
    """The ring of a cell with every known point that lies on one of its sides."""
    known = np.array(list(points.values()))
    ring: list[Place] = []
    for start, end in zip(cell, np.roll(cell, -1, axis=0), strict=True):
        side = end - start
        length = float(np.linalg.norm(side))
        share = (known - start) @ side / length**2
        off = np.linalg.norm(known - start - share[:, None] * side, axis=1)
        inner = np.flatnonzero(
            (off < 16 * NEAR) & (share * length > 16 * NEAR) & ((1 - share) * length > 16 * NEAR)
        )
        ring += [_key(start), *(_key(known[k]) for k in inner[np.argsort(share[inner])])]
    return ring
