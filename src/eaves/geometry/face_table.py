"""Planar faces as arrays: their rings, areas, directions, planes, polygons and triangles."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.geometry.inside import edges_of, points_in_polygons
from eaves.geometry.rings import FLAT_SLOPE_DEG, following_places
from eaves.kernels import kernel
from eaves.model import Integers, Mask, Points, Solid, Values

STEEPEST = 1e-3
"""Smallest upward share of a face's normal: a steeper face has no height at a place."""


@dataclass(frozen=True, eq=False)
class FaceTable:
    """F planar faces.

    `corners` (V, 3) are those of all rings, one behind the other, each of `ring_sizes` (R,) corners; a face
    has `ring_counts` (F,) of them, its outer ring first.
    """

    corners: Points
    ring_sizes: Integers
    ring_counts: Integers

    @classmethod
    def of(cls, faces: Sequence[Sequence[Points]]) -> FaceTable:
        """Faces from their rings (M, 3), the outer one first."""
        counts = [len(face) for face in faces]
        rings = [ring for face in faces for ring in face]
        corners = np.concatenate([np.zeros((0, 3)), *rings])
        return cls(corners, np.array([len(ring) for ring in rings], np.int64), np.array(counts, np.int64))

    @classmethod
    def of_solids(cls, solids: Iterable[Solid], surface: str | None = None) -> FaceTable:
        """The faces of solids in their order, all or those of one kind of surface."""
        tables = []
        for solid in solids:
            table = cls(solid.vertices[solid.corners], solid.ring_sizes, solid.ring_counts)
            tables.append(table if surface is None else table.take(solid.surfaces == surface))
        return tables[0] if len(tables) == 1 else cls.join(tables)

    @classmethod
    def join(cls, tables: Sequence[FaceTable]) -> FaceTable:
        """All the faces of tables, in order."""
        corners = np.concatenate([np.zeros((0, 3)), *(table.corners for table in tables)])
        none = np.zeros(0, np.int64)
        sizes = np.concatenate([none, *(table.ring_sizes for table in tables)])
        return cls(corners, sizes, np.concatenate([none, *(table.ring_counts for table in tables)]))

    def __len__(self) -> int:
        return len(self.ring_counts)

    def take(self, which: Mask) -> FaceTable:
        """The faces where the mask (F,) is true."""
        ring = which.repeat(self.ring_counts)
        corners = self.corners[ring.repeat(self.ring_sizes)]
        return FaceTable(corners, self.ring_sizes[ring], self.ring_counts[which])

    def moved(self, shift: Values) -> FaceTable:
        """The faces moved by a vector (3,)."""
        return replace(self, corners=self.corners + shift)

    def rings_of(self, face: int) -> list[Points]:
        """The rings (M, 3) of one face, the outer one first."""
        ring = self.outer[face]
        sizes = self.ring_sizes[ring : ring + self.ring_counts[face]]
        first = self.ring_start[ring]
        return np.split(self.corners[first : first + sizes.sum()], np.cumsum(sizes)[:-1])

    @cached_property
    def ring_start(self) -> Integers:
        """The first corner (R,) of each ring."""
        return np.asarray(self.ring_sizes.cumsum() - self.ring_sizes)

    @cached_property
    def outer(self) -> Integers:
        """The outer ring (F,) of each face."""
        return np.asarray(self.ring_counts.cumsum() - self.ring_counts)

    @cached_property
    def face_of_ring(self) -> Integers:
        """The face (R,) of each ring."""
        return np.arange(len(self)).repeat(self.ring_counts)

    @cached_property
    def ring_of_corner(self) -> Integers:
        """The ring (V,) of each corner."""
        return np.arange(len(self.ring_sizes)).repeat(self.ring_sizes)

    @cached_property
    def face_of_corner(self) -> Integers:
        """The face (V,) of each corner, and of the edge that begins there."""
        return self.face_of_ring[self.ring_of_corner]

    @cached_property
    def following(self) -> Integers:
        """The corner (V,) in which the edge that begins at each corner ends."""
        return following_places(self.ring_sizes)

    @cached_property
    def ring_figures(self) -> tuple[Points, Points]:
        """Area (m²) of each ring times its unit normal, (R, 3), and its mean corner (R, 3)."""
        vectors, middles = ring_figures_kernel(self.corners, self.ring_sizes)
        return vectors, middles

    @cached_property
    def vectors(self) -> Points:
        """Area (m²) of each face times its unit normal, (F, 3), holes taken off."""
        return np.asarray(np.add.reduceat(self.ring_figures[0], self.outer, axis=0))

    @property
    def areas(self) -> Values:
        """Area (m², F) of each face along its slope."""
        return np.asarray(np.linalg.norm(self.vectors, axis=1))

    @property
    def normals(self) -> Points:
        """Unit normal (F, 3) of each outer ring; up for one without area."""
        outer = self.ring_figures[0][self.outer]
        size = np.linalg.norm(outer, axis=1)[:, None]
        return np.where(size > 0.0, outer / np.where(size > 0.0, size, 1.0), [0.0, 0.0, 1.0])

    @cached_property
    def slopes_deg(self) -> Values:
        """Degrees (F,) from the horizontal."""
        x, y, z = self.vectors.T
        return np.asarray(np.degrees(np.arctan2(np.hypot(x, y), z)))

    @property
    def azimuths_deg(self) -> Values:
        """Direction (F,) the slope falls to, degrees clockwise from grid north; NaN under 2° of slope."""
        x, y, _ = self.vectors.T
        flat = self.slopes_deg < FLAT_SLOPE_DEG
        return np.asarray(np.where(flat, np.nan, np.degrees(np.arctan2(x, y)) % 360.0))

    @cached_property
    def planes(self) -> Values:
        """Height a·x + b·y + c of each face, (F, 3), by the outer ring's normal and mean corner; NaN for
        those steeper than `STEEPEST`."""
        (x, y, z), middle = (figures[self.outer].T for figures in self.ring_figures)
        z = np.where(np.abs(z) <= STEEPEST * np.sqrt(x * x + y * y + z * z), np.nan, z)
        planes = np.empty((len(self), 3))
        planes[:, 0], planes[:, 1] = -x / z, -y / z
        planes[:, 2] = middle[2] - planes[:, 0] * middle[0] - planes[:, 1] * middle[1]
        return planes

    @property
    def heights(self) -> tuple[Values, Values]:
        """Lowest and highest corner (m), (F,) and (F,), of each outer ring."""
        z, start = self.corners[:, 2], self.ring_start
        return np.minimum.reduceat(z, start)[self.outer], np.maximum.reduceat(z, start)[self.outer]

    @property
    def volume(self) -> float:
        """Volume (m³) that the faces of closed solids enclose, by the divergence theorem."""
        if not len(self):
            return 0.0
        heads = self.corners[self.ring_start[self.outer]] - self.corners[0]
        return float((heads * self.vectors).sum() / 3.0)

    def section_area(self, height: float) -> float:
        """Area (m²) of the level section at a height (m) through closed solids: the plan of what lies
        over it, of faces that look up less that of those that look down.

        Each edge is cut at the height and summed by its cross product about a place of its face's level line,
        so that the line itself adds nothing.
        """
        parts = section_kernel(self.corners, self.following, self.face_of_corner, len(self), height)
        return float(0.5 * parts.sum())

    def polygons(self, dimensions: int = 2) -> NDArray[np.object_]:
        """The faces (F,) as polygons, in plan or with their heights."""
        return self.polygons_at(self.corners[:, :dimensions])

    def polygons_at(self, places: Values, faces: Mask | None = None) -> NDArray[np.object_]:
        """The faces, all or those of a mask (F,), as polygons with their corners at other places (V, 2 or
        3)."""
        if faces is not None:
            return self.take(faces).polygons_at(places[faces[self.face_of_corner]])
        if not len(self):
            return np.empty(0, object)
        rings = shapely.linearrings(places, indices=self.ring_of_corner)
        return np.asarray(shapely.polygons(rings, indices=self.face_of_ring), object)

    def ring_areas_at(self, places: Values) -> Values:
        """Twice the area (R,) in each ring with its corners at places (V, 2), negative when it runs
        clockwise."""
        following = places[self.following]
        twice = places[:, 0] * following[:, 1] - places[:, 1] * following[:, 0]
        return np.asarray(np.bincount(self.ring_of_corner, twice, len(self.ring_sizes)), np.float64)

    def triangles(self) -> tuple[Integers, Integers]:
        """Corners (T, 3) and face (T,) of triangles, counter-clockwise from outside.

        They are constrained Delaunay triangles on each face's own plane. A face that crosses itself is a fan
        about the first corner of its outer ring, one without area has none.
        """
        if not len(self):
            return np.zeros((0, 3), np.int64), np.zeros(0, np.int64)
        frame, owner = self._frames(), self.face_of_corner
        aside = self.corners - frame[owner, 0]
        places = np.stack([(aside * frame[owner, axis]).sum(axis=1) for axis in (1, 2)], axis=1)
        shapes = self.polygons_at(places)
        valid = shapely.is_valid(shapes)
        corner, face = self.cut(places, shapes[valid], np.flatnonzero(valid))
        crossing = np.flatnonzero(~valid & (self.areas > 0.0))
        fans = [self._fan(number) for number in crossing.tolist()]
        corner = np.concatenate([corner, *fans])
        face = np.concatenate([face, np.repeat(crossing, [len(fan) for fan in fans])])
        order = np.argsort(face, kind="stable")
        return corner[order], face[order]

    def cut(self, places: Values, shapes: NDArray[np.object_], faces: Integers) -> tuple[Integers, Integers]:
        """Corners (T, 3) and face (T,) of constrained Delaunay triangles of the valid polygons `shapes` (K,)
        that `faces` (K,) make with their corners at places (V, 2). They run around as the outer ring does.
        """
        pieces, number = shapely.get_parts(shapely.constrained_delaunay_triangles(shapes), return_index=True)
        uv = shapely.get_coordinates(pieces).reshape(-1, 4, 2)[:, :3]
        face = faces[number]
        corner = self._corners_at(places, uv.reshape(-1, 2), np.repeat(face, 3)).reshape(-1, 3)
        side, diagonal = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
        twice = side[:, 0] * diagonal[:, 1] - side[:, 1] * diagonal[:, 0]
        backwards = twice * self.ring_areas_at(places)[self.outer[face]] < 0.0
        corner[backwards] = corner[backwards][:, ::-1]
        return corner, face

    def _fan(self, face: int) -> Integers:
        """The corners (T, 3) of triangles about the first corner of an outer ring."""
        first = self.ring_start[self.outer[face]]
        after = np.arange(first + 1, first + self.ring_sizes[self.outer[face]] - 1)
        return np.column_stack([np.full(len(after), first), after, after + 1])

    def _corners_at(self, places: Values, targets: Values, face: Integers) -> Integers:
        """The corners (K,) of faces (K,) at places `targets` (K, 2) on their planes, where the corners are
        at `places` (V, 2)."""
        owner = np.concatenate([self.face_of_corner, face])
        u, v = np.concatenate([places, targets]).T + 0.0  # -0.0 becomes 0.0
        order = np.lexsort((v, u, owner))
        new = np.zeros(len(order), np.int64)
        for key in (owner[order], u[order], v[order]):
            new[1:] |= key[1:] != key[:-1]
        which = np.empty(len(order), np.int64)
        which[order] = np.cumsum(new)
        corner = np.empty(int(which.max()) + 1, np.int64)
        corner[which[: len(places)]] = np.arange(len(places))
        return np.asarray(corner[which[len(places) :]])

    def _frames(self) -> Values:
        """First corner of each outer ring and two directions on its plane, (F, 3, 3)."""
        a, b, c = self.normals.T
        long = np.hypot(a, b)
        steep = long > 1e-9
        d, e = np.where(steep, [-b, a], [[1.0], [0.0]]) / np.where(steep, long, 1.0)
        first = np.stack([d, e, np.zeros(len(d))], axis=1)
        second = np.stack([-c * e, c * d, a * e - b * d], axis=1)
        return np.stack([self.corners[self.ring_start[self.outer]], first, second], axis=1)


