"""Solids whose roofs reach beyond their walls: a plan whose cells stand on the ground or hang as a slab."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from eaves.geometry.components import connected_groups_kernel
from eaves.geometry.tolerance import COORDINATE_STEP
from eaves.model import Face, Solid
from eaves.model.building import GROUND_SURFACE, OUTER_CEILING_SURFACE, ROOF_SURFACE, WALL_SURFACE
from eaves.reconstruct.toolkit.coverage import (
    NARROWEST_NECK,
    SMALLEST_PART,
    Coverage,
    coverage_of,
    through_corners,
)
from eaves.reconstruct.toolkit.evidence import LOWEST_ROOF
from eaves.reconstruct.toolkit.extrude import SAME_HEIGHT
from eaves.reconstruct.toolkit.half_edges import MOST_ROUNDS, OUTSIDE, Integers
from eaves.reconstruct.toolkit.plan_lines import OVERSHOOT


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
        faces = [face for face in solid.faces if face.surface == ROOF_SURFACE]
        rings = [[solid.vertices[list(ring)] for ring in face.rings] for face in faces]
        polygons = [Polygon(own[0][:, :2], [hole[:, :2] for hole in own[1:]]) for own in rings]
        planes = [plane_through(np.concatenate(own)) for own in rings]
        return cls(
            np.array(polygons, object),
            np.array(planes),
            tuple(face.plane for face in faces),
            float(solid.vertices[:, 2].min()),
        )

    @property
    def outline(self) -> Polygon:
        """The outline of the roof, without nodes on straight edges."""
        whole = shapely.coverage_union_all(self.polygons)
        return shapely.orient_polygons(shapely.simplify(whole, 1.5 * COORDINATE_STEP))


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
    strips, left = [], iter(overhangs)
    for ring in [outline.exterior, *outline.interiors]:
        places = shapely.get_coordinates(ring)[:-1]
        depth = np.array([next(left) for _ in places])
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
    one: NDArray[np.float64],
    by_one: float,
    other: NDArray[np.float64],
    by_other: float,
) -> NDArray[np.float64]:
    """Where the two edges that meet in a corner meet when each is moved along its normal."""
    turn = one[0] * other[1] - one[1] * other[0]
    farthest = 3.0 * max(by_one, by_other)
    if abs(turn) > 1e-3:
        x = (by_one * other[1] - by_other * one[1]) / turn
        y = (by_other * one[0] - by_one * other[0]) / turn
        if np.hypot(x, y) <= farthest:
            return np.asarray(corner + [x, y])
    return np.asarray(corner + max(by_one, by_other) * 0.5 * (one + other))


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
    for _ in range(MOST_ROUNDS):
        halves, places = crossings(plan, roof.planes[face], floors)
        if len(halves) == 0:
            break
        plan = plan.split(halves, places)
    group = joined_cells(plan, roof.planes[face], floors)
    solids, touching = [], [plan.nodes[plan.start[plan.length < OVERSHOOT]]]
    for number in range(int(group.max(initial=-1)) + 1):
        built, places = close_slab(plan, group == number, roof, face, stands, floors)
        solids.append(built)
        touching.append(places)
    return tuple(solids), np.concatenate([np.zeros((0, 2)), *touching])


def draw_plan(
    roof: RoofPlan, walls: BaseGeometry, thickness: float
) -> tuple[Coverage, Integers, NDArray[np.bool_]] | None:
    """The cells (C,) that the walls cut the roof faces into, the face of each, whether it stands on the
    ground.
    """
    borders = shapely.boundary(roof.polygons)
    inner = through_corners(wall_segments(walls, borders), shapely.get_coordinates(borders))
    cells, face = underside_cells(roof.polygons, np.append(borders, inner))
    plan = coverage_of(cells, COORDINATE_STEP)
    if plan is None:
        return None
    stands = shapely.within(shapely.point_on_surface(cells), walls)
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


def underside_cells(
    polygons: NDArray[np.object_], lines: NDArray[np.object_]
) -> tuple[NDArray[np.object_], Integers]:
    """The cells (C,) that lines cut polygons into, on the grid of coordinates, and the polygon of each."""
    net = shapely.union_all(lines, grid_size=COORDINATE_STEP)
    cells = shapely.get_parts(shapely.polygonize(shapely.get_parts(net)))
    cell, owner = shapely.STRtree(polygons).query(shapely.point_on_surface(cells), predicate="within")
    return cells[cell], owner


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
        near = shapely.length(nearest) < NARROWEST_NECK
        places[near] = shapely.get_coordinates(shapely.get_point(nearest[near], 1))
    goes_on = (ring[:-1] == ring[1:]) & (places[:-1] != places[1:]).any(axis=1)
    return np.asarray(np.column_stack([places[:-1], places[1:]])[goes_on])


def give_to_other_side(
    plan: Coverage, face: Integers, stands: NDArray[np.bool_], small: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Which cells (C,) stand on the ground when small ones do as their larger neighbours of one face do."""
    stands = stands.copy()
    inner = (plan.cell != OUTSIDE) & (plan.cell[plan.twin] != OUTSIDE)
    one, other = plan.cell[inner], plan.cell[plan.twin][inner]
    for cell in np.flatnonzero(small).tolist():
        near = other[(one == cell) & (face[other] == face[cell]) & ~small[other]]
        if len(near) == 0:
            near = other[one == cell]
        if len(near):
            stands[cell] = stands[near[np.argmax(plan.area[near])]]
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
    group = joined_cells(plan, roof.planes[face], floors)
    held = np.zeros(int(group.max(initial=-1)) + 1, bool)
    held[group[stands]] = True
    return np.asarray(~held[group])


