"""Models cut into triangles and edges, as the page and the pictures draw them."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import overload

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.formats import CityObject
from eaves.geometry.rings import following_places
from eaves.model import Mask, Points
from eaves.model.building import GROUND_SURFACE, LODS, OUTER_CEILING_SURFACE, ROOF_SURFACE, WALL_SURFACE

SURFACES = (GROUND_SURFACE, WALL_SURFACE, ROOF_SURFACE, OUTER_CEILING_SURFACE)
"""Numbered 0, 1, 2, 3 in `Surfaces.kind`."""
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
class CityFaces(Sequence[CityFace]):
    """Many faces in a few arrays, a tenth of what they take as objects.

    `corners` (V, 3) are those of all rings, one behind the other; `ring_start` (R + 1,) is where in them
    each ring starts, `face_start` (F + 1,) where in the rings each face does; `building`, `lod`,
    `kind` and `error` (F,) are as in `CityFace`.
    """

    corners: Points
    ring_start: NDArray[np.int64]
    face_start: NDArray[np.int64]
    building: NDArray[np.int64]
    lod: NDArray[np.int64]
    kind: NDArray[np.int64]
    error: NDArray[np.int64]

    @classmethod
    def of(cls, faces: Iterable[CityFace]) -> CityFaces:
        """The faces, taken one by one."""
        corners, rings, counts, figures = array("d"), array("q", [0]), array("q", [0]), array("q")
        for face in faces:
            for ring in face.rings:
                corners.frombytes(np.asarray(ring, np.float64).tobytes())
                rings.append(len(ring))
            counts.append(len(face.rings))
            figures.extend((face.building, face.lod, face.kind, face.error))
        building, lod, kind, error = np.array(figures, np.int64).reshape(-1, 4).T.copy()
        xyz = np.array(corners, np.float64).reshape(-1, 3)
        return cls(xyz, np.cumsum(rings), np.cumsum(counts), building, lod, kind, error)

    def __len__(self) -> int:
        return len(self.building)

    @overload
    def __getitem__(self, k: int) -> CityFace: ...
    @overload
    def __getitem__(self, k: slice) -> list[CityFace]: ...
    def __getitem__(self, k: int | slice) -> CityFace | list[CityFace]:
        if isinstance(k, slice):
            return [self[n] for n in range(len(self))[k]]
        number = range(len(self))[k]
        cuts = self.ring_start[self.face_start[number] : self.face_start[number + 1] + 1].tolist()
        rings = tuple(self.corners[one:two] for one, two in pairwise(cuts))
        figures = (self.building, self.lod, self.kind, self.error)
        return CityFace(rings, *(int(values[number]) for values in figures))

    def take(self, which: Mask) -> list[CityFace]:
        """The faces where the mask (F,) is true."""
        return [self[k] for k in np.flatnonzero(which).tolist()]


def in_pieces(faces: Sequence[CityFace], size: int = PIECE_FACES) -> Iterator[Sequence[CityFace]]:
    """The faces, so many at a time."""
    for first in range(0, len(faces), size):
        yield faces[first : first + size]


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Triangles of faces: `corners` (T, 3, 3), counter-clockwise from outside; `face` (T,) numbers in
    `faces`."""

    corners: Points
    face: NDArray[np.int64]
    faces: tuple[CityFace, ...]

    def figure(self, name: str) -> NDArray[np.int64]:
        """`building`, `lod`, `kind` or `error` of every triangle (T,)."""
        return np.array([getattr(face, name) for face in self.faces], np.int64)[self.face]


def iter_city_faces(objects: Iterable[CityObject], numbers: dict[str, int]) -> Iterator[CityFace]:
    """The faces of solids of the buildings whose ids `numbers` holds; a part's belong to its building."""
    for item in objects:
        building = numbers.get(item.parents[0] if item.parents else item.id)
        if building is None:
            continue
        for geometry in item.geometries:
            if geometry.lod not in LODS[1:]:
                continue
            lod = LODS.index(geometry.lod)
            for face in (face for solid in geometry.solids for shell in solid for face in shell):
                kind = SURFACES.index(face.surface) if face.surface in SURFACES else 0
                rings = tuple(item.vertices[list(ring)] for ring in face.rings)
                about = {} if face.plane is None else geometry.surfaces[face.plane]
                yield CityFace(rings, building, lod, kind, whole_millimetres(about.get("rmse_m")))


