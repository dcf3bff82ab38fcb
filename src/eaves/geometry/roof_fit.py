"""Distance of roof points from the roof faces of a model: the definition all figures of fit share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.geometry.face_table import FaceTable
from eaves.geometry.inside import edges_of, points_in_polygons
from eaves.kernels import kernel
from eaves.model import Integers, Mask, Points, Values

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
    face, height = np.full(len(points), -1), np.full(len(points), np.nan)
    under, over = points_in_polygons(points, start, end, owner, len(coefficients))
    a, b, c = coefficients[over].T
    heights = a * points[under, 0] + b * points[under, 1] + c
    if len(under) > 1 and (under[1:] == under[:-1]).any():
        order = np.lexsort((-over, heights))  # the highest comes last; of equals the first face
        under, over, heights = under[order], over[order], heights[order]
    face[under], height[under] = over, heights
    return face, height
