"""Shells and solids: closed, two-manifold, one way round, apart (codes 301 to 307, 401 to 601)."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import shapely

from eaves.geometry.inside import connected_groups_kernel
from eaves.model import Integers, Mask, Values
from eaves.validate.exact import (
    CROSS,
    OPPOSITE_SIDE,
    SAME_SIDE,
    crossings_kernel,
    enclosed_kernel,
    orient_kernel,
    self_intersections_kernel,
)
from eaves.validate.polygons import Boundaries, Triangles

FEWEST_FACES = 4


@dataclass(frozen=True)
class ShellDefect:
    """The defects of shell number `shell`; `face` is the number of a face concerned, or -1."""

    code: int
    shell: int
    face: int
    detail: str


@dataclass(frozen=True, eq=False)
class Edges:
    """The edges of all shells: `shell` (E,), `ends` (E, 2) with the smaller number first, `forward` and
    `backward` (E,) uses in either direction, and for every side of a face (P,) its edge and whether it runs
    forward.
    """

    shell: Integers
    ends: Integers
    forward: Integers
    backward: Integers
    of_side: Integers
    runs_forward: Integers


def collect_edges(boundaries: Boundaries) -> Edges:
    """The edges of all shells, from the sides of their faces' rings."""
    start, end = boundaries.points, boundaries.points[boundaries.faces.following]
    count = len(boundaries.vertices)  # a vertex is of one shell, so its edges need no other number
    keys = np.minimum(start, end) * count + np.maximum(start, end)
    unique, first, of_side = np.unique(keys, return_index=True, return_inverse=True)
    shell = boundaries.shell_of_face[boundaries.face_of_point[first]]
    runs_forward = (start < end).astype(np.int64)
    forward = np.bincount(of_side, runs_forward, len(unique)).astype(np.int64)
    backward = np.bincount(of_side, 1 - runs_forward, len(unique)).astype(np.int64)
    ends = np.column_stack([unique // count, unique % count])
    return Edges(shell, ends, forward, backward, of_side, runs_forward)


def check_shells(
    boundaries: Boundaries, triangles: Triangles, shells: Integers, corner: Integers
) -> list[ShellDefect]:
    """Defects of the shells whose faces are all valid; `corner` (S, 3): their lowest corners, for messages.

    As in val3dity a later check is made only on shells that passed the earlier ones: number of faces, edges,
    closure and connection, vertices, and last the intersections of faces.
    """
    chosen = np.zeros(boundaries.shell_count, bool)
    chosen[shells] = True
    few = chosen & (np.diff(boundaries.shells) < FEWEST_FACES)
    defects = [
        ShellDefect(301, int(s), -1, f"{np.diff(boundaries.shells)[s]} polygons") for s in np.flatnonzero(few)
    ]
    chosen &= ~few
    edges = collect_edges(boundaries)
    for check in (_edge_defects, _gaps_and_pieces):
        faults = list(check(boundaries, edges, chosen))
        chosen[[defect.shell for defect in faults]] = False
        defects += faults
    part = chosen[boundaries.shell_of_face[triangles.face]]
    candidates = Triangles(triangles.numbers[part], triangles.corners[part], triangles.face[part])
    faults = list(_split_umbrellas(boundaries, candidates))
    chosen[[defect.shell for defect in faults]] = False
    part = chosen[boundaries.shell_of_face[candidates.face]]
    faults += _self_intersections(
        boundaries,
        Triangles(candidates.numbers[part], candidates.corners[part], candidates.face[part]),
        corner,
    )
    return defects + faults


def _edge_defects(boundaries: Boundaries, edges: Edges, chosen: np.ndarray) -> Iterator[ShellDefect]:
    """Edges with more than two faces (303) and faces turned the wrong way (307)."""
    crowded = chosen[edges.shell] & (edges.forward + edges.backward > 2)
    for edge in np.flatnonzero(crowded):
        face = int(boundaries.face_of_point[np.flatnonzero(edges.of_side == edge)[0]])
        uses = int(edges.forward[edge] + edges.backward[edge])
        place = _place(boundaries, edges.ends[edge, 0])
        yield ShellDefect(303, int(edges.shell[edge]), face, f"an edge at {place} has {uses} polygons")
    bad = np.unique(edges.shell[crowded])
    turned = chosen[edges.shell] & ~np.isin(edges.shell, bad) & (np.abs(edges.forward - edges.backward) == 2)
    for shell in np.unique(edges.shell[turned]):
        for face in _turned_faces(boundaries, edges, int(shell)):
            yield ShellDefect(307, int(shell), face, "the polygon faces the other way than its neighbours")


def _turned_faces(boundaries: Boundaries, edges: Edges, shell: int) -> list[int]:
    """The faces of a shell that disagree with most others: each has two sides, linked over the edges that
    it shares with those that look the same way."""
    first, last = boundaries.shells[shell], boundaries.shells[shell + 1]
    sides = np.flatnonzero(boundaries.shell_of_face[boundaries.face_of_point] == shell)
    sides = sides[np.argsort(edges.of_side[sides], kind="stable")]
    edge = edges.of_side[sides]
    pair = np.flatnonzero(edge[1:] == edge[:-1])
    earlier, later = (boundaries.face_of_point[sides[pair + k]] - first for k in (0, 1))
    alike = edges.runs_forward[sides[pair]] != edges.runs_forward[sides[pair + 1]]
    count = int(last - first)
    ahead, back = np.where(alike, later, later + count), np.where(alike, later + count, later)
    side = connected_groups_kernel(np.append(earlier, earlier + count), np.append(ahead, back), 2 * count)
    like, unlike = (np.bincount(side[:count], minlength=2 * count)[half] for half in side.reshape(2, -1))
    wrong = (like < unlike) | ((like == unlike) & (side[:count] > side[count:]))
    return [int(first + face) for face in np.flatnonzero(wrong)]


def _gaps_and_pieces(boundaries: Boundaries, edges: Edges, chosen: np.ndarray) -> Iterator[ShellDefect]:
    """Shells in several pieces (305), and edges with one face only (302)."""
    order = np.argsort(edges.of_side, kind="stable")
    same = np.flatnonzero(edges.of_side[order][1:] == edges.of_side[order][:-1])
    first, second = boundaries.face_of_point[order[same]], boundaries.face_of_point[order[same + 1]]
    count = len(boundaries.faces)
    piece = connected_groups_kernel(first, second, count)
    _, face_of_piece = np.unique(piece, return_index=True)
    number = np.bincount(boundaries.shell_of_face[face_of_piece], minlength=boundaries.shell_count)
    touching = _pieces_that_touch(boundaries, piece)
    apart = chosen & (number > 1) & ~touching
    for shell in np.flatnonzero(apart):
        yield ShellDefect(305, int(shell), -1, f"{number[shell]} separate pieces")
    gaps = np.flatnonzero((chosen & ~apart)[edges.shell] & (edges.forward + edges.backward == 1))
    open_shells = np.unique(edges.shell[gaps])
    for shell in open_shells:
        open_edges = gaps[edges.shell[gaps] == shell]
        place = _place(boundaries, edges.ends[open_edges[0], 0])
        yield ShellDefect(
            302, int(shell), -1, f"{len(open_edges)} edges with one polygon only, one at {place}"
        )
    for shell in np.setdiff1d(np.flatnonzero(chosen & (number > 1) & touching), open_shells):
        yield ShellDefect(303, int(shell), -1, f"{number[shell]} pieces that touch in a vertex")


def _pieces_that_touch(boundaries: Boundaries, piece: Integers) -> np.ndarray:
    """Shells (S,) of several pieces that have a vertex in common."""
    in_order = np.argsort(boundaries.points, kind="stable")
    vertex, of_face = boundaries.points[in_order], boundaries.face_of_point[in_order]
    parted = (vertex[1:] == vertex[:-1]) & (piece[of_face[1:]] != piece[of_face[:-1]])
    touching = np.zeros(boundaries.shell_count, bool)
    touching[boundaries.shell_of_face[of_face[1:][parted]]] = True
    return touching


def _split_umbrellas(boundaries: Boundaries, triangles: Triangles) -> Iterator[ShellDefect]:
    """Vertices whose triangles form several umbrellas (303): the shell touches itself in a point."""
    count = len(triangles.face)
    if count == 0:
        return
    here = triangles.numbers.reshape(-1)
    after, before = (triangles.numbers[:, turn].reshape(-1) for turn in ((1, 2, 0), (2, 0, 1)))
    keys = np.concatenate([here, here]) * len(boundaries.vertices) + np.concatenate([after, before])
    order = np.argsort(keys, kind="stable")
    same = np.flatnonzero(keys[order[1:]] == keys[order[:-1]])
    first, second = order[same] % (3 * count), order[same + 1] % (3 * count)
    umbrella = connected_groups_kernel(first, second, 3 * count)
    in_order = np.argsort(here, kind="stable")
    vertex, of = here[in_order], umbrella[in_order]
    parted = np.flatnonzero((vertex[1:] == vertex[:-1]) & (of[1:] != of[:-1]))
    split, place_of = np.unique(vertex[parted], return_index=True)
    for number, corner in zip(split, in_order[parted[place_of]], strict=True):
        owner, place = boundaries.shell_of_face[triangles.face[corner // 3]], _place(boundaries, number)
        yield ShellDefect(303, int(owner), -1, f"the shell touches itself in the vertex at {place}")


def _self_intersections(boundaries: Boundaries, triangles: Triangles, corner: Integers) -> list[ShellDefect]:
    """Faces of a shell that meet elsewhere than in shared edges and vertices (306)."""
    if len(triangles.face) == 0:
        return []
    shell = boundaries.shell_of_face[triangles.face]
    order = np.lexsort((triangles.corners[:, :, 0].min(axis=1), shell))
    pairs = np.unique(
        self_intersections_kernel(
            triangles.corners[order], triangles.numbers[order], triangles.face[order], shell[order]
        ),
        axis=0,
    )
    defects = []
    for face, rival in pairs:
        corners = triangles.of_faces(face, face + 1).corners.reshape(-1, 3)
        owner = int(boundaries.shell_of_face[face])
        place = _written((corners.mean(axis=0) + corner[owner]) * boundaries.step)
        detail = f"it meets polygon {rival - boundaries.shells[owner]}, near {place}"
        defects.append(ShellDefect(306, owner, int(face), detail))
    return defects


def _place(boundaries: Boundaries, vertex: int) -> str:
    return _written(boundaries.vertices[vertex] * boundaries.step)


def _written(place: np.ndarray) -> str:
    return "({:.3f}, {:.3f}, {:.3f})".format(*place)


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
    count = int(connected_groups_kernel(*np.nonzero(touching), len(touching)).max(initial=-1)) + 1
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