@kernel
def section_kernel(corners: Points, following: Integers, face: Integers, count: int, height: float) -> Values:
    """The cross products (K,) of which `section_area` is half the sum, of the edges from the corners (V, 3)
    of each of `count` faces to those `following` (V,)."""
    origin, cut = np.empty((count, 2)), np.zeros((len(corners), 2))
    for corner in range(len(corners) - 1, -1, -1):  # the first corner is left, or the last that is cut
        origin[face[corner]] = corners[corner, :2]
    for corner in range(len(corners)):
        start, end = corners[corner], corners[following[corner]]
        if (start[2] >= height) != (end[2] >= height):
            share = (height - start[2]) / (end[2] - start[2])
            cut[corner] = start[:2] + share * (end[:2] - start[:2])
            origin[face[corner]] = cut[corner]
    parts, seen = np.empty(len(corners)), 0
    for corner in range(len(corners)):
        start, end = corners[corner], corners[following[corner]]
        if start[2] >= height or end[2] >= height:
            ax, ay = (start[:2] if start[2] >= height else cut[corner]) - origin[face[corner]]
            bx, by = (end[:2] if end[2] >= height else cut[corner]) - origin[face[corner]]
            parts[seen] = ax * by - ay * bx
            seen += 1
    return parts[:seen]


