"""Faces cut into triangles, and how far those are from lying on one plane (code 204)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.model import Values
from eaves.validate.boundaries import Boundaries, Integers
from eaves.validate.polygons import as_polygons


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
    backwards = _outward_sign(boundaries, flat)[face] * _twice_area(corner) < 0
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
    whole = length > 0
    normal, face = normal[whole] / length[whole, None], triangles.face[whole]
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


def _outward_sign(boundaries: Boundaries, flat: NDArray[np.float64]) -> Values:
    """+1 or -1 (F,): which way round the outer ring runs in `flat`."""
    following = flat[boundaries.next_point]
    twice = flat[:, 0] * following[:, 1] - flat[:, 1] * following[:, 0]
    if len(flat) == 0:
        return np.zeros(len(boundaries.faces) - 1)
    area = np.bincount(boundaries.ring_of_point, twice, minlength=len(boundaries.rings) - 1)
    return np.sign(area[np.minimum(boundaries.faces[:-1], len(area) - 1)])


def _twice_area(corner: NDArray[np.float64]) -> Values:
    """Twice the signed areas (T,) of triangles (T, 3, 2)."""
    u, v = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    return np.asarray(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
