"""Solids: their shells, and solids beside solids (codes 401 to 405, 501 to 503, 601)."""

from __future__ import annotations

from collections import defaultdict
from itertools import combinations

import numpy as np
import shapely
from scipy.sparse.csgraph import connected_components

from eaves.geometry.components import connected_groups_kernel
from eaves.model import Integers, Mask, Values
from eaves.validate.exact import (
    CROSS,
    OPPOSITE_SIDE,
    SAME_SIDE,
    crossings_kernel,
    enclosed_kernel,
    orient_kernel,
)

FINER = 6
"""On a grid six times finer the middles of edges and of triangles are whole numbers too."""

Shell = Integers
"""The triangles (T, 3, 3) of a closed shell in whole steps about an origin common to all shells compared."""

Defect = tuple[int, str]
"""Code and detail."""


def signed_volume(shell: Shell) -> float:
    """Six times the volume inside, in cubic steps; negative when the shell faces inwards."""
    corner = (shell - shell.reshape(-1, 3).min(axis=0)).astype(np.float64)
    return float(np.einsum("ti,ti->", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])))


def solid_defects(shells: list[Shell]) -> list[Defect]:
    """Defects between the shells of one solid, the outer one first; each shell is valid by itself."""
    defects = [
        (405, f"shell {number} faces {'inwards' if number == 0 else 'outwards'}")
        for number, shell in enumerate(shells)
        if (signed_volume(shell) < 0) != (number > 0)
    ]
    if defects or len(shells) == 1:
        return defects
    for first, second in combinations(range(len(shells)), 2):
        if _same_shell(shells[first], shells[second]):
            defects.append((402, f"shells {first} and {second} are identical"))
            continue
        meets = crossings_kernel(shells[first], shells[second])
        inside = _places(shells[second], shells[first])
        if first == 0:
            if not meets and (inside < 0).all():
                defects.append((403, f"shell {second} lies outside the outer shell"))
            elif meets or (inside < 0).any():
                defects.append((401, f"shell {second} meets the outer shell"))
        elif meets or (inside > 0).any() or (_places(shells[first], shells[second]) > 0).any():
            defects.append((401, f"shells {first} and {second} meet"))
    if not defects and (pieces := count_interior_pieces(shells)) > 1:
        defects.append((404, f"the interior falls into {pieces} pieces"))
    return defects


def solids_overlap(first: list[Shell], second: list[Shell]) -> bool:
    """True if the interiors of two valid solids have a point in common; touching faces are no overlap.

    Interiors that meet have a piece of one boundary inside the other solid, or the same boundary. An edge
    that passes through a face, or faces that share area and face alike, show it; else the corners and the
    middles of edges and triangles are looked up in the other solid.
    """
    first_box, second_box = (_box(np.concatenate(solid)) for solid in (first, second))
    if (first_box[0] >= second_box[1]).any() or (second_box[0] >= first_box[1]).any():
        return False
    first_faces, second_faces = _near(first, second_box), _near(second, first_box)
    if crossings_kernel(first_faces, second_faces) & (CROSS | SAME_SIDE):
        return True
    for faces, container in ((first_faces, second), (second_faces, first)):
        samples = _samples(faces)
        within = enclosed_kernel(samples, container[0] * FINER) > 0
        for void in container[1:]:
            within &= enclosed_kernel(samples, void * FINER) < 0
        if within.any():
            return True
    return False


def _near(solid: list[Shell], box: tuple[Integers, Integers]) -> Shell:
    """The triangles of a solid whose boxes meet a box: no others have a part in it."""
    triangles: Shell = np.concatenate(solid)
    close: Mask = ((triangles.min(axis=1) <= box[1]) & (triangles.max(axis=1) >= box[0])).all(axis=1)
    return triangles[close]


def composite_defects(solids: list[list[Shell]]) -> list[Defect]:
    """Defects between the solids of a composite solid."""
    defects: list[Defect] = []
    touching = np.eye(len(solids), dtype=bool)
    for first, second in combinations(range(len(solids)), 2):
        if _same_shell(solids[first][0], solids[second][0]):
            defects.append((502, f"solids {first} and {second} are identical"))
        elif solids_overlap(solids[first], solids[second]):
            defects.append((501, f"solids {first} and {second} overlap"))
        elif crossings_kernel(solids[first][0], solids[second][0]) & OPPOSITE_SIDE:
            touching[first, second] = True
    count, _ = connected_components(touching, directed=False)
    if not defects and count > 1:
        defects.append((503, f"the solids form {count} separate pieces"))
    return defects


