"""Roof planes in the triangulated points [maas_vosselman1999]."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from eaves.geometry.components import connected_groups_kernel
from eaves.geometry.planes import add_point_kernel, plane_of_sums_kernel
from eaves.geometry.tin import Tin
from eaves.kernels import kernel
from eaves.methods import Emit, ignore, parameter
from eaves.model import Labels, Mask, Points, RoofPlane
from eaves.roof.region_growing import RegionGrowing
from eaves.roof.stage import RoofMethod
from eaves.roof.toolkit.regions import roof_planes

MOST_FACES = 500
"""Peaks looked at (count): far more than any roof has; a bound on work."""


class TinFaces(RoofMethod):
    """The planes of one roof, found among the triangles between its points.

    Each triangle, with the triangles around it, has a plane, and each plane is a place in the space of
    slopes and offsets. Triangles of one roof face lie together there, those of walls and crowns are
    scattered. The fullest place is taken: first in the two slopes, then in the offset; its triangles are
    parted where they do not touch, and each connected piece that is large enough is a face. They leave, and
    the next fullest place is taken. At last the points between the faces go to the face that is near.

    Formula
    -------
    Area in a cell of (∂z/∂x, ∂z/∂y), then of d = n·p for the mean normal n of the cell.

    Fidelity
    --------
    The paper names clustering in parameter space and connected triangles, and no number. A cell of the
    slopes is two errors of a triangle's plane wide, which follows from noise and spacing; the fullest 3 × 3
    cells count. The plane of a triangle is fitted to the corners of two rings around it, for that of three
    noisy points alone is of little use at 5 points/m² or more. The last step, and joining of coplanar
    pieces, are those of `region_growing`.

    Fails where
    -----------
    Faces narrower than two triangles. Gently curved roofs. Walls and what lies under eaves disturb the
    triangulation, which has one height at each place.

    Complexity
    ----------
    O(N log N) for the triangles, O(N) for each face.

    References
    ----------
    [maas_vosselman1999], section 4.
    """

    name: ClassVar[str] = "tin_faces"
    idea: ClassVar[str] = "Connected triangles whose planes lie together in parameter space."
    paper: ClassVar[str] = "maas_vosselman1999"

    cell: float | None = parameter(
        None,
        "Width of a cell in the space of slopes; two errors of a triangle's plane, at least `least_cell`.",
        gt=0.0,
    )
    least_cell: float = parameter(
        0.05, "Width of a cell in the space of slopes, however exact the points are.", gt=0.0
    )
    rings: int = parameter(
        2,
        "Rings of triangles whose corners say which plane a triangle lies on: about twelve points.",
        ge=1,
        le=3,
    )
    distance_share: float = parameter(
        3.0, "Distance to a plane up to which a triangle belongs to it, in multiples of the noise.", gt=0.0
    )
    finish: RegionGrowing = parameter(
        RegionGrowing(),
        "What joins coplanar faces and gives the points between faces to one of them.",
        unit="method",
    )

    def planes(
        self, points: Points, spacing: float, rng: np.random.Generator, emit: Emit = ignore
    ) -> list[RoofPlane]:
        """The planes of points (N, 3), largest first."""
        if len(points) < 3:
            return []
        local = self.finish.surroundings(points)
        tin = Tin(points)
        real = np.flatnonzero((tin.vertices >= 0).all(axis=1)) if len(tin.vertices) else np.zeros(0, np.int64)
        if len(real) == 0:
            return []
        corners, around = renumber(tin, real)
        planes = np.zeros((len(real), 4))
        triangle_planes_kernel(points, corners, around, self.rings, planes)
        emit("planes of triangles", planes)
        face = self.cluster(points, corners, around, planes, local.noise, local.spacing)
        emit("faces of triangles", face)
        labels = vote_for_face(corners, face, len(points))
        labels = self.finish.join(points, labels, local)
        labels = self.finish.give_back(points, labels, local)
        labels = self.finish.join(points, labels, local)
        emit("labels", labels)
        least_normal_z = float(np.cos(np.radians(self.finish.max_slope)))
        return roof_planes(labels, points, self.finish.fewest_points(local), least_normal_z)

    def cluster(
        self,
        points: Points,
        corners: NDArray[np.int64],
        around: NDArray[np.int64],
        planes: NDArray[np.float64],
        noise: float,
        spacing: float,
    ) -> NDArray[np.int64]:
        """Number (T,) of the face of every triangle, −1 for none."""
        steepest = np.tan(np.radians(self.finish.max_slope))
        slopes = -planes[:, :2] / np.maximum(planes[:, 2:3], 1e-9)
        a, b, c = (points[corners[:, k]] for k in range(3))
        middle = (a + b + c) / 3.0
        area = 0.5 * np.abs(
            (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
        )
        off = np.abs((planes[:, :3] * middle).sum(axis=1) - planes[:, 3])
        open_ = (np.hypot(*slopes.T) < steepest) & (off < self.distance_share * noise)
        width = self.cell or max(2.0 * np.sqrt(np.pi) * noise / (spacing * 12.0) * 2.0, self.least_cell)
        face = np.full(len(corners), -1)
        count = 0
        for _ in range(MOST_FACES):
            found = self.fullest(slopes, planes, middle, area * open_, width, noise)
            pieces, sizes = connected_pieces(found & open_, around, area)
            large = np.flatnonzero(sizes >= self.min_area)
            if len(large) == 0:
                if not found.any() or (area * found * open_).sum() < self.min_area:
                    break
                open_ = open_ & ~found
                continue
            for piece in large:
                face[pieces == piece] = count
                count += 1
            open_ = open_ & ~found
        return face

    def fullest(
        self,
        slopes: NDArray[np.float64],
        planes: NDArray[np.float64],
        middle: Points,
        weight: NDArray[np.float64],
        width: float,
        noise: float,
    ) -> Mask:
        """The triangles (T,) of the place in parameter space with the most weight (T,)."""
        if weight.sum() <= 0.0:
            return np.zeros(len(weight), bool)
        place = peak_of(slopes, weight, width)
        near = (np.abs(slopes - place).max(axis=1) <= 1.5 * width) & (weight > 0.0)
        normal = (planes[near, :3] * weight[near, None]).sum(axis=0)
        normal /= np.linalg.norm(normal)
        offset = middle @ normal
        level = peak_of(offset[near, None], weight[near], self.distance_share * noise)[0]
        reach = 1.5 * self.distance_share * noise
        return np.asarray(near & (np.abs(offset - level) <= reach))


def renumber(tin: Tin, real: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Corners (T, 3) and neighbours (T, 3; −1 outside) of the finite triangles of a TIN."""
    number = np.full(len(tin.vertices) + 1, -1)
    number[real] = np.arange(len(real))
    return tin.vertices[real].astype(np.int64), number[tin.neighbours[real]]


