"""Buildings as triangles: what OBJ, GLB and 3D Tiles are made of."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice

import numpy as np

from eaves.geometry.face_table import FaceTable
from eaves.model import (
    GROUND_SURFACE,
    OUTER_CEILING_SURFACE,
    ROOF_SURFACE,
    WALL_SURFACE,
    BuildingModel,
    Failure,
    Integers,
    Points,
    Solid,
)

SURFACES = (GROUND_SURFACE, WALL_SURFACE, ROOF_SURFACE, OUTER_CEILING_SURFACE)
COLOURS = {
    GROUND_SURFACE: (0.45, 0.42, 0.38),
    WALL_SURFACE: (0.86, 0.83, 0.76),
    ROOF_SURFACE: (0.72, 0.30, 0.22),
    OUTER_CEILING_SURFACE: (0.62, 0.50, 0.38),
}
"""Linear RGB of the materials."""
AT_ONCE = 100
"""Buildings whose faces are cut into triangles together: 5 MB."""


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

    def flat_shaded(self, part: Integers) -> tuple[Integers, Integers, Integers]:
        """The face (K,) and the vertex (K,) of vertices that each belong to one face, so that edges between
        faces stay sharp, and the triangles (T, 3) that they make, both in the order of the `part` (F,) that a
        face is of."""
        order = np.argsort(part[self.face], kind="stable")
        face, count = self.face[order], len(self.vertices)
        rank = part[face] * len(self.surface) + face
        pairs, numbers = np.unique(rank[:, None] * count + self.triangles[order], return_inverse=True)
        face, vertex = np.divmod(pairs % max(len(self.surface) * count, 1), max(count, 1))
        return face, vertex, numbers.reshape(-1, 3)

    @classmethod
    def join(cls, meshes: Sequence[BuildingMesh]) -> BuildingMesh:
        """One mesh of several about the same origin, in their order."""
        vertex = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)]).tolist()
        face = np.cumsum([0, *(len(mesh.surface) for mesh in meshes)]).tolist()
        return cls(
            np.concatenate([mesh.vertices for mesh in meshes]),
            np.concatenate([mesh.triangles + first for mesh, first in zip(meshes, vertex, strict=False)]),
            np.concatenate([mesh.face + first for mesh, first in zip(meshes, face, strict=False)]),
            np.concatenate([mesh.surface for mesh in meshes]),
            np.concatenate([mesh.normal for mesh in meshes]),
        )


def meshed_pieces(
    results: Iterable[BuildingModel | Failure],
) -> Iterator[tuple[list[BuildingModel | Failure], BuildingMesh, Integers, Integers]]:
    """Results, `AT_ONCE` at a time, with one mesh of the finest levels of all, and the first vertex and the
    first face in it of each result (K + 1,); a failure and a model without solids have none."""
    waiting = iter(results)
    while piece := list(islice(waiting, AT_ONCE)):
        finest = [
            one.solids[one.lod] if isinstance(one, BuildingModel) and one.solids else () for one in piece
        ]
        vertices = np.cumsum([0, *(sum(len(solid.vertices) for solid in solids) for solids in finest)])
        faces = np.cumsum([0, *(sum(len(solid.surfaces) for solid in solids) for solids in finest)])
        yield piece, mesh_of_solids(chain(*finest)), vertices, faces


def with_meshes(
    results: Iterable[BuildingModel | Failure],
) -> Iterator[tuple[BuildingModel | Failure, BuildingMesh | None]]:
    """Results, each with the mesh of its finest level; None for a failure and for a model without solids."""
    for piece, whole, vertices, faces in meshed_pieces(results):
        triangles = np.searchsorted(whole.face, faces)
        for number, result in enumerate(piece):
            of_vertex, of_face, of_triangle = (
                slice(*bounds[number : number + 2]) for bounds in (vertices, faces, triangles)
            )
            mesh = BuildingMesh(
                whole.vertices[of_vertex],
                whole.triangles[of_triangle] - vertices[number],
                whole.face[of_triangle] - faces[number],
                whole.surface[of_face],
                whole.normal[of_face],
            )
            yield result, mesh if len(mesh.vertices) else None


def with_solids(results: Iterable[BuildingModel | Failure]) -> Iterator[BuildingModel]:
    """The buildings among results that have solids."""
    return (one for one in results if isinstance(one, BuildingModel) and one.solids)


def mesh_of_solids(solids: Iterable[Solid]) -> BuildingMesh:
    """One mesh of several solids by their own vertices, so that closed solids give a closed mesh; faces
    without area have no triangles."""
    solids = tuple(solids)
    table = FaceTable.of_solids(solids)
    counts = np.array([len(solid.vertices) for solid in solids], np.int64)
    first = np.repeat(np.cumsum(counts) - counts, [len(solid.corners) for solid in solids])
    vertex = first + np.concatenate([np.zeros(0, np.int64), *(solid.corners for solid in solids)])
    surfaces = [surface for solid in solids for surface in solid.surfaces.tolist()]
    corner, face_of_triangle = table.triangles()
    return BuildingMesh(
        vertices=np.concatenate([np.zeros((0, 3)), *(solid.vertices for solid in solids)]),
        triangles=vertex[corner],
        face=face_of_triangle,
        surface=np.array(list(map(SURFACES.index, surfaces)), np.int64),
        normal=table.normals,
    )
