"""Models cut into triangles and edges, as the page and the pictures draw them."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.formats import CityObject
from eaves.formats.models.meshes import SURFACES
from eaves.geometry.rings import following_places
from eaves.model import Integers, Mask, Points, Values
from eaves.model.building import LODS

UNKNOWN_ERROR = 65535
"""RMSE (mm) of a face that no points are known of: the largest whole number of two bytes."""
PIECE_FACES = 4000
"""Number of faces that are cut into triangles at a time, which takes some 40 MB."""


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
    """Many faces in a few arrays, a tenth of what they take as objects.

    `corners` (V, 3) are those of all rings, one behind the other; `ring_start` (R + 1,) is where in them
    each ring starts, `face_start` (F + 1,) where in the rings each face does; `building`, `lod`,
    `kind` and `error` (F,) are as in `CityFace`.
    """

    corners: Points
    ring_start: Integers
    face_start: Integers
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

    def __iter__(self) -> Iterator[CityFace]:
        figures = np.stack([self.building, self.lod, self.kind, self.error], axis=1).tolist()
        for (one, two), about in zip(pairwise(self.face_start.tolist()), figures, strict=True):
            cuts = pairwise(self.ring_start[one : two + 1].tolist())
            yield CityFace(tuple(self.corners[first:last] for first, last in cuts), *about)

    def take(self, which: Mask) -> CityFaces:
        """The faces where the mask (F,) is true."""
        counts, sizes = np.diff(self.face_start), np.diff(self.ring_start)
        ring = np.repeat(which, counts)
        starts = (np.concatenate([[0], np.cumsum(some)]) for some in (sizes[ring], counts[which]))
        figures = (values[which] for values in (self.building, self.lod, self.kind, self.error))
        return CityFaces(self.corners[np.repeat(ring, sizes)], *starts, *figures)


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
        starts = (np.concatenate([[0], np.cumsum(some)]) for some in (self.rings, self.counts))
        figures = np.array(self.figures, np.int64).reshape(-1, 4).T.copy()
        return CityFaces(np.array(self.corners, np.float64).reshape(-1, 3), *starts, *figures)


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
            lod, around = LODS.index(geometry.lod), array("q")
            errors = [whole_millimetres(about.get("rmse_m")) for about in geometry.surfaces]
            for face in (face for solid in geometry.solids for shell in solid for face in shell):
                for ring in face.rings:
                    around.extend(ring)
                    pile.rings.append(len(ring))
                kind = SURFACES.index(face.surface) if face.surface in SURFACES else 0
                error = UNKNOWN_ERROR if face.plane is None else errors[face.plane]
                pile.counts.append(len(face.rings))
                pile.figures.extend((building, lod, kind, error))
            pile.corners.frombytes(item.vertices[np.array(around, np.int64)].tobytes())
    return pile.as_faces()


def whole_millimetres(error: float | None) -> int:
    """An RMSE (m) as `CityFace` has it."""
    return UNKNOWN_ERROR if error is None else min(round(1000.0 * error), UNKNOWN_ERROR - 1)


def cut_into_triangles(faces: CityFaces) -> tuple[Points, Integers]:
    """Constrained Delaunay triangles of planar faces, found on each face's own plane: corners (T, 3, 3),
    counter-clockwise from outside, and the number (T,) of the face of each."""
    if not len(faces):
        return np.zeros((0, 3, 3)), np.zeros(0, np.int64)
    own, sizes, counts = faces.corners, np.diff(faces.ring_start), np.diff(faces.face_start)
    ring_face = np.repeat(np.arange(len(faces)), counts)
    number = np.repeat(ring_face, sizes)
    outer = faces.face_start[:-1]
    frame = _frames(own, sizes, outer)
    aside = own - frame[number, 0]
    places = np.stack([(aside * frame[number, axis]).sum(axis=1) for axis in (1, 2)], axis=1) + 0.0
    edges = shapely.linearrings(places, indices=np.repeat(np.arange(len(sizes)), sizes))
    shapes = np.asarray(shapely.polygons(edges, indices=ring_face), object)
    broken = ~shapely.is_valid(shapes)
    shapes[broken] = shapely.buffer(shapes[broken], 0)
    pieces, owner = shapely.get_parts(shapely.constrained_delaunay_triangles(shapes), return_index=True)
    uv = shapely.get_coordinates(pieces).reshape(-1, 4, 2)[:, :3]
    one, two = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    clockwise = one[:, 0] * two[:, 1] < one[:, 1] * two[:, 0]
    uv[clockwise] = uv[clockwise][:, ::-1]
    corners = frame[owner, None, 0] + np.einsum("tkc,tcd->tkd", uv, frame[owner, 1:])
    _take_own_corners(corners, uv, owner, own, places, number)
    return corners, np.asarray(owner, np.int64)


def _take_own_corners(
    corners: Points,
    uv: Values,
    owner: Integers,
    own: Points,
    places: Values,
    number: Integers,
) -> None:
    """Put triangle corners (T, 3, 3) where the faces' own (V, 3) are, whose places on their plane and faces
    are given: faces are planar to a millimetre only, and neighbours must meet."""
    face = np.concatenate([number, np.repeat(owner, 3)])
    u, v = np.concatenate([places, uv.reshape(-1, 2) + 0.0]).T
    order = np.lexsort((v, u, face))
    new = np.zeros(len(order), np.int64)
    for key in (face[order], u[order], v[order]):
        new[1:] |= key[1:] != key[:-1]
    which = np.empty(len(order), np.int64)
    which[order] = np.cumsum(new)
    known = np.full(int(which.max(initial=-1)) + 1, -1)
    known[which[: len(own)]] = np.arange(len(own))
    found = known[which[len(own) :]]
    hit = found >= 0
    corners.reshape(-1, 3)[hit] = own[found[hit]]


def face_edges(faces: CityFaces) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Corners (E, 2) at the ends of every ring edge, and the number (E,) of its face."""
    size = np.diff(faces.ring_start)
    following = following_places(size).astype(np.int32)
    ring_face = np.repeat(np.arange(len(faces), dtype=np.int32), np.diff(faces.face_start))
    ends = np.stack([np.arange(len(following), dtype=np.int32), following], axis=1)
    return ends, np.repeat(ring_face, size)


def _frames(corners: Points, sizes: Integers, outer: Integers) -> Values:
    """Origin and two directions on its plane, (F, 3, 3), of each ring numbered in `outer`; the
    rings have `sizes` corners each."""
    start = np.cumsum(sizes) - sizes
    aside = corners - np.repeat(corners[start], sizes, axis=0)
    area = np.add.reduceat(np.cross(aside, aside[following_places(sizes)]), start, axis=0)[
        outer
    ]  # Newell's sum
    length = np.linalg.norm(area, axis=1)
    area[length == 0] = 0.0, 0.0, 1.0
    normal = area / np.where(length > 0, length, 1.0)[:, None]
    a, b, c = normal.T
    long = np.hypot(a, b)
    steep = long > 1e-9
    d, e = np.where(steep, [-b, a], [[1.0], [0.0]]) / np.where(steep, long, 1.0)
    first = np.stack([d, e, np.zeros(len(d))], axis=1)
    second = np.stack([-c * e, c * d, a * e - b * d], axis=1)
    return np.stack([corners[start[outer]], first, second], axis=1)
