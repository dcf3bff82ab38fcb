"""Whether a solid is closed, oriented and planar: the last look before a solid leaves the reconstructor."""

from __future__ import annotations

import numpy as np
import shapely

from eaves.geometry.tolerance import COORDINATE_STEP, PLANARITY
from eaves.model import Solid
from eaves.model.building import WALL_SURFACE

FLATTEST_SHARE = 0.9
"""Share of `PLANARITY` a face may use; the rest is for the rounding of written coordinates."""


def find_defect(solid: Solid) -> str:
    """What is wrong with a solid extruded from a plan, in a few words; empty when it is sound.

    Walls stand on one plan edge each and are planar by construction. What is checked is what rounding and merging of
    heights could break: edges used once each way, roof planes, rings that stay simple, faces with area.
    """
    rings = [ring for face in solid.faces for ring in face.rings]
    sizes = np.array([len(ring) for ring in rings])
    if sizes.min() < 3:
        return "a ring of fewer than three vertices"
    start = np.concatenate([np.asarray(ring) for ring in rings])
    end = np.concatenate([np.roll(np.asarray(ring), -1) for ring in rings])
    count = len(solid.vertices)
    there, back = np.sort(start * count + end), np.sort(end * count + start)
    if np.any(np.diff(there) == 0) or not np.array_equal(there, back):
        return "an edge that is not used once each way"
    for face in solid.faces:
        if face.surface == WALL_SURFACE:
            continue
        if len(face.rings[0]) > 3 and height_error(solid, face.rings) > FLATTEST_SHARE * PLANARITY:
            return "a roof face that is not planar"
    return plan_defect(solid)


def height_error(solid: Solid, rings: tuple[tuple[int, ...], ...]) -> float:
    """Largest distance (m) of the face's vertices from the plane of least squares through them."""
    places = solid.vertices[[vertex for ring in rings for vertex in ring]]
    centred = places - places.mean(axis=0)
    normal = np.linalg.svd(centred, full_matrices=False)[2][2]
    return float(np.abs(centred @ normal).max())


def plan_defect(solid: Solid) -> str:
    """What is wrong with the plan of the roof faces: rings that cross, faces that overlap."""
    shapes = [
        shapely.Polygon(
            solid.vertices[list(face.rings[0]), :2],
            [solid.vertices[list(hole), :2] for hole in face.rings[1:]],
        )
        for face in solid.faces
        if face.surface != WALL_SURFACE
    ]
    polygons = np.array(shapes, object)
    if not shapely.is_valid(polygons).all():
        return "a face whose rings cross"
    areas = shapely.area(polygons)
    if abs(areas[0] - areas[1:].sum()) > COORDINATE_STEP * shapely.length(polygons[0]):
        return "roof faces that do not cover the ground face"
    return ""
