"""Check that a solid is closed, oriented and planar: the last before a solid leaves the reconstructor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import shapely

from eaves.geometry.face_table import FaceTable
from eaves.geometry.inside import members_kernel
from eaves.geometry.planes import eigen_kernel
from eaves.geometry.rings import COORDINATE_STEP, PLANARITY
from eaves.kernels import kernel
from eaves.model import ROOF_SURFACE, WALL_SURFACE, Integers, Mask, Points, Solid

FLATTEST_SHARE = 0.9
"""Share of `PLANARITY` a face may use; the rest is for the rounding of written coordinates."""

CLOSEST = 2.0 * COORDINATE_STEP
"""Corners and edges nearer than this (m) could fall together when coordinates are written."""

MOST_CORNERS = 16
"""Corners of a sloped face all triples of which are looked at; larger faces are cut into triangles."""

LOWEST_WALL = 0.05
"""A roof is at least this high (m) above the base of the solid, everywhere."""

MOST_FOLD_DEG = 9.0
"""Angle (degrees) between triangles of one face; under half of val3dity's 20, as any two may be compared."""


def find_defect(solid: Solid) -> str:
    """The defects of a solid extruded from a plan, in a few words; empty when it is sound.

    Walls stand on one plan edge each and are planar by construction. What is checked is what rounding and
    merging of heights could break: edges used once each way, roof planes, rings that stay simple, faces
    with area.
    """
    if solid.ring_sizes.min() < 3:
        return "a ring of fewer than three vertices"
    table = FaceTable.of_solids([solid])
    if not used_once_kernel(solid.corners, solid.corners[table.following], len(solid.vertices)):
        return "an edge that is not used once each way"
    first = np.append(table.ring_start[table.outer], len(table.corners))
    may_bend = (solid.surfaces != WALL_SURFACE) & ~steady_faces_kernel(table.corners, first)
    flat = {number: on_own_plane(table.rings_of(number)) for number in np.flatnonzero(may_bend).tolist()}
    if any(np.abs(places[:, 2]).max() > FLATTEST_SHARE * PLANARITY for places in flat.values()):
        return "a roof face that is not planar"
    roof = (solid.surfaces == ROOF_SURFACE).repeat(solid.ring_counts).repeat(solid.ring_sizes)
    if table.corners[roof, 2].min() < table.corners[0, 2] + LOWEST_WALL:
        return "a roof that reaches the ground"
    roofs = {number: places for number, places in flat.items() if solid.surfaces[number] == ROOF_SURFACE}
    return plan_defect(table.take(solid.surfaces != WALL_SURFACE)) or fold_defect(table, roofs)


@kernel
def used_once_kernel(start: Integers, end: Integers, count: int) -> bool:
    """True if each edge between `count` vertices, from `start` to `end` (E,), is used once each way."""
    leaving, first = members_kernel(start, count)
    for edge in range(len(start)):
        alike, back = 0, 0
        for other in leaving[first[start[edge]] : first[start[edge] + 1]]:
            alike += end[other] == end[edge]
        for other in leaving[first[end[edge]] : first[end[edge] + 1]]:
            back += end[other] == start[edge]
        if alike != 1 or back != 1:
            return False
    return True


@kernel
def steady_faces_kernel(places: Points, first: Integers) -> Mask:
    """Mask (F,) of the faces, with corners `first[f]` to `first[f + 1]` of `places` (K, 3), that have three
    corners, or are level, or are planar and have only triples of corners that lean like the face, by less
    than half of `MOST_FOLD_DEG`.

    Such a face has no fold however it is cut into triangles.
    """
    sure = np.zeros(len(first) - 1, np.bool_)
    covariance, vectors, values = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
    least = np.cos(np.radians(0.5 * MOST_FOLD_DEG - 0.1))
    for face in range(len(sure)):
        ring = places[first[face] : first[face + 1]]
        count = len(ring)
        level = True
        for i in range(count):
            level &= ring[i, 2] == ring[0, 2]
        if level or count <= 3:
            sure[face] = True
            continue
        if count > MOST_CORNERS:
            continue
        mean = np.zeros(3)
        for i in range(count):
            mean += ring[i]
        centred = ring - mean / count
        covariance[:] = 0.0
        for i in range(count):
            for k in range(3):
                for m in range(3):
                    covariance[k, m] += centred[i, k] * centred[i, m]
        eigen_kernel(covariance, vectors, values)
        x, y, z = vectors[0, 0], vectors[1, 0], vectors[2, 0]
        good = True
        for i in range(count):
            away = centred[i, 0] * x + centred[i, 1] * y + centred[i, 2] * z
            good &= abs(away) < FLATTEST_SHARE * PLANARITY - 1e-6
        for i in range(count):
            for j in range(i + 1, count):
                if not good:
                    break
                u, v, w = ring[j] - ring[i]
                for third in range(j + 1, count):
                    a, b, c = ring[third] - ring[i]
                    nx, ny, nz = v * c - w * b, w * a - u * c, u * b - v * a
                    lean = (nx * x + ny * y + nz * z) / max(np.sqrt(nx * nx + ny * ny + nz * nz), 1e-12)
                    good &= (lean if nz * z > 0.0 else -lean) > least
        sure[face] = good
    return sure


def on_own_plane(rings: Sequence[Points]) -> Points:
    """The corners (V, 3) of a face's rings along, across and off its plane of least squares."""
    places = np.concatenate(rings)
    centred = places - places.mean(axis=0)
    return np.asarray(centred @ np.linalg.svd(centred, full_matrices=False)[2].T)


def plan_defect(plan: FaceTable) -> str:
    """The defects of the plan of the faces that are not walls: rings that cross, faces that overlap."""
    polygons = plan.polygons()
    if not shapely.is_valid(polygons).all():
        return "a face whose rings cross"
    if shapely.minimum_clearance(polygons).min() < CLOSEST:
        return "corners too close to each other"
    areas = shapely.area(polygons)
    if abs(areas[0] - areas[1:].sum()) > COORDINATE_STEP * shapely.length(polygons[0]):
        return "roof faces that do not cover the ground face"
    return ""


def fold_defect(table: FaceTable, flat: Mapping[int, Points]) -> str:
    """Defect where a triangle of a face leans away from the others, as thin ones do once heights are rounded.

    `flat` are the corners (V, 3) of sloped roof faces of more than three, by rising number, on their own
    planes: there are the triangles of Delaunay by which validators define folds.
    """
    if not flat:
        return ""
    steep = np.isin(np.arange(len(table)), list(flat))
    faces, places = table.take(steep), np.concatenate(list(flat.values()))
    polygons = faces.polygons_at(places[:, :2])
    if not shapely.is_valid(polygons).all():
        return "a face whose rings cross on its plane"
    triangle, owner = faces.cut(places[:, :2], polygons, np.arange(len(faces)))
    corners = places[triangle]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=1)
    normal *= (np.sign(normal[:, 2]) / np.maximum(size, 1e-12))[:, None]
    largest = np.lexsort((-size, owner))
    head = largest[np.searchsorted(owner[largest], np.arange(len(polygons)))]
    cosine = (normal * normal[head][owner]).sum(axis=1)
    if np.any(cosine < np.cos(np.radians(MOST_FOLD_DEG))):
        return "a roof face with a fold"
    return ""
