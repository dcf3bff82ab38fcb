"""Roof faces that a person states: polygons in plan with a plane each, laid over the roof of the points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import shapely
from shapely import Polygon

from eaves.figures.attributes import describe_roof, surface_heights
from eaves.geometry.inside import edges_of
from eaves.geometry.planes import median
from eaves.model import BuildingModel, Failure, Points, RoofPlane, Values
from eaves.model.cloud import canonical_order
from eaves.reconstruct.toolkit.ceiling import height_over_points
from eaves.reconstruct.toolkit.evidence import (
    faces_as_planes,
    fit_kernel,
    points_inside,
    seen_roof,
    spacing_on_roof,
)
from eaves.reconstruct.toolkit.levels import coarse_solids
from eaves.reconstruct.toolkit.superstructures import ObjectLimits, find_superstructures
from eaves.solids.cutting import arrange
from eaves.solids.extrude import extrude_plan, without_numbers


@dataclass(frozen=True, eq=False)
class StatedFace:
    """A face of a roof.

    Parameters
    ----------
    polygon : shapely.Polygon
        Its place in plan (m).
    plane : (float, float, float) or None
        Its rise to the east and to the north (m/m), and its height (m) at the polygon's centroid, so that the
        same three numbers hold about any origin; None for the plane of the points in it.
    """

    polygon: Polygon
    plane: tuple[float, float, float] | None = None

    @classmethod
    def of(cls, plane: RoofPlane, origin: tuple[float, float]) -> Self:
        """The face of a model's plane, whose places count from an origin (world metres)."""
        assert plane.polygon is not None
        a, b, c = plane.coefficients
        x, y = shapely.get_coordinates(plane.polygon.centroid)[0]
        return cls(shapely.transform(plane.polygon, lambda xy: xy + origin), (a, b, float(a * x + b * y + c)))

    def about(self, origin: tuple[float, float]) -> StatedFace:
        """The face in metres about an origin (world metres)."""
        return replace(self, polygon=shapely.transform(self.polygon, lambda xy: xy - origin))

    def raised(self, rise: float) -> StatedFace:
        """The face higher by so much (m), where its height is stated."""
        if self.plane is None:
            return self
        a, b, height = self.plane
        return replace(self, plane=(a, b, height + rise))

    @property
    def rise(self) -> Values:
        """The rise (m/m) of the stated plane to the east and to the north (2,)."""
        assert self.plane is not None
        return np.array(self.plane[:2])

    def height_at(self, xy: Values) -> Values:
        """Heights (N,) of the stated plane at places (N, 2)."""
        assert self.plane is not None
        return np.asarray(self.plane[2] + (xy - shapely.get_coordinates(self.polygon.centroid)) @ self.rise)

    def over(self, polygon: Polygon) -> StatedFace:
        """The face of a polygon on the same stated plane."""
        a, b = self.rise.tolist()
        height = self.height_at(shapely.get_coordinates(polygon.centroid))[0]
        return StatedFace(polygon, (a, b, float(height)))

    def coefficients(self, roof: Points, reach: float) -> Values | None:
        """a, b and c (3,) of the plane: as stated, else of least squared distances from roof points (N, 3) in
        the polygon, in the end from those within `reach` (m) of it; None where no point is."""
        if self.plane is not None:
            a, b, _ = self.plane
            return np.array([a, b, self.height_at(np.zeros((1, 2)))[0]])
        inside = roof[points_inside(roof, self.polygon)]
        if not len(inside):
            return None
        plane, owner = np.array([[0.0, 0.0, median(inside[:, 2])]]), np.zeros(len(inside), np.int32)
        for near in (np.inf, reach):
            fit_kernel(inside, owner, plane, near)
        return np.asarray(plane[0])


def lay_faces(
    model: BuildingModel,
    faces: Sequence[StatedFace],
    points: Points,
    ground: float,
    limits: ObjectLimits,
) -> BuildingModel | Failure:
    """The model of a building with stated faces laid over its own, each over those before.

    The roof is a set of planes over polygons that fill the plan: the faces of the model, and those stated.
    Their edges cut the footprint into cells, each has the plane of the last face over it, and they are raised
    like those of every other model; what is not closed is no model.

    Parameters
    ----------
    model : BuildingModel
        The model of the points; one level where it has no planes.
    faces : sequence of StatedFace
        In the model's local metres.
    points : ndarray (N, 3)
        Those of its roof.
    ground : float
        Height (m) of the base.
    limits : ObjectLimits
        Those of a reconstructor.

    Returns
    -------
    BuildingModel or Failure
        A Failure where a face has neither a plane nor points, or the solids are not closed.
    """
    footprint, order = model.footprint, canonical_order(points)
    points = points[order]
    seen = seen_roof(points, footprint)
    if isinstance(seen, Failure):
        return seen
    inside, top = seen
    roof = points[top]
    own = [
        (plane.polygon, np.array(plane.coefficients)) for plane in model.planes if plane.polygon is not None
    ]
    own = own or [(footprint.polygon, np.array([0.0, 0.0, float(model.attributes["h_70p"])]))]
    shapes = [shape for shape, _ in own] + [face.polygon for face in faces]
    fitted = [face.coefficients(roof, limits.residual_limit) for face in faces]
    if any(plane is None for plane in fitted):
        return Failure("too_few_points", "no point lies in a stated roof face", "reconstruct", footprint)
    planes = np.array([*(plane for _, plane in own), *fitted], np.float64)
    first, last, _ = edges_of(shapely.get_parts(shapely.force_2d(shapes)))
    plan = arrange(footprint.polygon, np.hstack([first, last]))
    if plan is None:
        return Failure("no_area", "the footprint encloses no area", "reconstruct", footprint)
    middles = shapely.point_on_surface(plan.polygons())
    labels = shapely.STRtree(shapes[: len(own)]).nearest(middles)
    for number, face in enumerate(faces, len(own)):
        labels = np.where(shapely.contains(face.polygon, middles), number, labels)
    fine = extrude_plan(plan, labels, planes, ground, limits.smallest)
    if not fine.solids:
        return Failure("not_closed", f"the stated roof has {fine.defect}", "reconstruct", footprint)
    solids = coarse_solids(plan, roof, ground, limits.level_jump, limits.smallest)
    laid = replace(
        model, solids={**solids, "2.0": without_numbers(fine.solids), "2.2": fine.solids}, planes=()
    )
    surface = surface_heights(fine.solids, roof[:, :2])
    facts = describe_roof(laid, points[inside], roof, ground, surface)
    spacing = spacing_on_roof(roof, footprint.polygon)
    objects = find_superstructures(fine.solids, roof, surface, footprint.polygon, spacing, limits)
    facts |= {"surfaces": facts["roof_faces"], "installation_count": len(objects), "lod": "2.2"}
    facts["over_points_m"] = round(height_over_points(fine.solids, roof), 2)
    before = {name: value for name, value in model.attributes.items() if not name.startswith("fallback")}
    found = faces_as_planes(laid, planes[fine.labels], points, top, surface)
    back = tuple(replace(plane, members=np.sort(order[plane.members])) for plane in found)
    return laid.with_(planes=back, installations=objects, attributes={**before, **facts})