def whole_millimetres(error: float | None) -> int:
    """An RMSE (m) as `CityFace` has it."""
    return UNKNOWN_ERROR if error is None else min(round(1000.0 * error), UNKNOWN_ERROR - 1)


def cut_into_triangles(faces: Sequence[CityFace]) -> Surfaces:
    """Constrained Delaunay triangles of planar faces, found on each face's own plane."""
    if not faces:
        return Surfaces(np.zeros((0, 3, 3)), np.zeros(0, np.int64), ())
    rings = [ring for face in faces for ring in face.rings]
    sizes, counts = (
        np.array([len(each) for each in several], np.int64)
        for several in (rings, [face.rings for face in faces])
    )
    own = np.concatenate([np.zeros((0, 3)), *rings])
    ring_face = np.repeat(np.arange(len(faces)), counts)
    number = np.repeat(ring_face, sizes)
    outer = np.cumsum(counts) - counts
    frame = _frames(own, sizes, outer)
    aside = own - frame[number, 0]
    places = np.stack([(aside * frame[number, axis]).sum(axis=1) for axis in (1, 2)], axis=1) + 0.0
    edges = shapely.linearrings(places, indices=np.repeat(np.arange(len(rings)), sizes))
    shapes = np.asarray(shapely.polygons(edges, indices=ring_face), object)
    broken = ~shapely.is_valid(shapes)
    shapes[broken] = shapely.buffer(shapes[broken], 0)
    pieces, owner = shapely.get_parts(shapely.constrained_delaunay_triangles(shapes), return_index=True)
    uv = shapely.get_coordinates(pieces).reshape(-1, 4, 2)[:, :3]
    clockwise = _twice_area(uv) < 0
    uv[clockwise] = uv[clockwise][:, ::-1]
    corners = frame[owner, None, 0] + np.einsum("tkc,tcd->tkd", uv, frame[owner, 1:3])
    _take_own_corners(corners, uv, owner, own, places, number)
    return Surfaces(np.asarray(corners), np.asarray(owner, np.int64), tuple(faces))


def _take_own_corners(
    corners: Points,
    uv: NDArray[np.float64],
    owner: NDArray[np.int64],
    own: Points,
    places: NDArray[np.float64],
    number: NDArray[np.int64],
) -> None:
    """Put triangle corners (T, 3, 3) where the faces' own (V, 3) are, whose places on their plane and faces
    are given: faces are planar to a millimetre only, and neighbours must meet."""
    asked = np.column_stack([np.repeat(owner, 3), uv.reshape(-1, 2) + 0.0])
    keys = np.ascontiguousarray(np.concatenate([np.column_stack([number, places]), asked]))
    _, which = np.unique(keys.view([("", keys.dtype)] * 3).ravel(), return_inverse=True)
    known = np.full(int(which.max(initial=-1)) + 1, -1)
    known[which[: len(own)]] = np.arange(len(own))
    found = known[which[len(own) :]]
    hit = found >= 0
    corners.reshape(-1, 3)[hit] = own[found[hit]]


def edges_of(faces: CityFaces) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Which corners every ring edge goes between, (E, 2), and the number (E,) of its face."""
    size = np.diff(faces.ring_start)
    following = following_places(size).astype(np.int32)
    ring_face = np.repeat(np.arange(len(faces), dtype=np.int32), np.diff(faces.face_start))
    ends = np.stack([np.arange(len(following), dtype=np.int32), following], axis=1)
    return ends, np.repeat(ring_face, size)


def _frames(corners: Points, sizes: NDArray[np.int64], outer: NDArray[np.int64]) -> NDArray[np.float64]:
    """Origin, two directions on its plane and its normal, (F, 4, 3), of each ring numbered in `outer`; the
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
    return np.stack([corners[start[outer]], first, second, normal], axis=1)


def _twice_area(corner: NDArray[np.float64]) -> NDArray[np.float64]:
    one, two = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    return np.asarray(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0])