@kernel
def triangle_planes_kernel(
    xyz: NDArray[np.float64],
    corners: NDArray[np.int64],
    around: NDArray[np.int64],
    rings: int,
    planes: NDArray[np.float64],
) -> None:
    """The plane (T, 4) of every triangle (T, 3), fitted to the corners of triangles up to `rings` away."""
    sums = np.zeros(10)
    covariance, vectors, values = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
    members = np.empty(64, np.int64)
    visitor, seen = np.full(len(corners), -1), np.full(len(xyz), -1)
    for t in range(len(corners)):
        members[0], visitor[t] = t, t
        count, first = 1, 0
        for _ in range(rings):
            last = count
            for m in range(first, last):
                for side in range(3):
                    other = around[members[m], side]
                    if other >= 0 and visitor[other] != t and count < 64:
                        visitor[other] = t
                        members[count] = other
                        count += 1
            first = last
        sums[:] = 0.0
        for m in range(count):
            for side in range(3):
                i = corners[members[m], side]
                if seen[i] != t:
                    seen[i] = t
                    add_point_kernel(sums, xyz[i, 0], xyz[i, 1], xyz[i, 2], 1.0)
        plane_of_sums_kernel(sums, covariance, vectors, values, planes[t])


def peak_of(places: NDArray[np.float64], weight: NDArray[np.float64], width: float) -> NDArray[np.float64]:
    """The weighted mean (D,) of the places (T, D ≤ 2) of the fullest 3 (× 3) cells, `width` wide."""
    peak = np.zeros(places.shape[1])
    peak_kernel(np.ascontiguousarray(places), weight, width, peak)
    return peak


@kernel
def peak_kernel(
    places: NDArray[np.float64], weight: NDArray[np.float64], width: float, peak: NDArray[np.float64]
) -> None:
    """The mean of the places (T, D) with weight (T,) around the cell where three a side hold the most."""
    cell, low, high = np.zeros((len(places), 2), np.int64), np.zeros(2, np.int64), np.zeros(2, np.int64)
    first = True
    for t in range(len(places)):
        if weight[t] <= 0.0:
            continue
        for axis in range(places.shape[1]):
            cell[t, axis] = int(np.floor(places[t, axis] / width))
            low[axis] = cell[t, axis] if first else min(low[axis], cell[t, axis])
            high[axis] = cell[t, axis] if first else max(high[axis], cell[t, axis])
        first = False
    grid = np.zeros((high[0] - low[0] + 3, high[1] - low[1] + 3))
    for t in range(len(places)):
        if weight[t] > 0.0:
            grid[cell[t, 0] - low[0] + 1, cell[t, 1] - low[1] + 1] += weight[t]
    best, top, left = -1.0, 0, 0
    for row in range(1, len(grid) - 1):
        for column in range(1, grid.shape[1] - 1):
            total = grid[row - 1 : row + 2, column - 1 : column + 2].sum()
            if total > best:
                best, top, left = total, row - 1 + low[0], column - 1 + low[1]
    total = 0.0
    for t in range(len(places)):
        if weight[t] > 0.0 and abs(cell[t, 0] - top) <= 1 and abs(cell[t, 1] - left) <= 1:
            total += weight[t]
            for axis in range(places.shape[1]):
                peak[axis] += weight[t] * places[t, axis]
    for axis in range(places.shape[1]):
        peak[axis] /= total


def connected_pieces(
    some: Mask, around: NDArray[np.int64], area: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Piece (T,) of each of the triangles picked (T,), −1 for the others; the area (m²) of every piece."""
    one, other = np.repeat(np.arange(len(some)), 3), around.ravel()
    linked = (other >= 0) & some[one] & some[other]
    group = connected_groups_kernel(one[linked], other[linked], len(some))
    piece = np.full(len(some), -1)
    piece[some] = np.unique(group[some], return_inverse=True)[1]
    return piece, np.bincount(piece[some], area[some]).astype(np.float64)


def vote_for_face(corners: NDArray[np.int64], face: NDArray[np.int64], count: int) -> Labels:
    """The label (N,) of every point: the face most of its triangles lie on, 0 where half or more do not."""
    faces = int(face.max(initial=-1)) + 1
    place = corners * (faces + 1) + face[:, None] + 1
    votes = np.bincount(place.ravel(), minlength=count * (faces + 1)).reshape(count, faces + 1)
    best = np.argmax(votes[:, 1:], axis=1) if faces else np.zeros(count, np.int64)
    enough = votes[np.arange(count), best + 1] * 2 > votes.sum(axis=1) if faces else np.zeros(count, bool)
    return np.where(enough, best + 1, 0).astype(np.int32)