@kernel
def ring_figures_kernel(corners: Points, sizes: Integers) -> tuple[Points, Points]:
    """Area vectors (R, 3; half of Newell's sum of cross products) and mean corners (R, 3) of rings of `sizes`
    (R,) corners (V, 3) that stand one behind the other."""
    vectors, middles = np.zeros((len(sizes), 3)), np.zeros((len(sizes), 3))
    first = 0
    for number, size in enumerate(sizes):
        ring = corners[first : first + size]
        for corner in range(size):
            x, y, z = ring[corner] - ring[0]
            u, v, w = ring[(corner + 1) % size] - ring[0]
            vectors[number, 0] += y * w - z * v
            vectors[number, 1] += z * u - x * w
            vectors[number, 2] += x * v - y * u
            middles[number] += ring[corner]
        first += size
    return 0.5 * vectors, middles / sizes.reshape(-1, 1)


NEAR = 0.3
"""Radius in plan (m) within which a higher building point hides a point."""

STRIP = 0.5
"""Width (m) of the strips in which such points are looked for: more than the radius, exact as a number."""

DROP = 0.6
"""Height (m) from which a point above another hides it: walls, balconies and under-eaves drop out."""


@dataclass(frozen=True, eq=False)
class RoofFaces:
    """Roof faces as planes over polygons in plan.

    `polygons` (F,) shapely polygons, `coefficients` (F, 3) with height a·x + b·y + c, `owner` (F,) the number
    of the building each belongs to. Coordinates are metres about an origin near the faces.
    """

    polygons: NDArray[np.object_]
    coefficients: Values
    owner: Integers

    @classmethod
    def of(cls, table: FaceTable, owner: Sequence[int] | Integers | None = None) -> RoofFaces:
        """The faces of a table, of building 0 or the `owner` (F,); upright and empty ones are left out."""
        sloped = ~np.isnan(table.planes[:, 0])
        polygons = table.take(sloped).polygons()
        broken = ~shapely.is_valid(polygons)
        polygons[broken] = shapely.buffer(polygons[broken], 0)
        owners = np.zeros(len(table), np.int64) if owner is None else np.asarray(owner)
        return cls(polygons, table.planes[sloped], owners[sloped])

    @property
    def cosine(self) -> Values:
        """Cosine (F,) of the slope of each face."""
        a, b, _ = self.coefficients.T
        return np.asarray(1.0 / np.sqrt(a * a + b * b + 1.0))