def segment_ends(plan: Coverage, halves: Integers, planes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Heights (H, 2) of planes (H, 3) over start and end of half-edges (H,)."""
    places = np.stack([plan.nodes[plan.start[halves]], plan.nodes[plan.end[halves]]], axis=1)
    return np.asarray(
        planes[:, None, 0] * places[..., 0] + planes[:, None, 1] * places[..., 1] + planes[:, None, 2]
    )


def inner_halves(plan: Coverage) -> Integers:
    """One half of every edge between two cells."""
    return np.flatnonzero((plan.cell > plan.cell[plan.twin]) & (plan.cell[plan.twin] >= 0))


def joined_cells(plan: Coverage, tops: NDArray[np.float64], floors: NDArray[np.float64]) -> Integers:
    """The number (C,) of the body each cell belongs to: neighbours whose heights overlap along an edge."""
    halves = inner_halves(plan)
    one, other = plan.cell[halves], plan.cell[plan.twin[halves]]
    top = np.minimum(segment_ends(plan, halves, tops[one]), segment_ends(plan, halves, tops[other]))
    floor = np.maximum(segment_ends(plan, halves, floors[one]), segment_ends(plan, halves, floors[other]))
    joined = (top - floor).max(axis=1) > 2.0 * SAME_HEIGHT
    return np.asarray(connected_groups_kernel(one[joined], other[joined], plan.count))


def crossings(
    plan: Coverage, tops: NDArray[np.float64], floors: NDArray[np.float64]
) -> tuple[Integers, NDArray[np.float64]]:
    """Half-edges (K,) along which a roof or underside of one cell crosses one of the other, and the first
    place (K, 2) on each.
    """
    halves = inner_halves(plan)
    one, other = plan.cell[halves], plan.cell[plan.twin[halves]]
    start, end = plan.nodes[plan.start[halves]], plan.nodes[plan.end[halves]]
    share = np.full(len(halves), np.inf)
    for left in (tops, floors):
        for right in (tops, floors):
            step = segment_ends(plan, halves, left[one]) - segment_ends(plan, halves, right[other])
            crosses = (step[:, 0] * step[:, 1] < 0.0) & (np.abs(step).min(axis=1) > SAME_HEIGHT)
            at = step[:, 0] / np.where(crosses, step[:, 0] - step[:, 1], 1.0)
            share = np.where(crosses, np.minimum(share, at), share)
    found = np.isfinite(share)
    places = start[found] + share[found, None] * (end - start)[found]
    places = np.round(np.round(places / COORDINATE_STEP) * COORDINATE_STEP, 6)
    clear = np.minimum(np.hypot(*(places - start[found]).T), np.hypot(*(places - end[found]).T))
    wide = clear > 1.5 * COORDINATE_STEP
    return halves[found][wide], places[wide]


Span = tuple[int, int]
"""Numbers of the lowest and the highest vertex of a cell over a node."""


class Stacks:
    """Vertices over the nodes of a plan: one for each group of nearly equal heights."""

    def __init__(self) -> None:
        self.wanted: dict[int, list[float]] = defaultdict(list)
        self.number: dict[tuple[int, float], int] = {}
        self.vertices: list[tuple[float, float, float]] = []

    def close(self, nodes: NDArray[np.float64]) -> None:
        """Give numbers, from low to high over each node."""
        for node, heights in sorted(self.wanted.items()):
            ordered = sorted(set(heights))
            groups = [[ordered[0]]]
            for height in ordered[1:]:
                if height - groups[-1][-1] > SAME_HEIGHT:
                    groups.append([])
                groups[-1].append(height)
            for group in groups:
                middle = 0.5 * (group[0] + group[-1])
                for height in group:
                    self.number[node, height] = len(self.vertices)
                middle = round(round(middle / COORDINATE_STEP) * COORDINATE_STEP, 6)
                self.vertices.append((float(nodes[node, 0]), float(nodes[node, 1]), middle))


def close_slab(
    plan: Coverage,
    subset: NDArray[np.bool_],
    roof: RoofPlan,
    face: Integers,
    stands: NDArray[np.bool_],
    floors: NDArray[np.float64],
) -> tuple[Solid, NDArray[np.float64]]:
    """The solid of the cells (C,) that are in `subset`, each between its plane of `floors` and its roof, and
    the places (K, 2) where it touches itself along an upright edge."""
    stacks = Stacks()

    def height(node: int, plane: NDArray[np.float64]) -> float:
        x, y = plan.nodes[node]
        return float(plane[0] * x + plane[1] * y + plane[2])

    spans: dict[tuple[int, int], tuple[float, float]] = {}
    for half in range(len(plan.start)):
        cell = int(plan.cell[half])
        if cell == OUTSIDE or not subset[cell]:
            continue
        for node in (int(plan.start[half]), int(plan.end[half])):
            if (cell, node) not in spans:
                spans[cell, node] = height(node, floors[cell]), height(node, roof.planes[face[cell]])
                stacks.wanted[node] += spans[cell, node]
    stacks.close(plan.nodes)

    def span(cell: int, node: int) -> Span:
        """Numbers of the vertices of a cell's floor and top over a node."""
        low, high = spans[cell, node]
        return stacks.number[node, low], stacks.number[node, high]

    def over(cell: int, start: int, end: int) -> tuple[Span, Span] | None:
        """The same over both ends of an edge; None where the cell is not of the solid."""
        if cell == OUTSIDE or not subset[cell]:
            return None
        return span(cell, start), span(cell, end)

    walls: list[Face] = []
    used: dict[int, int] = defaultdict(int)
    for half in range(len(plan.start)):
        start, end = int(plan.start[half]), int(plan.end[half])
        cell, beyond = int(plan.cell[half]), int(plan.cell[plan.twin[half]])
        own = over(cell, start, end)
        if own is None:
            continue
        for low, high in uncovered(own, over(beyond, start, end)):
            up = range(low[1], high[1] + 1)
            down = range(high[0], low[0] - 1, -1)
            walls.append(Face(((*up, *down),), WALL_SURFACE))
            for column in (range(low[0], high[0]), range(low[1], high[1])):
                for vertex in column:
                    used[vertex] += 1
    faces = level_faces(plan, subset, roof, face, stands, span)
    vertices = np.array(stacks.vertices)
    touching = vertices[[vertex for vertex, count in used.items() if count > 2], :2]
    return without_unused(Solid(vertices, (*faces, *walls))), touching.reshape(-1, 2)


def uncovered(subset: tuple[Span, Span], others: tuple[Span, Span] | None) -> list[tuple[Span, Span]]:
    """The pieces of wall of a cell over an edge that the neighbour does not cover: numbers of the lower and
    the upper vertices over start and end.
    """
    (low0, high0), (low1, high1) = subset
    if others is None:
        return [((low0, low1), (high0, high1))]
    (floor0, top0), (floor1, top1) = others
    above = ((max(top0, low0), max(top1, low1)), (high0, high1))
    below = ((low0, low1), (min(floor0, high0), min(floor1, high1)))
    return [
        (low, high)
        for low, high in (above, below)
        if high[0] >= low[0] and high[1] >= low[1] and (high[0] > low[0] or high[1] > low[1])
    ]


def level_faces(
    plan: Coverage,
    subset: NDArray[np.bool_],
    roof: RoofPlan,
    face: Integers,
    stands: NDArray[np.bool_],
    span: Callable[[int, int], Span],
) -> list[Face]:
    """Ground faces, roof faces in their order, undersides."""
    ground, tops, ceilings = [], [], []
    on_ground = np.where(subset & stands, 0, OUTSIDE)
    for rings, _ in rings_of(plan, on_ground):
        own = [[span(cell, node)[0] for cell, node in ring][::-1] for ring in rings]
        ground.append(Face(tuple(map(tuple, own)), GROUND_SURFACE))
    for rings, label in rings_of(plan, np.where(subset, face, OUTSIDE)):
        own = [[span(cell, node)[1] for cell, node in ring] for ring in rings]
        tops.append((label, Face(tuple(map(tuple, own)), ROOF_SURFACE, roof.numbers[label])))
    for rings, _ in rings_of(plan, np.where(subset & ~stands, face, OUTSIDE)):
        own = [[span(cell, node)[0] for cell, node in ring][::-1] for ring in rings]
        ceilings.append(Face(tuple(map(tuple, own)), OUTER_CEILING_SURFACE))
    tops.sort(key=lambda pair: pair[0])
    return [*ground, *(top for _, top in tops), *ceilings]


def rings_of(plan: Coverage, label: Integers) -> list[tuple[list[list[tuple[int, int]]], int]]:
    """The connected regions of like label (C,) but `OUTSIDE`: their rings, outer first, each as pairs of a
    cell of the region and a node; and the label.
    """
    region, _ = plan.regions(label)
    padded = np.append(region, OUTSIDE)
    own = padded[plan.cell]
    stays = np.flatnonzero(own != padded[plan.cell[plan.twin]])
    part = Coverage(plan.nodes, plan.start[stays], plan.end[stays], own[stays])
    answer: dict[int, tuple[list[list[tuple[int, int]]], int]] = {}
    for number, ring, area in zip(part.ring_cell.tolist(), part.rings, part.ring_area.tolist(), strict=True):
        if number == OUTSIDE:
            continue
        cells = plan.cell[stays[ring]]
        places = list(zip(cells.tolist(), part.start[ring].tolist(), strict=True))
        found = answer.setdefault(number, ([], int(label[cells[0]])))
        found[0].insert(0 if area > 0.0 else len(found[0]), places)
    return [answer[number] for number in sorted(answer)]


def without_unused(solid: Solid) -> Solid:
    """The solid without vertices that no face has."""
    used = np.unique([vertex for face in solid.faces for ring in face.rings for vertex in ring])
    number = np.full(len(solid.vertices), -1)
    number[used] = np.arange(len(used))
    faces = tuple(
        replace(face, rings=tuple(tuple(number[list(ring)].tolist()) for ring in face.rings))
        for face in solid.faces
    )
    return Solid(solid.vertices[used], faces)
