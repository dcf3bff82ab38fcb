"""Both algorithms of one paper on the primitives of a ground plan [maas_vosselman1999]."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString, Polygon
from shapely.geometry.polygon import orient
from shapely.ops import split

from eaves.geometry.neighbours import measure_spacing
from eaves.geometry.rings import COORDINATE_STEP
from eaves.methods import Emit, ignore, parameter
from eaves.model import BuildingModel, Failure, Footprint, Integers, Labels, Points, RoofPlane
from eaves.published.maas_vosselman.moments import Moments
from eaves.published.maas_vosselman.moments.building import ParametricBuilding, rectangle_around
from eaves.published.maas_vosselman.moments.method import (
    PRIMITIVES,
    RoofPart,
    find_parts,
    house_segments,
    measures,
    name_cells,
    place_of,
    rectangle_of,
    to_world,
    to_world_plane,
)
from eaves.published.xiao2014.plane_intersection import PlaneIntersection, raise_polyhedron, vote
from eaves.reconstruct.stage import Reconstructor
from eaves.reconstruct.toolkit.evidence import points_inside, seen_roof, support_of
from eaves.reconstruct.toolkit.plan_lines import candidate_lines, extend
from eaves.solids.coverage import OVERSHOOT, Coverage
from eaves.solids.cutting import arrange


@dataclass(frozen=True, eq=False)
class Primitive:
    """A piece of the ground plan, and its house with dormers where it is a standard one."""

    piece: Polygon
    house: ParametricBuilding | None
    parts: list[RoofPart]

    def row(self, number: int, footprint: Footprint) -> dict[str, Any]:
        """Its row of the table `primitives`: the parameters of a house, or where its piece lies."""
        if self.house is not None:
            return {
                "primitive": number,
                "made_by": Moments.name,
                **measures(self.house, self.parts, footprint.origin),
            }
        axes = "plan" if footprint.agreement is None else "outline"
        place = place_of(rectangle_around(self.piece), footprint.origin)
        return {"primitive": number, "made_by": PlaneIntersection.name, "house_axes": axes, **place}


class MaasVosselman(Reconstructor):
    """A building from its ground plan: standard houses from moments, other roofs from intersected faces.

    The ground plan is cut into primitives that nearly fill their rectangles. The moments of the points over
    each give a flat, shed, gable, hip, half-hip or pyramid roof in closed form, which one least-squares fit
    settles; residuals over 2 m² become dormers. Where a primitive is none of these, or its points leave the
    roof, its planar faces are intersected instead. Creases, dormers, intersections and cuts divide the ground
    plan together, and walls close one solid.

    Formula
    -------
    Of `moments` and `plane_intersection`; a primitive fills area(piece) / area(its least rectangle).

    Fidelity
    --------
    [maas_vosselman1999] has both algorithms, for standard gable houses and for polyhedral buildings, says
    that a ground plan may be given, and takes one building after the other. Cutting the plan, the choice
    between the two by cover and residuals, and one plan for both are ours. The cover is measured against the
    area of the plan itself, not of its rectangle. No tolerance is printed. `houses` says whether the closed
    solution stands or starts a fit, and whether axes and sizes are those of a given plan; without one they
    are those of the moments. Walls are the plan's, given or drawn.

    Fails where
    -----------
    Nothing holds neighbouring primitives to one ridge; a plan off its building shifts every roof on it. Codes
    are those of `plane_intersection`.

    Complexity
    ----------
    Of the two algorithms, and the number of reflex corners of the plan squared.

    References
    ----------
    [maas_vosselman1999], sections 3 and 4.
    """

    name: ClassVar[str] = "maas_vosselman"
    idea: ClassVar[str] = "The plan cut into rectangles, moments for each, intersected faces where they fail."
    paper: ClassVar[str] = "maas_vosselman1999"

    least_fill: float = parameter(
        0.9, "Share of its rectangle that a primitive fills; others are cut further.", gt=0.0, le=1.0
    )
    smallest_primitive: float = parameter(6.0, "Area of the smallest primitive.", unit="m2", gt=0.0)
    houses: Moments = parameter(
        Moments(ground_plan=True), "Method that models a primitive as a standard house.", unit="method"
    )
    faces: PlaneIntersection = parameter(
        PlaneIntersection(), "Method that models the others, by their planar faces.", unit="method"
    )

    def model(
        self,
        points: Points,
        footprint: Footprint,
        planes: list[RoofPlane],
        ground: float,
        emit: Emit = ignore,
    ) -> BuildingModel | Failure:
        """The building from its points (N, 3), ground plan and roof planes."""
        seen_points = seen_roof(points, footprint)
        if isinstance(seen_points, Failure):
            return seen_points
        roof = points[seen_points[1]]
        pieces, cuts = cut_plan(footprint.polygon, self.least_fill, self.smallest_primitive)
        given = footprint.agreement is None
        primitives = [self.shape(piece, roof, given) for piece in pieces]
        emit("primitives", pieces)
        houses = [(part.house, part.parts) for part in primitives if part.house is not None]
        emit("moments", [rectangle_of(house) for house, _ in houses])
        emit("dormers", [rectangle_of(house, part.edges) for house, parts in houses for part in parts])
        rows = [one.row(number, footprint) for number, one in enumerate(primitives, 1)]
        facts = {"primitives": len(primitives), "primitives_by_moments": len(houses), PRIMITIVES: rows}
        if houses:
            joint = self.join(primitives, cuts, points, seen_points, footprint, planes, ground, emit)
            if joint is not None:
                if len(primitives) == 1:
                    facts |= measures(*houses[0], footprint.origin)
                return joint.with_(attributes={**joint.attributes, **facts})
        rows = [replace(one, house=None).row(number, footprint) for number, one in enumerate(primitives, 1)]
        facts |= {"primitives_by_moments": 0, PRIMITIVES: rows}
        model = self.faces.model(points, footprint, planes, ground, emit)
        return model if isinstance(model, Failure) else model.with_(attributes={**model.attributes, **facts})

    def shape(self, piece: Polygon, roof: Points, given: bool) -> Primitive:
        """The house over a piece of a plan, `given` or drawn, among all roof points (N, 3), if it is a
        standard one."""
        members = roof[points_inside(roof, piece)]
        house = self.houses.house_of(members, piece, given)
        if isinstance(house, Failure):
            return Primitive(piece, None, [])
        covered = (1.0 - house.empty_share) * house.length * house.width
        along, across = house.fit.axes(shapely.get_coordinates(piece))
        edges = (along.min(), along.max(), across.min(), across.max())  # the walls are the plan's
        house = replace(house, edges=edges, empty_share=1.0 - covered / piece.area)
        parts = find_parts(house, members, self.houses)
        if self.houses.doubt(house, parts, members):
            return Primitive(piece, None, [])
        return Primitive(piece, house, parts)

    def join(
        self,
        primitives: list[Primitive],
        cuts: NDArray[np.float64],
        points: Points,
        seen_points: tuple[NDArray[np.int64], NDArray[np.int64]],
        footprint: Footprint,
        planes: list[RoofPlane],
        ground: float,
        emit: Emit,
    ) -> BuildingModel | None:
        """One solid over all primitives; None when it is not sound, or faces are wanted and none is there."""
        roof, top = points[seen_points[1]], seen_points[1]
        spacing = measure_spacing(roof)
        polyhedral = [primitive.piece for primitive in primitives if primitive.house is None]
        if polyhedral and not planes:
            return None
        labels, faces = np.full(len(roof), -1, np.int32), np.zeros((0, 3))
        lines = [cuts]
        if polyhedral:
            labels, faces = support_of(points, top, planes, spacing, ground, self.faces)
            candidates = candidate_lines(roof, labels, faces, footprint.polygon, spacing, self.faces)
            lines += [
                inside(extend(candidates, footprint.polygon, self.faces.extension), piece)
                for piece in polyhedral
            ]
        for primitive in primitives:
            if primitive.house is not None:
                segments = house_segments(primitive.house, primitive.parts)
                world = to_world(primitive.house, segments.reshape(-1, 2)).reshape(-1, 4)
                lines.append(inside(world, primitive.piece))
        emit("lines", np.vstack(lines))
        plan = arrange(footprint.polygon, np.vstack(lines))
        if plan is None:
            return None
        chosen, coefficients = label_plan_cells(plan, primitives, roof, labels, faces)
        plan, chosen = plan.merged(chosen)
        model = raise_polyhedron(
            plan, chosen, coefficients, points, seen_points, footprint, ground, self.faces
        )
        return None if isinstance(model, Failure) else model


def inside(segments: NDArray[np.float64], piece: Polygon) -> NDArray[np.float64]:
    """The parts of segments (S, 4) in a piece or just past its border, (T, 4)."""
    if len(segments) == 0:
        return np.zeros((0, 4))
    clipped = shapely.intersection(
        shapely.linestrings(segments.reshape(-1, 2, 2)), shapely.buffer(piece, OVERSHOOT, join_style="mitre")
    )
    parts = shapely.get_parts(clipped)
    parts = parts[shapely.get_type_id(parts) == shapely.GeometryType.LINESTRING]
    ends = [shapely.get_coordinates(part)[[0, -1]].ravel() for part in parts if not part.is_empty]
    return np.array(ends, np.float64).reshape(-1, 4)


def label_plan_cells(
    plan: Coverage, primitives: list[Primitive], roof: Points, labels: Labels, faces: NDArray[np.float64]
) -> tuple[Integers, NDArray[np.float64]]:
    """The plane of each cell (C,), and all planes (P, 3): those of the faces, then of each house."""
    place = shapely.point_on_surface(plan.polygons())
    chosen = vote(plan, roof, labels, len(faces)) if len(faces) else np.zeros(plan.count, np.int64)
    everywhere = [faces]
    first = len(faces)
    distance = np.array([shapely.distance(place, primitive.piece) for primitive in primitives])
    owner = distance.argmin(axis=0)
    for number, primitive in enumerate(primitives):
        if primitive.house is None:
            continue
        cells = np.flatnonzero(owner == number)
        label, planes = name_cells(primitive.house, primitive.parts, shapely.get_coordinates(place[cells]))
        chosen[cells] = label + first
        everywhere.append(np.array([to_world_plane(primitive.house, plane) for plane in planes]))
        first += len(planes)
    return chosen, np.vstack(everywhere)


JOG = 0.25
"""A corner that a line simplified by this (m) leaves out starts no cut."""
GAIN = 0.01
"""A cut must fill the rectangles better by this share of the area."""
MOST_PIECES = 12
"""A plan of more pieces is no set of standard houses."""


def cut_plan(plan: Polygon, least_fill: float, smallest: float) -> tuple[list[Polygon], NDArray[np.float64]]:
    """The primitives of a plan, and the cuts (S, 4) between them.

    While a piece fills less than `least_fill` of its least rectangle it is cut from a reflex corner along
    one of the corner's two sides, where both halves together fill their boxes best. Pieces under `smallest`
    (m²) are not cut off. The answer does not depend on where the ring starts."""
    open_: list[Polygon] = [plan]
    pieces: list[Polygon] = []
    cuts: list[tuple[float, float, float, float]] = []
    while open_:
        piece = open_.pop()
        room = len(open_) + len(pieces) + 2 <= MOST_PIECES
        best = best_cut(piece, smallest) if room and fill_of(piece) < least_fill else None
        if best is None:
            pieces.append(piece)
            continue
        cuts.append(best[0])
        open_ += best[1]
    order = np.lexsort(np.array([[piece.centroid.y, piece.centroid.x] for piece in pieces]).T)
    return [pieces[k] for k in order], np.array(cuts, np.float64).reshape(-1, 4)


def fill_of(piece: Polygon) -> float:
    """Share of its least rectangle that a piece fills."""
    return float(piece.area / max(shapely.minimum_rotated_rectangle(piece).area, 1e-9))


def best_cut(
    piece: Polygon, smallest: float
) -> tuple[tuple[float, float, float, float], list[Polygon]] | None:
    """The cut after which both halves fill their rectangles best, and the halves; None when none gains."""
    best, cut = fill_of(piece) + GAIN, None
    for line in cuts_of(piece):
        halves = [part for part in split(piece, line).geoms if part.geom_type == "Polygon"]
        if len(halves) != 2 or min(half.area for half in halves) < smallest:
            continue
        fill = sum(half.area * fill_of(half) for half in halves) / piece.area
        if fill > best + 1e-9:
            (x1, y1), (x2, y2) = line.coords
            best, cut = fill, ((x1, y1, x2, y2), halves)
    return cut


def cuts_of(piece: Polygon) -> list[LineString]:
    """From each reflex corner the lines along its two sides to the first border they meet."""
    ring = shapely.get_coordinates(orient(shapely.simplify(piece, JOG)).exterior)[:-1]
    corners = {tuple(place) for place in shapely.get_coordinates(piece.exterior)}
    before, after = ring - np.roll(ring, 1, 0), np.roll(ring, -1, 0) - ring
    reflex = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0] < -1e-6
    border, lines = piece.boundary, []
    far = float(np.hypot(*np.ptp(ring, axis=0)))
    for corner, back, ahead in zip(ring[reflex], before[reflex], -after[reflex], strict=True):
        if tuple(corner) not in corners:
            continue
        for way in (back, ahead):
            step = way / max(float(np.hypot(*way)), 1e-9)
            ray = LineString([corner + COORDINATE_STEP * step, corner + far * step])
            meets = shapely.get_coordinates(shapely.intersection(ray, border))
            aligned = np.abs((ring - corner) @ [-step[1], step[0]]) < OVERSHOOT
            aligned &= (ring - corner) @ step > OVERSHOOT
            meets = np.vstack([meets, ring[aligned]])
            if len(meets) and piece.contains(shapely.Point(corner + 2.0 * COORDINATE_STEP * step)):
                away = float(np.min((meets - corner) @ step))
                lines.append(
                    LineString([corner - COORDINATE_STEP * step, corner + (away + COORDINATE_STEP) * step])
                )
    return lines
