"""Roof planes in the triangulated points [maas_vosselman1999]."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from scipy.ndimage import uniform_filter

from eaves.geometry.inside import connected_groups_kernel
from eaves.geometry.planes import LocalPlanes
from eaves.geometry.tin import Tin
from eaves.methods import Emit, ignore, parameter
from eaves.model import Integers, Labels, Mask, Points, RoofPlane, Values
from eaves.roof.region_growing import RegionGrowing
from eaves.roof.stage import RoofMethod
from eaves.roof.toolkit.regions import normal_error, roof_planes

MOST_FACES = 500
"""Peaks looked at (count): far more than any roof has; a bound on work."""


class TinFaces(RoofMethod):
    """The planes of one roof, found among the triangles between its points.

    Each triangle, with the points around its corners, has a plane, and each plane is a place in the space of
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
    slopes is two errors of a normal wide, which follows from noise and spacing; the fullest 3 × 3 cells
    count. The normal of a triangle is the mean of those at its corners, fitted to the points around them, for
    that of three noisy points alone is of little use at 5 points/m² or more. The last step, and joining of
    coplanar pieces, are those of `region_growing`.

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
        "Width of a cell in the space of slopes; two errors of a normal, at least `least_cell`.",
        gt=0.0,
    )
    least_cell: float = parameter(
        0.05, "Width of a cell in the space of slopes, however exact the points are.", gt=0.0
    )
    finish: RegionGrowing = parameter(
        RegionGrowing(),
        "Method that joins coplanar faces and gives the points between faces to one of them.",
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
        normals = local.normals[corners].mean(axis=1)
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        emit("triangles", corners)
        emit("normals of triangles", normals)
        face = self.cluster(points[corners], around, normals, local)
        emit("faces of triangles", face + 1)
        labels = vote_for_face(corners, face, len(points))
        labels = self.finish.join(points, labels, local)
        labels = self.finish.give_back(points, labels, local)
        labels = self.finish.join(points, labels, local)
        emit("labels", labels)
        least_normal_z = float(np.cos(np.radians(self.finish.max_slope)))
        return roof_planes(labels, points, self.finish.fewest_points(local), least_normal_z)

    def cluster(self, corners: Points, around: Integers, normals: Values, local: LocalPlanes) -> Integers:
        """Number (T,) of the face of every triangle, by its corners (T, 3, 3); −1 for none."""
        slopes = -normals[:, :2] / np.maximum(normals[:, 2:], 1e-9)
        (ux, uy), (vx, vy) = ((corners[:, k, :2] - corners[:, 0, :2]).T for k in (1, 2))
        area, middle = 0.5 * np.abs(ux * vy - vx * uy), corners.mean(axis=1)
        open_ = np.hypot(*slopes.T) < np.tan(np.radians(self.finish.max_slope))
        width = self.cell or max(2.0 * normal_error(local), self.least_cell)
        reach = self.finish.distance_share * local.noise
        face, count = np.full(len(corners), -1), 0
        for _ in range(MOST_FACES):
            members = fullest(slopes, normals, middle, area * open_, width, reach)
            if area[members].sum() < self.min_area:
                break
            pieces, sizes = connected_pieces(members, around, area)
            for piece in np.flatnonzero(sizes >= self.min_area):
                face[pieces == piece] = count
                count += 1
            open_ &= ~members
        return face


def fullest(
    slopes: Values,
    normals: Values,
    middle: Points,
    weight: Values,
    width: float,
    reach: float,
) -> Mask:
    """The triangles (T,) of the place in parameter space with the most weight (T,): cells of the slopes are
    `width`, of the offset `reach` (m) wide."""
    if weight.sum() <= 0.0:
        return np.zeros(len(weight), bool)
    place = peak_of(slopes, weight, width)
    inside = (np.abs(slopes - place).max(axis=1) <= 1.5 * width) & (weight > 0.0)
    normal = (normals[inside] * weight[inside, None]).sum(axis=0)
    offset = middle @ (normal / np.linalg.norm(normal))
    level = peak_of(offset[inside, None], weight[inside], reach)[0]
    return np.asarray(inside & (np.abs(offset - level) <= 1.5 * reach))


def renumber(tin: Tin, real: Integers) -> tuple[Integers, Integers]:
    """Corners (T, 3) and neighbours (T, 3; −1 outside) of the finite triangles of a TIN."""
    number = np.full(len(tin.vertices) + 1, -1)
    number[real] = np.arange(len(real))
    return tin.vertices[real].astype(np.int64), number[tin.neighbours[real]]


def peak_of(places: Values, weight: Values, width: float) -> Values:
    """The weighted mean (D,) of the places (T, D ≤ 2) of the fullest 3 (× 3) cells, `width` wide."""
    weighted = weight > 0.0
    cell = np.floor(places / width).astype(np.int64)
    low = cell[weighted].min(axis=0)
    grid = np.zeros(cell[weighted].max(axis=0) - low + 1)
    np.add.at(grid, tuple((cell[weighted] - low).T), weight[weighted])
    around = uniform_filter(grid, 3, mode="constant")
    top = np.array(np.unravel_index(int(around.argmax()), grid.shape)) + low
    beside = weighted & (np.abs(cell - top) <= 1).all(axis=1)
    return np.asarray(np.average(places[beside], axis=0, weights=weight[beside]))


def connected_pieces(chosen: Mask, around: Integers, area: Values) -> tuple[Integers, Values]:
    """Piece (T,) of each of the triangles picked (T,), −1 for the others; the area (m²) of every piece."""
    first, second = np.repeat(np.arange(len(chosen)), 3), around.ravel()
    linked = (second >= 0) & chosen[first] & chosen[second]
    group = connected_groups_kernel(first[linked], second[linked], len(chosen))
    piece = np.full(len(chosen), -1)
    piece[chosen] = np.unique(group[chosen], return_inverse=True)[1]
    return piece, np.bincount(piece[chosen], area[chosen]).astype(np.float64)


def vote_for_face(corners: Integers, face: Integers, count: int) -> Labels:
    """The label (N,) of every point: the face most of its triangles lie on, 0 where half or more do not."""
    faces = int(face.max(initial=-1)) + 1
    place = corners * (faces + 1) + face[:, None] + 1
    votes = np.bincount(place.ravel(), minlength=count * (faces + 1)).reshape(count, faces + 1)
    best = np.argmax(votes[:, 1:], axis=1) if faces else np.zeros(count, np.int64)
    enough = votes[np.arange(count), best + 1] * 2 > votes.sum(axis=1) if faces else np.zeros(count, bool)
    return np.where(enough, best + 1, 0).astype(np.int32)
