"""Shells: closed, two-manifold, in one piece, facing one way, not cutting themselves (codes 301 to 307)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from eaves.geometry.components import connected_groups_kernel
from eaves.model import Integers
from eaves.validate.boundaries import Boundaries
from eaves.validate.exact import self_intersections_kernel
from eaves.validate.polygons import Triangles

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
    shell = boundaries.shell_of_face[boundaries.face_of_point]
    keys = np.stack([shell, np.minimum(start, end), np.maximum(start, end)], axis=1)
    unique, of_side = np.unique(keys, axis=0, return_inverse=True)
    of_side, runs_forward = of_side.reshape(-1), (start < end).astype(np.int64)
    forward = np.bincount(of_side, runs_forward, len(unique)).astype(np.int64)
    backward = np.bincount(of_side, 1 - runs_forward, len(unique)).astype(np.int64)
    return Edges(unique[:, 0], unique[:, 1:], forward, backward, of_side, runs_forward)


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
    pieces = np.unique(np.stack([boundaries.shell_of_face, piece], axis=1), axis=0)
    number = np.bincount(pieces[:, 0], minlength=boundaries.shell_count)
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
    rows = np.stack([boundaries.shell_of_face[boundaries.face_of_point], boundaries.points], axis=1)
    with_piece = np.unique(np.column_stack([rows, piece[boundaries.face_of_point]]), axis=0)
    again = (with_piece[1:, :2] == with_piece[:-1, :2]).all(axis=1)
    touching = np.zeros(boundaries.shell_count, bool)
    touching[with_piece[1:][again, 0]] = True
    return touching


def _split_umbrellas(boundaries: Boundaries, triangles: Triangles) -> Iterator[ShellDefect]:
    """Vertices whose triangles form several umbrellas (303): the shell touches itself in a point."""
    count = len(triangles.face)
    if count == 0:
        return
    shell = np.repeat(boundaries.shell_of_face[triangles.face], 3)
    here = triangles.numbers.reshape(-1)
    after, before = (np.roll(triangles.numbers, shift, axis=1).reshape(-1) for shift in (-1, 1))
    leaving = np.stack([shell, here, after], axis=1)
    arriving = np.stack([shell, here, before], axis=1)
    keys = np.vstack([leaving, arriving])
    order = np.lexsort(keys.T[::-1])
    same = np.flatnonzero((keys[order][1:] == keys[order][:-1]).all(axis=1))
    first, second = order[same] % (3 * count), order[same + 1] % (3 * count)
    umbrella = connected_groups_kernel(first, second, 3 * count)
    rows = np.unique(np.stack([shell, here, umbrella], axis=1), axis=0)
    again = np.flatnonzero((rows[1:, :2] == rows[:-1, :2]).all(axis=1))
    for owner, vertex in np.unique(rows[again, :2], axis=0):
        place = _place(boundaries, vertex)
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
