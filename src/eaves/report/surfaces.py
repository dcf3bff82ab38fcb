"""Faces of many models in a few arrays, as the page and the pictures draw them."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from eaves.formats import CityObject
from eaves.formats.models.meshes import SURFACES
from eaves.geometry.face_table import FaceTable
from eaves.model import LODS, NO_PLANE, Integers, Mask, Points

UNKNOWN_ERROR = 65535
"""RMSE (mm) of a face that no points are known of: the largest whole number of two bytes."""
PIECE_FACES = 4000
"""So many faces are cut into triangles at a time, which takes some 40 MB."""


@dataclass(frozen=True, eq=False)
class CityFace:
    """A face: its rings (M, 3), outer first, the building's number among those given, its level of detail and
    its kind as numbers in `LODS` and `SURFACES`, and the RMSE (mm) of its points, `UNKNOWN_ERROR` without.
    """

    rings: tuple[Points, ...]
    building: int
    lod: int
    kind: int
    error: int = UNKNOWN_ERROR


@dataclass(frozen=True, eq=False)
class CityFaces:
    """Many faces in a few arrays, a tenth of what they take as objects: a table of them, and of each
    `building`, `lod`, `kind` and `error` (F,) as in `CityFace`.
    """

    table: FaceTable
    building: Integers
    lod: Integers
    kind: Integers
    error: Integers

    @classmethod
    def of(cls, faces: Iterable[CityFace]) -> CityFaces:
        """The faces, taken one by one."""
        pile = _Pile()
        for face in faces:
            for ring in face.rings:
                pile.corners.frombytes(np.asarray(ring, np.float64).tobytes())
                pile.rings.append(len(ring))
            pile.counts.append(len(face.rings))
            pile.figures.extend((face.building, face.lod, face.kind, face.error))
        return pile.as_faces()

    def __len__(self) -> int:
        return len(self.building)

    def take(self, which: Mask) -> CityFaces:
        """The faces where the mask (F,) is true."""
        figures = (values[which] for values in (self.building, self.lod, self.kind, self.error))
        return CityFaces(self.table.take(which), *figures)


@dataclass(frozen=True, eq=False)
class _Pile:
    """Faces on the way into arrays: their corners, the sizes of their rings, how many rings each has, and its
    building, level of detail, kind and error."""

    corners: array[float] = field(default_factory=lambda: array("d"))
    rings: array[int] = field(default_factory=lambda: array("q"))
    counts: array[int] = field(default_factory=lambda: array("q"))
    figures: array[int] = field(default_factory=lambda: array("q"))

    def as_faces(self) -> CityFaces:
        """The faces gathered."""
        corners = np.array(self.corners, np.float64).reshape(-1, 3)
        figures = np.array(self.figures, np.int64).reshape(-1, 4).T.copy()
        return CityFaces(
            FaceTable(corners, np.array(self.rings, np.int64), np.array(self.counts, np.int64)), *figures
        )


def in_pieces(faces: CityFaces, size: int = PIECE_FACES) -> Iterator[CityFaces]:
    """The faces, so many at a time."""
    number = np.arange(len(faces))
    for first in range(0, len(faces), size):
        yield faces.take((number >= first) & (number < first + size))


def collect_city_faces(objects: Iterable[CityObject], numbers: dict[str, int]) -> CityFaces:
    """The faces of solids of the buildings whose ids `numbers` holds; a part's belong to its building."""
    pile = _Pile()
    for item in objects:
        building = numbers.get(item.parents[0] if item.parents else item.id)
        if building is None:
            continue
        for geometry in item.geometries:
            if geometry.lod not in LODS[1:]:
                continue
            errors = [whole_millimetres(about.get("rmse_m")) for about in geometry.surfaces]
            for shell in (shell for shells in geometry.solids for shell in shells):
                pile.corners.frombytes(item.vertices[shell.corners].tobytes())
                pile.rings.extend(shell.ring_sizes.tolist())
                pile.counts.extend(shell.ring_counts.tolist())
                for surface, plane in zip(shell.surfaces.tolist(), shell.planes.tolist(), strict=True):
                    kind = SURFACES.index(surface) if surface in SURFACES else 0
                    error = UNKNOWN_ERROR if plane == NO_PLANE else errors[plane]
                    pile.figures.extend((building, LODS.index(geometry.lod), kind, error))
    return pile.as_faces()


def whole_millimetres(error: float | None) -> int:
    """An RMSE (m) as `CityFace` has it."""
    return UNKNOWN_ERROR if error is None else min(round(1000.0 * error), UNKNOWN_ERROR - 1)
