"""Buildings as triangles: what OBJ, GLB and 3D Tiles are made of."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.geometry.rings import area_vector
from eaves.model import BuildingModel, Failure, Integers, Points, Solid, Values
from eaves.model.building import GROUND_SURFACE, OUTER_CEILING_SURFACE, ROOF_SURFACE, WALL_SURFACE

SURFACES = (GROUND_SURFACE, WALL_SURFACE, ROOF_SURFACE, OUTER_CEILING_SURFACE)
COLOURS = {
    GROUND_SURFACE: (0.45, 0.42, 0.38),
    WALL_SURFACE: (0.86, 0.83, 0.76),
    ROOF_SURFACE: (0.72, 0.30, 0.22),
    OUTER_CEILING_SURFACE: (0.62, 0.50, 0.38),
}
"""Linear RGB of the materials."""
AREA_SHARE = 1e-6
"""Triangles that miss more than this share of a face's area do not cover it."""


@dataclass(frozen=True, eq=False)
class BuildingMesh:
    """The triangles of one building, outward-oriented.

    `vertices` (V, 3) in metres about the footprint's origin, shared by the faces; `triangles` (T, 3) vertex
    numbers; `face` (T,) the face a triangle belongs to; `surface` (F,) the number in `SURFACES` and `normal`
    (F, 3) the unit normal of every face.
    """

    vertices: Points
    triangles: Integers
    face: Integers
    surface: Integers
    normal: Points

    def triangles_of(self, surface: int) -> Integers:
        """The triangles (T', 3) of one kind of surface."""
        chosen = self.surface[self.face] == surface
        return np.asarray(self.triangles[chosen])

    def flat_shaded(self, surface: int) -> tuple[Points, Points, Integers]:
        """Positions (K, 3), normals (K, 3) and triangles (T', 3) of one kind of surface, with a vertex for
        every face it belongs to, so that edges between faces stay sharp."""
        chosen = self.surface[self.face] == surface
        corners = np.column_stack([np.repeat(self.face[chosen], 3), self.triangles[chosen].ravel()])
        pairs, numbers = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
        return self.vertices[pairs[:, 1]], self.normal[pairs[:, 0]], numbers.reshape(-1, 3)


def mesh_of(result: BuildingModel | Failure) -> BuildingMesh | None:
    """The mesh of the finest level of a building; None for a failure and for a model without solids."""
    if not isinstance(result, BuildingModel) or not result.solids:
        return None
    return mesh_of_solids(result.solids[result.lod])


def mesh_of_solids(solids: Iterable[Solid]) -> BuildingMesh:
    """One mesh of several solids; faces without area have no triangles."""
    vertices: list[Points] = []
    triangles: list[tuple[int, int, int]] = []
    faces: list[int] = []
    surfaces: list[int] = []
    normals: list[Points] = []
    start = 0
    for solid in solids:
        for number, found in enumerate(triangulate_faces(solid)):
            triangles += [(a + start, b + start, c + start) for a, b, c in found]
            faces += [len(surfaces)] * len(found)
            face = solid.faces[number]
            surfaces.append(SURFACES.index(face.surface))
            normals.append(unit_normal(solid.vertices[list(face.rings[0])]))
        vertices.append(solid.vertices)
        start += len(solid.vertices)
    return BuildingMesh(
        vertices=np.concatenate(vertices) if vertices else np.zeros((0, 3)),
        triangles=np.array(triangles, np.int64).reshape(-1, 3),
        face=np.array(faces, np.int64),
        surface=np.array(surfaces, np.int64),
        normal=np.array(normals).reshape(-1, 3),
    )


def unit_normal(ring: Points) -> Points:
    """The unit normal (3,) of a ring (M, 3) by Newell's sum; up for a ring without area."""
    total = area_vector(ring)
    length = float(np.linalg.norm(total))
    return total / length if length > 0 else np.array([0.0, 0.0, 1.0])


def triangulate_faces(solid: Solid) -> list[list[tuple[int, int, int]]]:
    """The triangles of every face, by the solid's own vertices only: a closed solid gives a closed mesh."""
    result: list[list[tuple[int, int, int]]] = []
    polygons, numbers, vertex_at = [], [], []
    for number, face in enumerate(solid.faces):
        outer = face.rings[0]
        result.append([])
        if len(face.rings) == 1 and len(outer) == 3:
            result[-1].append((outer[0], outer[1], outer[2]))
            continue
        plane = plane_axes(unit_normal(solid.vertices[list(outer)]))
        flat = [(solid.vertices[list(ring)] - solid.vertices[outer[0]]) @ plane.T for ring in face.rings]
        if len(face.rings) == 1 and len(outer) == 4 and is_convex(flat[0]):
            a, b, c, d = outer
            result[-1] += [(a, b, c), (a, c, d)]
            continue
        polygons.append(shapely.Polygon(flat[0], flat[1:]))
        numbers.append(number)
        named = zip(np.concatenate(flat).tolist(), (v for ring in face.rings for v in ring), strict=True)
        vertex_at.append({tuple(xy): vertex for xy, vertex in named})
    for number, names, cover in zip(numbers, vertex_at, triangulate_solids(polygons), strict=True):
        if cover is None:
            outer = solid.faces[number].rings[0]
            result[number] = [(outer[0], outer[k], outer[k + 1]) for k in range(1, len(outer) - 1)]
            continue
        for ring in shapely.get_coordinates(orient(cover)).reshape(-1, 4, 2)[:, :3].tolist():
            a, b, c = (names[tuple(xy)] for xy in ring)
            result[number].append((a, b, c))
    return result


def triangulate_solids(polygons: Sequence[shapely.Polygon]) -> list[NDArray[np.object_] | None]:
    """The triangles of every polygon; None where they do not cover it, as for one that touches itself."""
    covers: list[NDArray[np.object_] | None] = []
    for polygon in polygons:
        try:
            cover = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
        except shapely.GEOSException:
            covers.append(None)
            continue
        missed = abs(float(shapely.area(cover).sum()) - polygon.area)
        covers.append(cover if len(cover) and missed <= AREA_SHARE * polygon.area else None)
    return covers


def orient(triangles: NDArray[np.object_]) -> NDArray[np.object_]:
    """The triangles counter-clockwise."""
    return np.asarray(shapely.orient_polygons(triangles), dtype=object)


def plane_axes(normal: Points) -> Points:
    """Two unit axes (2, 3) across a unit normal, so that a ring seen against the normal keeps its sense."""
    helper = np.eye(3)[int(np.argmin(np.abs(normal)))]
    first = np.cross(helper, normal)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(normal, first)])


def is_convex(ring: Values) -> bool:
    """True if a counter-clockwise ring (M, 2) turns left, clearly, at every corner."""
    steps = np.roll(ring, -1, axis=0) - ring
    following = np.roll(steps, -1, axis=0)
    turn = steps[:, 0] * following[:, 1] - steps[:, 1] * following[:, 0]
    return bool((turn > AREA_SHARE * np.abs(turn).max()).all())
