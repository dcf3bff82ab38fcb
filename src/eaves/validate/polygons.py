"""Polygons: planar, and their rings placed as inside and outside must be (codes 104 and 201 to 208)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import chain, combinations

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from eaves.geometry.face_table import FaceTable
from eaves.geometry.inside import connected_groups_kernel
from eaves.geometry.rings import SNAP
from eaves.model import Integers, Mask, Values

LARGEST_EXTENT = 1 << 28
"""Extent (steps) up to which the exact predicates cannot overflow; 268 km at a millimetre."""

FINEST_STEP = 1e-5
"""Coordinates written finer than this (m) are rounded to it: a hundredth of the snap tolerance."""

Ring = list[int]
Face = list[Ring]
Shell = list[Face]


@dataclass(frozen=True, eq=False)
class Boundaries:
    """Shells of faces of rings of points.

    `points` (P,) are rows of `vertices` (V, 3), which are integers in units of `step` metres; vertices nearer
    than the snap tolerance have become one. `faces` are those of all shells, about the origin of the
    vertices; shell s has the faces `shells[s]:shells[s + 1]`.
    """

    vertices: Integers
    step: float
    points: Integers
    faces: FaceTable
    shells: Integers

    @property
    def shell_count(self) -> int:
        """Shells, also those without faces."""
        return len(self.shells) - 1

    @property
    def face_of_point(self) -> Integers:
        """The face (P,) of each point."""
        return self.faces.face_of_corner

    @cached_property
    def shell_of_face(self) -> Integers:
        """The shell (F,) of each face."""
        return np.repeat(np.arange(self.shell_count), np.diff(self.shells))

    @cached_property
    def local(self) -> Integers:
        """Coordinates (P, 3) of the points in steps from the lowest corner of their shell: small numbers."""
        xyz = self.vertices[self.points]
        shell = self.shell_of_face[self.face_of_point]
        corner = np.zeros((self.shell_count, 3), np.int64)
        filled, first = np.unique(shell, return_index=True)
        if len(filled):
            corner[filled] = np.minimum.reduceat(xyz, first, axis=0)
        return xyz - corner[shell]


def lay_flat(shells: list[Shell], vertices: Integers, step: float, snap: float = SNAP) -> Boundaries:
    """Boundaries of nested lists of vertex numbers, with vertices of a shell nearer than `snap` (m) merged.

    Vertices exactly `snap` apart are merged too: whether val3dity does so depends on rounding.
    """
    faces = list(chain.from_iterable(shells))
    rings = list(chain.from_iterable(faces))
    numbers = np.fromiter(chain.from_iterable(rings), np.int64)
    sizes, counts = (np.array([len(part) for part in parts], np.int64) for parts in (rings, faces))
    table = FaceTable(vertices[numbers].astype(np.float64), sizes, counts)
    shell_sizes = np.array([len(shell) for shell in shells], np.int64)
    owner = np.repeat(np.arange(len(shells)), shell_sizes)[table.face_of_corner]
    rows = np.column_stack([owner, vertices[numbers]])
    order = np.lexsort(rows.T[::-1])
    new = np.ones(len(rows), bool)
    new[1:] = (rows[order][1:] != rows[order][:-1]).any(axis=1)
    same = np.empty(len(rows), np.int64)
    same[order] = np.cumsum(new) - 1
    places = rows[order[new]]
    merged = _merge_near(places, snap / step)
    return Boundaries(places[:, 1:], step, merged[same], table, np.append(0, np.cumsum(shell_sizes)))


def to_grid(coordinates: Values, step: float) -> Integers:
    """Coordinates (N, 3) as whole numbers of steps."""
    return np.rint(coordinates / step).astype(np.int64)


def _merge_near(places: Integers, tolerance_steps: float) -> Integers:
    """For each place (N, 4: shell, x, y, z) the first of its shell that is one with it by the tolerance."""
    if tolerance_steps < 1.0 - 1e-9 or len(places) < 2:
        return np.arange(len(places))
    local = (places - places.min(axis=0)).astype(np.float64)
    local[:, 0] *= 2.0 * tolerance_steps  # shells are apart, and stay so
    pairs = cKDTree(local).query_pairs(tolerance_steps * (1 + 1e-9), output_type="ndarray")
    node, partner = np.ascontiguousarray(pairs.T, np.int64)
    group = connected_groups_kernel(node, partner, len(places))
    first = np.full(group.max() + 1, len(places))
    np.minimum.at(first, group, np.arange(len(places)))
    return np.asarray(first[group])


REASONS = (
    ("Self-intersection", 201),
    ("Interior is disconnected", 205),
    ("Hole lies outside shell", 206),
    ("Holes are nested", 207),
)
"""Reason of GEOS for a polygon whose rings are simple → code."""


FALL_TOGETHER = 1e-3
"""Points nearer than this (steps) on the plane of their face are at one place there."""


@dataclass(frozen=True, eq=False)
class FacePlanes:
    """The least-squares plane of each face.

    `centre`, `normal`, `across`, `along` (F, 3): a point of the plane and an orthonormal frame, in steps;
    `distance` (F,): largest distance (m) of a point of the face from it.
    """

    centre: NDArray[np.float64]
    normal: NDArray[np.float64]
    along: NDArray[np.float64]
    across: NDArray[np.float64]
    distance: Values


def fit_planes(boundaries: Boundaries) -> FacePlanes:
    """Least-squares planes of all faces, through the points of all their rings."""
    face, xyz = boundaries.face_of_point, boundaries.local.astype(np.float64)
    number = len(boundaries.faces)
    count = np.maximum(np.bincount(face, minlength=number), 1)
    centre = np.stack([np.bincount(face, xyz[:, k], number) / count for k in range(3)], axis=1)
    away = xyz - centre[face]
    spread = np.empty((number, 3, 3))
    for i in range(3):
        for j in range(3):
            spread[:, i, j] = np.bincount(face, away[:, i] * away[:, j], number)
    axes = np.linalg.eigh(spread)[1]
    normal, across, along = axes[:, :, 0], axes[:, :, 1], axes[:, :, 2]
    distance = np.zeros(number)
    np.maximum.at(distance, face, np.abs(np.einsum("pi,pi->p", away, normal[face])))
    return FacePlanes(centre, normal, along, across, distance * boundaries.step)


def on_planes(boundaries: Boundaries, planes: FacePlanes) -> NDArray[np.float64]:
    """The points (P, 2) in the plane of their face."""
    face = boundaries.face_of_point
    away = boundaries.local - planes.centre[face]
    axes = np.stack([planes.along[face], planes.across[face]], axis=1)
    return np.asarray(np.einsum("pki,pi->pk", axes, away))


def faces_with(boundaries: Boundaries, points: Mask) -> Mask:
    """The faces (F,) that have one of some points (P,)."""
    faces = np.zeros(len(boundaries.faces), bool)
    faces[boundaries.face_of_point[points]] = True
    return faces


def shadow_axes(planes: FacePlanes) -> Integers:
    """The two axes (F, 2) on which each face has its largest shadow; integers stay integers there."""
    pairs = np.array([[1, 2], [2, 0], [0, 1]])
    return np.asarray(pairs[np.argmax(np.abs(planes.normal), axis=1)])


def faces_with_rings_alike(faces: FaceTable, flat: NDArray[np.float64]) -> Mask:
    """Faces (F,) with an inner ring that runs the same way round as the outer one, their corners at places
    (P, 2): code 208."""
    areas, bad = faces.ring_areas_at(flat), np.zeros(len(faces), bool)
    first = faces.outer[faces.face_of_ring]
    bad[faces.face_of_ring[(first != np.arange(len(first))) & (areas[first] * areas > 0)]] = True
    return bad


def why_invalid(polygon: shapely.Polygon) -> tuple[int, str]:
    """Code and reason of a polygon that GEOS finds invalid."""
    for ring in (polygon.exterior, *polygon.interiors):
        if not shapely.is_valid(shapely.Polygon(ring)):
            return 104, "a ring crosses or touches itself, or is collapsed to a line"
    rings = [{tuple(point) for point in ring.coords} for ring in (polygon.exterior, *polygon.interiors)]
    if any(candidate == rival for candidate, rival in combinations(rings, 2)):
        return 202, "two rings are identical"
    reason = str(shapely.is_valid_reason(polygon))
    return next((code for text, code in REASONS if text in reason), 201), reason.split("[")[0]


FEWEST_POINTS = 3


def faces_with_short_rings(faces: FaceTable) -> Mask:
    """Faces (F,) with a ring of fewer than three points, or with no ring at all: code 101."""
    bad = np.asarray(faces.ring_counts == 0)
    bad[faces.face_of_ring[faces.ring_sizes < FEWEST_POINTS]] = True
    return bad


@dataclass(frozen=True, eq=False)
class Triangles:
    """Triangles of faces: `numbers` (T, 3) rows of the boundaries' vertices, counter-clockwise seen from the
    face's outside; `corners` (T, 3, 3) their integer coordinates from the lowest corner of their shell;
    `face` (T,), sorted.
    """

    numbers: Integers
    corners: Integers
    face: Integers

    def of_faces(self, first: int, last: int) -> Triangles:
        """The triangles of the faces first…last-1."""
        part = slice(*np.searchsorted(self.face, [first, last]))
        return Triangles(self.numbers[part], self.corners[part], self.face[part])


def triangulate(boundaries: Boundaries, flat: NDArray[np.float64], faces: Mask) -> Triangles:
    """Constrained Delaunay triangles of each of some valid faces (F,).

    `flat` (P, 2) are the points in two dimensions: on the plane of their face, where Delaunay triangles are
    the best shaped (what code 204 is defined on), or on two of the axes, where they are whole numbers, so
    that points on one line stay on it and no triangle lies across a third one (what shells need).
    """
    shapes = boundaries.faces.polygons_at(flat, faces)
    position, face = boundaries.faces.cut(flat, shapes, np.flatnonzero(faces))
    return Triangles(boundaries.points[position], boundaries.local[position], face)


def tangled_faces(boundaries: Boundaries, flat: NDArray[np.float64], faces: Mask) -> Integers:
    """Those of some faces (F,) that cross themselves in two dimensions so that no triangles fill them."""
    tangled = []
    shapes = boundaries.faces.polygons_at(flat, faces)
    for face, polygon in zip(np.flatnonzero(faces), shapes, strict=True):
        try:
            shapely.constrained_delaunay_triangles(polygon)
        except shapely.errors.GEOSException:
            tangled.append(face)
    return np.array(tangled, np.int64)


def normal_deviations(triangles: Triangles, face_count: int) -> Values:
    """Largest angle (F,), radians, between normals of a face's triangles; those without area do not count."""
    a, b, c = (triangles.corners[:, k].astype(np.float64) for k in range(3))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1)
    proper = length > 0
    normal, face = normal[proper] / length[proper, None], triangles.face[proper]
    size = np.bincount(face, minlength=face_count)
    start = np.concatenate([[0], np.cumsum(size)[:-1]])
    smallest = np.ones(face_count)
    for shift in range(
        1, int(size.max(initial=1))
    ):  # every pair once: each triangle with the one `shift` later
        later = np.arange(len(face)) + shift
        pair = np.flatnonzero(later < (start + size)[face])
        np.minimum.at(smallest, face[pair], np.einsum("ti,ti->t", normal[pair], normal[pair + shift]))
    return np.arccos(np.clip(smallest, -1.0, 1.0))
