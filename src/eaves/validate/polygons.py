"""Polygons: planar, and their rings placed as inside and outside must be (codes 104 and 201 to 208)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.model import Integers, Mask, Values
from eaves.validate.boundaries import Boundaries

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
    number = boundaries.face_count
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
    faces = np.zeros(boundaries.face_count, bool)
    faces[boundaries.face_of_point[points]] = True
    return faces


def shadow_axes(planes: FacePlanes) -> Integers:
    """The two axes (F, 2) on which each face has its largest shadow; integers stay integers there."""
    pairs = np.array([[1, 2], [2, 0], [0, 1]])
    return np.asarray(pairs[np.argmax(np.abs(planes.normal), axis=1)])


def ring_areas(boundaries: Boundaries, flat: NDArray[np.float64]) -> Values:
    """Twice the signed area (R,) of all rings, of points (P, 2) in the plane."""
    following = flat[boundaries.next_point]
    twice = flat[:, 0] * following[:, 1] - flat[:, 1] * following[:, 0]
    areas = np.bincount(boundaries.ring_of_point, twice, minlength=len(boundaries.rings) - 1)
    return np.asarray(areas, np.float64)


def faces_with_rings_alike(boundaries: Boundaries, areas: Values) -> Mask:
    """Faces (F,) with an inner ring that runs the same way round as the outer one: code 208."""
    bad = np.zeros(boundaries.face_count, bool)
    outer = areas[np.minimum(boundaries.faces[:-1], len(areas) - 1)][boundaries.face_of_ring]
    inner = np.arange(len(areas)) != boundaries.faces[:-1][boundaries.face_of_ring]
    bad[boundaries.face_of_ring[inner & (outer * areas > 0)]] = True
    return bad


def as_polygons(boundaries: Boundaries, flat: NDArray[np.float64], faces: Integers) -> NDArray[np.object_]:
    """Shapely polygons of some faces, of points (P, 2) in the plane; every ring has three points or more."""
    rings = _ranges(boundaries.faces[faces], boundaries.faces[faces + 1])
    points = _ranges(boundaries.rings[rings], boundaries.rings[rings + 1])
    sizes = boundaries.rings[rings + 1] - boundaries.rings[rings]
    ends = np.cumsum(sizes)
    closing = np.insert(points, ends, boundaries.rings[rings])
    ring_offsets = np.concatenate([[0], np.cumsum(sizes + 1)])
    face_offsets = np.concatenate([[0], np.cumsum(boundaries.faces[faces + 1] - boundaries.faces[faces])])
    polygons: NDArray[np.object_] = shapely.from_ragged_array(
        shapely.GeometryType.POLYGON, flat[closing], (ring_offsets, face_offsets)
    )
    return polygons


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


def _ranges(starts: Integers, stops: Integers) -> Integers:
    """The numbers start…stop-1 of all pairs, one after the other."""
    sizes = stops - starts
    skip = np.repeat(starts - np.concatenate([[0], np.cumsum(sizes)[:-1]]), sizes)
    return np.asarray(np.arange(sizes.sum()) + skip)


FEWEST_POINTS = 3


def faces_with_short_rings(boundaries: Boundaries) -> Mask:
    """Faces (F,) with a ring of fewer than three points, or with no ring at all: code 101."""
    bad = np.asarray(np.diff(boundaries.faces) == 0)
    short = np.diff(boundaries.rings) < FEWEST_POINTS
    bad[boundaries.face_of_ring[short]] = True
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


def triangulate(boundaries: Boundaries, flat: NDArray[np.float64], faces: Integers) -> Triangles:
    """Constrained Delaunay triangles of each of some valid faces.

    `flat` (P, 2) are the points in two dimensions: on the plane of their face, where Delaunay triangles are
    the best shaped (what code 204 is defined on), or on two of the axes, where they are whole numbers, so
    that points on one line stay on it and no triangle lies across a third one (what shells need).
    """
    cut = shapely.constrained_delaunay_triangles(as_polygons(boundaries, flat, faces))
    pieces, owner = shapely.get_parts(cut, return_index=True)
    corner = shapely.get_coordinates(pieces).reshape(-1, 4, 2)[:, :3]
    face = faces[owner]
    position = _find_points(boundaries, flat, corner, face)
    numbers = boundaries.points[position]
    corners = boundaries.local[position]
    outward = ring_areas(boundaries, flat)[boundaries.faces[face]]  # which way round the outer ring runs
    backwards = outward * _twice_area(corner) < 0
    numbers[backwards], corners[backwards] = numbers[backwards][:, ::-1], corners[backwards][:, ::-1]
    return Triangles(numbers, corners, face)


def tangled_faces(boundaries: Boundaries, flat: NDArray[np.float64], faces: Integers) -> Integers:
    """Those of some faces that cross themselves in these two dimensions so that no triangles fill them."""
    polygons = as_polygons(boundaries, flat, faces)
    tangled = []
    for face, polygon in zip(faces, polygons, strict=True):
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


def _find_points(
    boundaries: Boundaries, flat: NDArray[np.float64], corner: NDArray[np.float64], face: Integers
) -> Integers:
    """Positions (T, 3) in `points` of triangle corners (T, 3, 2) with coordinates copied from `flat`."""
    have = np.column_stack([boundaries.face_of_point, flat])
    want = np.column_stack([np.repeat(face, 3), corner.reshape(-1, 2)])
    rows = np.vstack([have, want]) + 0.0  # -0.0 becomes 0.0
    order = np.lexsort((np.arange(len(rows)), rows[:, 2], rows[:, 1], rows[:, 0]))
    new = np.r_[True, (rows[order][1:] != rows[order][:-1]).any(axis=1)]
    leader = np.empty(len(rows), np.int64)
    leader[order] = order[np.maximum.accumulate(np.where(new, np.arange(len(rows)), 0))]
    return leader[len(have) :].reshape(-1, 3)


def _twice_area(corner: NDArray[np.float64]) -> Values:
    """Twice the signed areas (T,) of triangles (T, 3, 2)."""
    u, v = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    return np.asarray(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
