"""Polyhedra of intersected roof planes: after Xiao 2014, and Maas and Vosselman 1999, second algorithm."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from eaves.figures.attributes import describe_roof
from eaves.geometry.neighbours import measure_spacing
from eaves.methods import Emit, ignore, parameter
from eaves.model import BuildingModel, Failure, Footprint, Integers, Labels, Points, RoofPlane
from eaves.reconstruct.toolkit.evidence import faces_as_planes, seen_roof, support_of
from eaves.reconstruct.toolkit.levels import coarse_solids
from eaves.reconstruct.toolkit.plan_lines import LineReconstructor, candidate_lines, extend
from eaves.solids.coverage import Coverage
from eaves.solids.cutting import arrange
from eaves.solids.extrude import extrude_plan


class PlaneIntersection(LineReconstructor):
    """The polyhedron that adjacent roof planes and the outline cut out.

    Planes whose points are neighbours are intersected where their heights agree; that line is a ridge, a
    valley or a hip. Where heights jump, the border between the points is replaced by lines along the main
    directions. Both, with the regular outline, divide the footprint; every division takes the plane that
    most of its points belong to, and one without points the plane of the neighbour it shares its longest
    border with. Walls close the polyhedron.

    Formula
    -------
    a₁x + b₁y + c₁ = a₂x + b₂y + c₂ for adjacent planes; the plane of a division is argmax_p |points of p
    in it|.

    Fidelity
    --------
    [xiao2014] intersects planes with each other and combines them with the outline into key vertices and
    segments; [maas_vosselman1999] intersects adjacent faces where the roof is continuous, takes outlines
    at height jumps from the main directions, and closes a polyhedron. Neither prints a tolerance. The
    vote for the plane of a division, and the divisions themselves as an arrangement of lines, are ours.

    Fails where
    -----------
    A plane that was not found leaves its points to a wrong neighbour; nothing weighs a border against the
    points, so noise in the segmentation becomes faces. A plane goes on where no point is:
    `over_points_m` says how far it rises over all of them. Codes: `too_few_points`, `no_plane`, `no_area`,
    `not_closed`.

    Complexity
    ----------
    O(N log N) in points, and the arrangement of the lines.

    References
    ----------
    [xiao2014], section 5; [maas_vosselman1999], section 4.
    """

    name: ClassVar[str] = "plane_intersection"
    idea: ClassVar[str] = "Adjacent planes intersected, jumps along the main directions, divisions by vote."
    paper: ClassVar[str] = "xiao2014"

    smallest: float = parameter(0.5, "Area of the smallest roof face.", unit="m2", ge=0.0)

    def model(
        self,
        points: Points,
        footprint: Footprint,
        planes: list[RoofPlane],
        ground: float,
        emit: Emit = ignore,
    ) -> BuildingModel | Failure:
        """The polyhedron of one building from its points (N, 3) and roof planes."""
        seen_points = seen_roof(points, footprint)
        if isinstance(seen_points, Failure):
            return seen_points
        top = seen_points[1]
        roof = points[top]
        if not planes:
            return Failure("no_plane", "no roof plane was found among the points", "reconstruct", footprint)
        spacing = measure_spacing(roof)
        labels, coefficients = support_of(points, top, planes, spacing, ground, self)
        lines = candidate_lines(roof, labels, coefficients, footprint.polygon, spacing, self)
        emit("lines", extend(lines, footprint.polygon, self.extension))
        plan = arrange(footprint.polygon, extend(lines, footprint.polygon, self.extension))
        if plan is None:
            return Failure(
                "no_area", "the footprint encloses no area wider than 3 cm", "reconstruct", footprint
            )
        plan, chosen = plan.merged(vote(plan, roof, labels, len(coefficients)))
        emit("plan", plan.polygons())
        return raise_polyhedron(plan, chosen, coefficients, points, seen_points, footprint, ground, self)


def raise_polyhedron(
    plan: Coverage,
    chosen: Integers,
    planes: NDArray[np.float64],
    points: Points,
    seen_points: tuple[NDArray[np.int64], NDArray[np.int64]],
    footprint: Footprint,
    ground: float,
    limits: PlaneIntersection,
) -> BuildingModel | Failure:
    """The model over a plan whose cells carry the `chosen` (C,) of the planes (P, 3); `seen_points`
    are the numbers of the points (N, 3) inside the footprint and on the roof."""
    inside, top = seen_points
    fine = extrude_plan(plan, chosen, planes, ground, limits.smallest)
    if not fine.solids:
        return Failure("not_closed", f"the polyhedron has {fine.defect}", "reconstruct", footprint)
    solids = coarse_solids(plan, points[top], ground, limits.level_jump, limits.smallest)
    model = BuildingModel(footprint, {**solids, "2.2": fine.solids})
    model = model.with_(planes=faces_as_planes(model, planes[fine.labels], points, top))
    return model.with_(attributes=describe_roof(model, points[inside], points[top], ground))


def vote(plan: Coverage, roof: Points, labels: Labels, count: int) -> Integers:
    """The plane (C,) most of each cell's roof points (N, 3) belong to; empty cells take their neighbour's."""
    point, cell = plan.cells_of(roof)
    labelled = labels[point] >= 0
    votes = np.zeros((plan.count, count), np.int64)
    np.add.at(votes, (cell[labelled], labels[point[labelled]]), 1)
    plane = np.where(votes.any(axis=1), votes.argmax(axis=1), -1)
    halves = np.flatnonzero((plan.cell >= 0) & (plan.cell[plan.twin] >= 0))
    halves = halves[np.argsort(-plan.length[halves], kind="stable")]
    for _ in range(plan.count):
        here, across = plane[plan.cell[halves]], plane[plan.cell[plan.twin[halves]]]
        open_halves = halves[(here < 0) & (across >= 0)]
        if len(open_halves) == 0:
            break
        first = open_halves[0]
        plane[plan.cell[first]] = plane[plan.cell[plan.twin[first]]]
    return np.asarray(np.where(plane < 0, count - 1, plane), np.int64)