@dataclass(frozen=True, eq=False)
class RoofFit:
    """Roof points against the highest face over them.

    `face` (N,) is the face's number, -1 for a miss; `vertical` (N,) the point's height over it and `distance`
    (N,) the distance along its normal (m), both NaN for a miss.
    """

    face: Integers
    vertical: Values
    distance: Values


def roof_point_mask(xyz: Points) -> Mask:
    """Mask (N,) of the building points (N, 3) that are roof points: none lies over `DROP` above within
    `NEAR`.

    The mask depends on the cloud alone, so it is the same for every model compared.
    """
    if len(xyz) == 0:
        return np.zeros(0, bool)
    strip = np.floor(xyz[:, 0] / STRIP)
    order = np.lexsort((xyz[:, 1], strip))
    mask = np.empty(len(xyz), bool)
    mask[order] = uncovered_kernel(xyz[order], strip[order])
    return mask


@kernel
def uncovered_kernel(xyz: Points, strip: Values) -> Mask:
    """The mask (N,) as `roof_point_mask` says, of points (N, 3) from south to north in each `strip` (N,),
    the strips from west to east."""
    uncovered = np.ones(len(xyz), np.bool_)
    beside = 0
    for i in range(len(xyz)):
        if i == 0 or strip[i] != strip[i - 1]:
            beside = max(beside, i)
            while beside < len(xyz) and strip[beside] == strip[i]:
                beside += 1
        x, y, east = xyz[i, 0], xyz[i, 1], strip[i] + 1.0
        while beside < len(xyz) and strip[beside] == east and xyz[beside, 1] < y - NEAR:
            beside += 1
        for first, number in ((i + 1, strip[i]), (beside, east)):
            for j in range(first, len(xyz)):
                if strip[j] != number or xyz[j, 1] > y + NEAR:
                    break
                rise = xyz[j, 2] - xyz[i, 2]
                if abs(rise) > DROP and (xyz[j, 0] - x) ** 2 + (xyz[j, 1] - y) ** 2 <= NEAR**2:
                    uncovered[i if rise > 0.0 else j] = False
    return uncovered


