"""Solids whose roofs reach beyond their walls: a plan whose cells stand on the ground or hang as a slab."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from eaves.geometry.face_table import FaceTable
from eaves.geometry.rings import COORDINATE_STEP
from eaves.model import NO_PLANE, ROOF_SURFACE, Integers, Solid
from eaves.solids.coverage import (
    NARROWEST_NECK,
    OUTSIDE,
    OVERSHOOT,
    SMALLEST_PART,
    Coverage,
    coverage_of,
)
from eaves.solids.cutting import cut
from eaves.solids.extrude import LOWEST_ROOF, bodies_kernel, close_cells, split_crossings


@dataclass(frozen=True, eq=False)
class RoofPlan:
    """The roof of one solid in plan: `polygons` (F,) that share their nodes, `planes` (F, 3) over them, the
    `Face.plane` of each and the height of the base (m).
    """

    polygons: NDArray[np.object_]
    planes: NDArray[np.float64]
    numbers: tuple[int | None, ...]
    base: float

    @classmethod
    def of(cls, solid: Solid) -> RoofPlan:
        """The roof faces of a solid that was extruded from a plan."""
        table = FaceTable.of_solids([solid], ROOF_SURFACE)
        corners = np.split(table.corners, table.ring_start[table.outer[1:]])
        planes = solid.planes[solid.surfaces == ROOF_SURFACE].tolist()
        return cls(
            table.polygons(),
            np.array([plane_through(places) for places in corners]),
            tuple(None if plane == NO_PLANE else plane for plane in planes),
            float(solid.vertices[:, 2].min()),
        )

    @property
    def outline(self) -> Polygon:
        """The outline of the roof, without nodes on straight edges."""
        union = shapely.coverage_union_all(self.polygons)
        return shapely.orient_polygons(shapely.simplify(union, 1.5 * COORDINATE_STEP))


def plane_through(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """The plane (3,: a, b, c) of least squares through corners (V, 3)."""
    middle = places.mean(axis=0)
    away = places - middle
    a, b = np.linalg.lstsq(away[:, :2], away[:, 2], rcond=None)[0]
    return np.array([a, b, middle[2] - a * middle[0] - b * middle[1]])


def walls_inside(outline: Polygon, overhangs: Iterable[float]) -> BaseGeometry:
    """The plan of the walls: the outline without a strip along each edge, as wide as its overhang (m).

    `overhangs` follow `outline_edges`. Strips of neighbouring edges meet in a mitre.
    """
    strips, depths = [], iter(overhangs)
    for ring in [outline.exterior, *outline.interiors]:
        places = shapely.get_coordinates(ring)[:-1]
        depth = np.array([next(depths) for _ in places])
        strips += ring_strips(places, depth)
    cut = shapely.union_all(np.array(strips, object), grid_size=COORDINATE_STEP) if strips else Polygon()
    return shapely.difference(outline, cut, grid_size=COORDINATE_STEP)


def ring_strips(places: NDArray[np.float64], depth: NDArray[np.float64]) -> list[BaseGeometry]:
    """The strips along the edges of a ring (M, 2), to the left of each, as wide as `depth` (M,; m) says."""
    step = np.roll(places, -1, axis=0) - places
    along = step / np.hypot(step[:, 0], step[:, 1])[:, None]
    inward = np.column_stack([-along[:, 1], along[:, 0]])
    strips = []
    for edge in np.flatnonzero(depth > 0.0).tolist():
        before, after = (edge - 1) % len(places), (edge + 1) % len(places)
        start, end = places[edge], places[after]
        first = mitred(start, inward[before], depth[before], inward[edge], depth[edge])
        last = mitred(end, inward[edge], depth[edge], inward[after], depth[after])
        strip = Polygon([start, end, last, first])
        strips.append(strip if strip.is_valid else strip.convex_hull)
    return strips


def mitred(
    corner: NDArray[np.float64],
    first: NDArray[np.float64],
    by_first: float,
    second: NDArray[np.float64],
    by_second: float,
) -> NDArray[np.float64]:
    """Point where the two edges that meet in a corner meet when each is moved along its normal."""
    turn = first[0] * second[1] - first[1] * second[0]
    farthest = 3.0 * max(by_first, by_second)
    if abs(turn) > 1e-3:
        x = (by_first * second[1] - by_second * first[1]) / turn
        y = (by_second * first[0] - by_first * second[0]) / turn
        if np.hypot(x, y) <= farthest:
            return np.asarray(corner + [x, y])
    return np.asarray(corner + max(by_first, by_second) * 0.5 * (first + second))


def build_overhanging(
    roof: RoofPlan, walls: BaseGeometry, thickness: float
) -> tuple[tuple[Solid, ...], NDArray[np.float64]]:
    """The solids under a roof whose walls enclose `walls`, and the places (K, 2) where they touch themselves.

    Inside the walls the building stands on its base; outside them the roof is a slab of the `thickness` (m,
    upright). No solids when the plan cannot be drawn.
    """
    drawn = draw_plan(roof, walls, thickness)
    if drawn is None:
        return (), np.zeros((0, 2))
    plan, face, stands = drawn
    floors = np.where(
        stands[:, None], np.array([0.0, 0.0, roof.base]), roof.planes[face] - np.array([0.0, 0.0, thickness])
    )
    return close_slabs(plan, roof, face, stands, floors)


def close_slabs(
    plan: Coverage, roof: RoofPlan, face: Integers, stands: NDArray[np.bool_], floors: NDArray[np.float64]
) -> tuple[tuple[Solid, ...], NDArray[np.float64]]:
    """The solids between the planes `floors` (C, 3) of the cells and the roof over them, `face` (C,), and the
    places (K, 2) where they touch themselves, or nearly; those that `stand` (C,) do so on the ground.
    """
    tops = roof.planes[face]
    plan = split_crossings(plan, tops, floors)
    solids, touching = close_cells(plan, tops, floors, stands, face, roof.numbers)
    return tuple(solids), np.concatenate([plan.nodes[plan.start[plan.length < OVERSHOOT]], touching])


def draw_plan(
    roof: RoofPlan, walls: BaseGeometry, thickness: float
) -> tuple[Coverage, Integers, NDArray[np.bool_]] | None:
    """The cells (C,) that the walls cut the roof faces into, the face of each, whether it stands on the
    ground.
    """
    faces = coverage_of(roof.polygons, COORDINATE_STEP)
    plan = None if faces is None else cut(faces, wall_segments(walls, shapely.boundary(roof.polygons)))
    if plan is None:
        return None
    cells = plan.polygons()
    middles = shapely.point_on_surface(cells)
    face = shapely.STRtree(roof.polygons).nearest(middles)
    stands = shapely.within(middles, walls)
    a, b, c = roof.planes[face].T
    low = [
        float((a[k] * xy[:, 0] + b[k] * xy[:, 1] + c[k]).min())
        for k, xy in enumerate(map(shapely.get_coordinates, cells))
    ]
    stands |= np.array(low) - thickness < roof.base + LOWEST_ROOF
    width = 2.0 * shapely.area(cells) / shapely.length(cells)
    small = (shapely.area(cells) < SMALLEST_PART) | (width < NARROWEST_NECK)
    stands = give_to_other_side(plan, face, stands, small)
    stands |= hanging_alone(plan, roof, face, stands, thickness)
    plan, label = plan.merged(2 * face + stands)
    return plan, label // 2, (label % 2).astype(bool)


def wall_segments(walls: BaseGeometry, borders: NDArray[np.object_]) -> NDArray[np.float64]:
    """The edges (S, 4) of the walls, their corners moved to the nodes and `borders` of the roof they nearly
    touch: where both eaves reach as far, the corner lies under the hip.
    """
    rings = shapely.get_rings(shapely.get_parts(walls))
    if len(rings) == 0:
        return np.zeros((0, 4))
    places, ring = shapely.get_coordinates(rings, return_index=True)
    lines = shapely.union_all(borders)
    for goal in (lines, shapely.multipoints(shapely.get_coordinates(borders))):
        nearest = shapely.shortest_line(shapely.points(places), goal)
        close = shapely.length(nearest) < NARROWEST_NECK
        places[close] = shapely.get_coordinates(shapely.get_point(nearest[close], 1))
    goes_on = (ring[:-1] == ring[1:]) & (places[:-1] != places[1:]).any(axis=1)
    return np.asarray(np.column_stack([places[:-1], places[1:]])[goes_on])


def give_to_other_side(
    plan: Coverage, face: Integers, stands: NDArray[np.bool_], small: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Mask (C,) of the cells that stand on the ground if small ones do as their larger neighbours of a
    face."""
    stands = stands.copy()
    inner = (plan.cell != OUTSIDE) & (plan.cell[plan.twin] != OUTSIDE)
    inner_cell, outer_cell = plan.cell[inner], plan.cell[plan.twin][inner]
    for cell in np.flatnonzero(small).tolist():
        candidates = outer_cell[(inner_cell == cell) & (face[outer_cell] == face[cell]) & ~small[outer_cell]]
        if len(candidates) == 0:
            candidates = outer_cell[inner_cell == cell]
        if len(candidates):
            stands[cell] = stands[candidates[np.argmax(plan.area[candidates])]]
    return stands


def hanging_alone(
    plan: Coverage, roof: RoofPlan, face: Integers, stands: NDArray[np.bool_], thickness: float
) -> NDArray[np.bool_]:
    """The cells (C,) whose slab would touch no part that stands; none where nothing stands at all."""
    alone = np.zeros(plan.count, bool)
    if not stands.any():
        return alone
    floors = np.where(
        stands[:, None], np.array([0.0, 0.0, roof.base]), roof.planes[face] - np.array([0.0, 0.0, thickness])
    )
    half_edges = (plan.nodes, plan.start, plan.end, plan.cell, plan.twin)
    group = bodies_kernel(*half_edges, roof.planes[face], floors)
    supported = np.zeros(int(group.max(initial=-1)) + 1, bool)
    supported[group[stands]] = True
    return np.asarray(~supported[group])
