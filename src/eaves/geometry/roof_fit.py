"""Distance of roof points from the roof faces of a model: the definition all figures of fit share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.geometry.inside import edges_of, points_in_polygons
from eaves.geometry.rings import area_vector, polygons_of
from eaves.kernels import kernel
from eaves.model import Integers, Mask, Points, Values

NEAR = 0.3
"""Radius in plan (m) within which a higher building point hides a point."""

DROP = 0.6
"""Height (m) from which a point above another hides it: walls, balconies and under-eaves drop out."""

STEEPEST = 1e-3
"""Smallest upward share of a roof face's normal: a steeper face has no height at a place."""


@dataclass(frozen=True, eq=False)
class RoofFaces:
    """Roof faces as planes over polygons in plan.

    `polygons` (F,) shapely polygons, `coefficients` (F, 3) with height a·x + b·y + c, `owner` (F,) the number
    of the building each belongs to. Coordinates are metres about an origin near the faces.
    """

    polygons: NDArray[np.object_]
    coefficients: Values
    owner: Integers

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
    order = np.argsort(xyz[:, 0])
    mask = np.empty(len(xyz), bool)
    mask[order] = uncovered_kernel(xyz[order])
    return mask


@kernel
def uncovered_kernel(xyz: Points) -> Mask:
    """The mask (N,) as `roof_point_mask` says, of points (N, 3) from west to east."""
    seen = np.ones(len(xyz), np.bool_)
    for one in range(len(xyz)):
        for other in range(one + 1, len(xyz)):
            east = xyz[other, 0] - xyz[one, 0]
            if east > NEAR:
                break
            rise = xyz[other, 2] - xyz[one, 2]
            if abs(rise) > DROP and east**2 + (xyz[other, 1] - xyz[one, 1]) ** 2 <= NEAR**2:
                seen[one if rise > 0.0 else other] = False
    return seen


def collect_faces(faces: Sequence[Sequence[Points]], owner: Sequence[int]) -> RoofFaces:
    """Roof faces from their rings (outer first) of points (M, 3); upright and empty ones are left out."""
    kept: list[Sequence[Points]] = []
    coefficients, owners = [], []
    for rings, building in zip(faces, owner, strict=True):
        normal, centre = area_vector(rings[0]), rings[0].mean(axis=0)
        x, y, z = normal.tolist()
        if abs(z) < STEEPEST * np.linalg.norm(normal) or z == 0.0:
            continue
        kept.append(rings)
        a, b = -x / z, -y / z
        coefficients.append((a, b, centre[2] - a * centre[0] - b * centre[1]))
        owners.append(building)
    polygons = polygons_of([[ring[:, :2] for ring in rings] for rings in kept])
    for number in np.flatnonzero(~shapely.is_valid(polygons)):
        polygons[number] = polygons[number].buffer(0)
    return RoofFaces(polygons, np.array(coefficients).reshape(-1, 3), np.array(owners, np.int64))


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
    face, height = np.full(len(points), -1), np.full(len(points), np.nan)
    under, over = points_in_polygons(points, start, end, owner, len(coefficients))
    a, b, c = coefficients[over].T
    heights = a * points[under, 0] + b * points[under, 1] + c
    if len(under) > 1 and (under[1:] == under[:-1]).any():
        order = np.lexsort((-over, heights))  # the highest comes last; of equals the first face
        under, over, heights = under[order], over[order], heights[order]
    face[under], height[under] = over, heights
    return face, height


@kernel
def face_planes_kernel(places: Points, first: Integers) -> Values:
    """The planes (F, 3: a, b, c) of faces with corners `first[f]` to `first[f + 1]` of `places` (K, 3), by
    their vector areas and mean corners; NaN for those steeper than `STEEPEST`."""
    planes = np.full((len(first) - 1, 3), np.nan)
    for face in range(len(planes)):
        ring = places[first[face] : first[face + 1]]
        normal, centre = np.zeros(3), np.zeros(3)
        for one in range(len(ring)):
            x, y, z = ring[one] - ring[0]
            u, v, w = ring[(one + 1) % len(ring)] - ring[0]
            normal[0] += y * w - z * v
            normal[1] += z * u - x * w
            normal[2] += x * v - y * u
            centre += ring[one]
        normal, centre = 0.5 * normal, centre / len(ring)
        x, y, z = normal
        if abs(z) < STEEPEST * np.sqrt(x * x + y * y + z * z) or z == 0.0:
            continue
        a, b = -x / z, -y / z
        planes[face] = a, b, centre[2] - a * centre[0] - b * centre[1]
    return planes