def fit_roof(points: Points, faces: RoofFaces) -> RoofFit:
    """Each point (N, 3) against the highest face at its x, y."""
    face = np.full(len(points), -1)
    if len(points) and len(faces.polygons):
        face, _ = highest_faces(points, *edges_of(faces.polygons), faces.coefficients)
    hit = face >= 0
    vertical, distance = np.full((2, len(points)), np.nan)
    a, b, c = faces.coefficients[face[hit]].T
    vertical[hit] = points[hit, 2] - (a * points[hit, 0] + b * points[hit, 1] + c)
    distance[hit] = vertical[hit] * faces.cosine[face[hit]]
    return RoofFit(face, vertical, distance)


def highest_faces(
    points: Points,
    start: Values,
    end: Values,
    owner: Integers,
    coefficients: Values,
) -> tuple[Integers, Values]:
    """The number (N,) of the highest face at the x, y of points (N, 2 or 3), -1 for none, and its height
    there (N,), NaN for none.

    Edges from `start` to `end` (E, 2) are those of the faces `owner` (E,), ascending; faces have the
    `coefficients` (F, 3). Of faces of one height it is the first.
    """
    under, over = points_in_polygons(points, start, end, owner, len(coefficients))
    face, height = highest_kernel(points, under, over, coefficients)
    return face, height


@kernel
def highest_kernel(
    points: Points, under: Integers, over: Integers, coefficients: Values
) -> tuple[Integers, Values]:
    """See `highest_faces`; points `under` (K,) lie under faces `over` (K,)."""
    face, height = np.full(len(points), -1), np.full(len(points), np.nan)
    for pair in range(len(under)):
        point, number = under[pair], over[pair]
        a, b, c = coefficients[number]
        z = a * points[point, 0] + b * points[point, 1] + c
        if face[point] < 0 or z > height[point] or (z == height[point] and number < face[point]):
            face[point], height[point] = number, z
    return face, height
