"""Whether a solid is closed, oriented and planar: the last look before a solid leaves the reconstructor."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.geometry.rings import polygons_of, ring_edges
from eaves.geometry.tolerance import COORDINATE_STEP, PLANARITY
from eaves.model import Solid
from eaves.model.building import ROOF_SURFACE, WALL_SURFACE

FLATTEST_SHARE = 0.9
"""Share of `PLANARITY` a face may use; the rest is for the rounding of written coordinates."""

CLOSEST = 2.0 * COORDINATE_STEP
"""Corners and edges nearer than this (m) could fall together when coordinates are written."""

LOWEST_WALL = 0.05
"""A roof is at least this high (m) above the base of the solid, everywhere."""

MOST_BEND = 1.2
"""Steps of written coordinates by which such a corner may lie off its border: rounding explains no more."""

MOST_FOLD_DEG = 9.0
"""Angle (degrees) between triangles of one face; under half of val3dity's 20, as any two may be compared."""


def find_defect(solid: Solid) -> str:
    """What is wrong with a solid extruded from a plan, in a few words; empty when it is sound.

    Walls stand on one plan edge each and are planar by construction. What is checked is what rounding and
    merging of heights could break: edges used once each way, roof planes, rings that stay simple, faces
    with area.
    """
    rings = [ring for face in solid.faces for ring in face.rings]
    if min(map(len, rings)) < 3:
        return "a ring of fewer than three vertices"
    start, end, _ = ring_edges(rings)
    count = len(solid.vertices)
    there, back = np.sort(start * count + end), np.sort(end * count + start)
    if np.any(np.diff(there) == 0) or not np.array_equal(there, back):
        return "an edge that is not used once each way"
    flat = {
        number: on_own_plane(solid, face.rings)
        for number, face in enumerate(solid.faces)
        if face.surface != WALL_SURFACE and sum(map(len, face.rings)) > 3 and not is_level(solid, face.rings)
    }
    if any(np.abs(places[:, 2]).max() > FLATTEST_SHARE * PLANARITY for places in flat.values()):
        return "a roof face that is not planar"
    ground = solid.vertices[solid.faces[0].rings[0][0], 2]
    roof = {v for face in solid.faces if face.surface == ROOF_SURFACE for v in face.rings[0]}
    if solid.vertices[list(roof), 2].min() < ground + LOWEST_WALL:
        return "a roof that reaches the ground"
    return plan_defect(solid) or bend_defect(solid, flat) or fold_defect(solid, flat)


def is_level(solid: Solid, rings: tuple[tuple[int, ...], ...]) -> bool:
    """Whether a face's vertices are at one height: it is planar, has no fold, and its plane is the plan."""
    heights = solid.vertices[[vertex for ring in rings for vertex in ring], 2]
    return bool((heights == heights[0]).all())


def on_own_plane(solid: Solid, rings: tuple[tuple[int, ...], ...]) -> NDArray[np.float64]:
    """The vertices (V, 3) of a face's rings along, across and off its plane of least squares."""
    places = solid.vertices[[vertex for ring in rings for vertex in ring]]
    centred = places - places.mean(axis=0)
    return np.asarray(centred @ np.linalg.svd(centred, full_matrices=False)[2].T)


def plan_defect(solid: Solid) -> str:
    """What is wrong with the plan of the roof faces: rings that cross, faces that overlap."""
    polygons = plan_polygons(solid)
    if not shapely.is_valid(polygons).all():
        return "a face whose rings cross"
    if shapely.minimum_clearance(polygons).min() < CLOSEST:
        return "corners too close to each other"
    areas = shapely.area(polygons)
    if abs(areas[0] - areas[1:].sum()) > COORDINATE_STEP * shapely.length(polygons[0]):
        return "roof faces that do not cover the ground face"
    return ""


def bend_defect(solid: Solid, numbers: Iterable[int]) -> str:
    """Whether a corner of a roof face bends one way in plan and the other way seen from the side.

    Only faces steeper than 45° among those `numbers` can: they are cut into triangles as seen from the
    side. A corner on a straight border does once heights of two planes are made one; it then lies on the
    other side of its border than the wall that stands on it.
    """
    for number in numbers:
        face = solid.faces[number]
        outer = solid.vertices[list(face.rings[0])]
        area = np.abs(np.cross(outer - outer[0], np.roll(outer, -1, axis=0) - outer[0]).sum(axis=0))
        side = int(np.argmax(area))
        if side == 2:
            continue
        for ring in face.rings:
            places = np.round(solid.vertices[list(ring)] / COORDINATE_STEP)
            into, out = places - np.roll(places, 1, axis=0), np.roll(places, -1, axis=0) - places
            turn = np.cross(into, out)
            plan, seen = turn[:, 2], turn[:, side]
            same = np.sign((np.sign(plan) * np.sign(seen)).sum())
            chord = np.delete(into + out, side, axis=1)
            away = np.abs(seen) / np.maximum(np.hypot(*chord.T), 1.0)
            if np.any((plan * seen * same < 0.0) & (away > MOST_BEND)):
                return "a corner that bends otherwise in plan than from the side"
    return ""


def plan_polygons(solid: Solid) -> NDArray[np.object_]:
    """The faces that are not walls (F,) as polygons in plan."""
    faces = [face.rings for face in solid.faces if face.surface != WALL_SURFACE]
    return polygons_of([[solid.vertices[list(ring), :2] for ring in rings] for rings in faces])


def fold_defect(solid: Solid, flat: dict[int, NDArray[np.float64]]) -> str:
    """Whether a triangle of a face leans away from the others, as thin ones do once heights are rounded.

    `flat` are the vertices (V, 3) of sloped faces of more than three, by number, on their own planes: there
    are the triangles of Delaunay by which validators define folds.
    """
    roofs = [number for number in flat if solid.faces[number].surface == ROOF_SURFACE]
    if not roofs:
        return ""
    polygons = polygons_of(
        [
            np.split(flat[number], np.cumsum([len(ring) for ring in solid.faces[number].rings])[:-1])
            for number in roofs
        ]
    )
    if not shapely.is_valid(polygons).all():
        return "a face whose rings cross on its plane"
    pieces, owner = shapely.get_parts(shapely.constrained_delaunay_triangles(polygons), return_index=True)
    corners = shapely.get_coordinates(pieces, include_z=True).reshape(-1, 4, 3)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=1)
    normal *= (np.sign(normal[:, 2]) / np.maximum(size, 1e-12))[:, None]
    largest = np.lexsort((-size, owner))
    head = largest[np.searchsorted(owner[largest], np.arange(len(polygons)))]
    cosine = (normal * normal[head][owner]).sum(axis=1)
    if np.any(cosine < np.cos(np.radians(MOST_FOLD_DEG))):
        return "a roof face with a fold"
    return ""