def _samples(shell: Shell) -> Values:
    """Corners, middles of edges and middles of triangles of a shell, on the finer grid."""
    middle = shell.sum(axis=1) * (FINER // 3)
    halves = (shell + np.roll(shell, -1, axis=1)).reshape(-1, 3) * (FINER // 2)
    return np.unique(np.concatenate([shell.reshape(-1, 3) * FINER, halves, middle]), axis=0).astype(
        np.float64
    )


def _places(shell: Shell, container: Shell) -> Integers:
    """Position of the samples of a shell: 1 inside the container, 0 on it, -1 outside."""
    positions: Integers = enclosed_kernel(_samples(shell), container * FINER)
    return positions


def _same_shell(first: Shell, second: Shell) -> bool:
    """True if two shells have the same corners and the same volume."""
    corners = [np.unique(shell.reshape(-1, 3), axis=0) for shell in (first, second)]
    return np.array_equal(corners[0], corners[1]) and abs(signed_volume(first)) == abs(signed_volume(second))


def _box(triangles: Shell) -> tuple[Integers, Integers]:
    corners = triangles.reshape(-1, 3)
    return corners.min(axis=0), corners.max(axis=0)


NEAR = 1e-3
"""Grid (steps) on which faces are cut."""

STEP = 16 * NEAR
"""Corners of cut faces nearer than this (steps) are one."""

Cell = Values
"""(M, 3) ring of a piece of a face, counter-clockwise from outside."""

Place = tuple[int, int, int]


def count_interior_pieces(shells: list[Integers]) -> int:
    """Number of pieces of the interior of a solid whose shells (T, 3, 3) neither cross nor share area.

    Voids may touch the outer shell along edges. Closed surfaces part space into one piece more than there are
    independent ones among them (Alexander's duality), and all pieces but the outside and the voids are
    interior. Sheets of faces between the edges that more than two share close where their borders cancel:
    independent closed surfaces are as many as there are sheets less the rank of the matrix of their borders.
    """
    cells = _cut_faces(shells)
    points = {_key(point): point for cell in cells for point in cell}
    rings = [_with_points_on_sides(cell, points) for cell in cells]
    sides: dict[tuple[Place, Place], list[tuple[int, int]]] = defaultdict(list)
    for number, ring in enumerate(rings):
        for start, end in zip(ring, ring[1:] + ring[:1], strict=True):
            sides[min(start, end), max(start, end)].append((number, 1 if start < end else -1))
    links = [[number for number, _ in users] for users in sides.values() if len(users) == 2]
    first, second = np.array(links, np.int64).reshape(-1, 2).T.copy()
    sheet = connected_groups_kernel(first, second, len(cells))
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
        rivals = np.concatenate([rival for k, rival in enumerate(shells) if k != number])
        starts = rivals.reshape(-1, 3)
        ends = np.roll(rivals, -1, axis=1).reshape(-1, 3)
        for triangle in shell:
            low, high = triangle.min(axis=0), triangle.max(axis=0)
            close = (np.minimum(starts, ends) <= high).all(axis=1) & (np.maximum(starts, ends) >= low).all(
                axis=1
            )
            lines = [
                (p, q)
                for p, q in zip(starts[close], ends[close], strict=True)
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


def _key(point: Values) -> Place:
    x, y, z = np.rint(point / STEP).astype(np.int64)
    return int(x), int(y), int(z)


def _with_points_on_sides(cell: Cell, points: dict[Place, Values]) -> list[Place]:
    """The ring of a cell with every known point that lies on one of its sides."""
    corners = np.array(list(points.values()))
    ring: list[Place] = []
    for start, end in zip(cell, np.roll(cell, -1, axis=0), strict=True):
        side = end - start
        length = float(np.linalg.norm(side))
        share = (corners - start) @ side / length**2
        off = np.linalg.norm(corners - start - share[:, None] * side, axis=1)
        inner = np.flatnonzero(
            (off < 16 * NEAR) & (share * length > 16 * NEAR) & ((1 - share) * length > 16 * NEAR)
        )
        ring += [_key(start), *(_key(corners[k]) for k in inner[np.argsort(share[inner])])]
    return ring
