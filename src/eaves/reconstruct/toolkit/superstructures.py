"""Objects on a roof that are too small for a face of their own: chimneys, dormers, plant, lift housings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from eaves.figures.attributes import LEAST_SHOWN, Surface, surface_heights
from eaves.geometry.face_table import FaceTable
from eaves.geometry.inside import connected_groups_kernel, members
from eaves.geometry.planes import quantile
from eaves.geometry.rings import COORDINATE_STEP, polygon_parts
from eaves.methods import parameter
from eaves.model import ROOF_SURFACE, Installation, Points, Solid, Values
from eaves.reconstruct.toolkit.cell_labels import LabelCosts
from eaves.reconstruct.toolkit.plan_lines import LineReconstructor, main_directions, turn_by
from eaves.solids.coverage import NARROWEST_NECK, coverage_of, cut_polygons
from eaves.solids.extrude import SAME_HEIGHT
from eaves.solids.soundness import CLOSEST, LOWEST_WALL
from eaves.solids.undersides import RoofPlan, close_slabs

CLEARANCE = SAME_HEIGHT + COORDINATE_STEP
"""Height (m) over the roof planes at which a body begins: what rounding and shared vertices move both by."""


def stand_bodies(
    solids: tuple[Solid, ...], outlines: Sequence[Polygon], tops: Sequence[float]
) -> list[Solid | None]:
    """The body of each object: what its outline holds between the roof of the solids and its top (m), where
    no object before it stands. None where nothing is left.
    """
    roofs = [RoofPlan.of(solid) for solid in solids]
    polygons, planes = (
        np.concatenate([getattr(roof, name) for roof in roofs]) for name in ("polygons", "planes")
    )
    table = FaceTable.of_solids(solids, ROOF_SURFACE)
    x, y, z = table.corners.T
    a, b, c = planes[table.face_of_corner].T
    off = np.maximum.reduceat(np.abs(x * a + y * b + c - z), table.ring_start[table.outer])
    bodies: list[Solid | None] = []
    occupied: BaseGeometry = Polygon()
    for outline, top in zip(outlines, tops, strict=True):
        free = shapely.difference(outline, occupied, grid_size=COORDINATE_STEP)
        pieces = list(pieces_of(free, top, polygons, planes, off))
        bodies.append(raise_pieces(pieces, top))
        occupied = shapely.union(occupied, outline)
    return bodies


def pieces_of(
    outline: BaseGeometry,
    top: float,
    polygons: NDArray[np.object_],
    planes: NDArray[np.float64],
    off: NDArray[np.float64],
) -> Iterator[tuple[Polygon, NDArray[np.float64]]]:
    """The pieces of an outline over the roof faces (F,), and the plane (3,) on which the body of each begins,
    clear of all faces under it, which are `off` (F,; m) their planes at most.
    """
    touching = np.flatnonzero(shapely.intersects(polygons, outline))
    middle = shapely.get_coordinates(
        shapely.point_on_surface(shapely.intersection(polygons[touching], outline))
    )
    heights = middle @ planes[touching, :2].T
    order = touching[np.argsort(-(np.diag(heights) + planes[touching, 2]), kind="stable")]
    for face in order.tolist():
        reach = shapely.buffer(polygons[face], CLOSEST, join_style="mitre")
        piece = shapely.intersection(outline, reach, grid_size=COORDINATE_STEP)
        outline = shapely.difference(outline, reach, grid_size=COORDINATE_STEP)
        outline = shapely.MultiPolygon(list(polygon_parts(outline)))
        above = 0.0
        for neighbour in touching.tolist():
            places = shapely.get_coordinates(shapely.intersection(piece, polygons[neighbour]))
            rise = places @ (planes[neighbour] - planes[face])[:2] + (planes[neighbour] - planes[face])[2]
            above = max(above, float(rise.max(initial=0.0)) + off[neighbour] * (len(places) > 0))
        floor = planes[face] + [0.0, 0.0, above + CLEARANCE]
        for part in polygon_parts(below(piece, floor, top - LOWEST_WALL)):
            if 2.0 * part.area > NARROWEST_NECK * part.length:
                yield part, floor


def below(piece: BaseGeometry, plane: NDArray[np.float64], height: float) -> BaseGeometry:
    """Part of a piece of plan in which a plane (3,) lies under a height (m)."""
    a, b, c = plane
    steep = float(np.hypot(a, b))
    west, south, east, north = piece.bounds if not piece.is_empty else (0.0, 0.0, 0.0, 0.0)
    middle = np.array([0.5 * (west + east), 0.5 * (south + north)])
    room = height - float(middle @ [a, b]) - c
    reach = east - west + north - south
    if room >= steep * reach or piece.is_empty:
        return piece
    if room <= -steep * reach:
        return Polygon()
    uphill, across = np.array([a, b]) / steep, np.array([-b, a]) / steep
    foot = middle + uphill * (room / steep)
    sides = [foot + across * reach, foot - across * reach]
    far = uphill * 3.0 * reach
    return shapely.intersection(piece, Polygon([*sides, sides[1] - far, sides[0] - far]))


def raise_pieces(pieces: list[tuple[Polygon, NDArray[np.float64]]], top: float) -> Solid | None:
    """The largest body of pieces that hang together, from their planes up to the top (m); where it would
    touch itself that of the largest piece, without its small corners.
    """
    if not pieces:
        return None
    largest, floor = max(pieces, key=lambda piece: piece[0].area)
    smooth = shapely.simplify(
        shapely.buffer(largest, -NARROWEST_NECK, join_style="mitre"), 0.5 * NARROWEST_NECK
    )
    for partition in (pieces, [(part, floor) for part in polygon_parts(smooth)[:1]]):
        polygons = np.array([polygon for polygon, _ in partition], object)
        cells, owner = cut_polygons(polygons, shapely.boundary(polygons))
        plan = coverage_of(cells, COORDINATE_STEP)
        if plan is not None:
            level = RoofPlan(
                polygons, np.tile([0.0, 0.0, top], (len(partition), 1)), (None,) * len(partition), top
            )
            floors = np.array([partition[number][1] for number in owner])
            bodies, touching = close_slabs(plan, level, owner, np.zeros(len(owner), bool), floors)
            if len(touching) == 0:
                return max(bodies, key=lambda body: float(np.ptp(body.vertices[:, :2], axis=0).prod()))
    return None


class ObjectLimits(LineReconstructor, LabelCosts):
    """Rules for objects on a roof, beside those for parts of one: parameters of a method."""

    superstructure_points: int = parameter(
        8, "Points that show an object on the roof which the solids leave out.", ge=4
    )
    tower_largest: float = parameter(
        6.0,
        "Parts of a roof smaller than this, high over the rest, are towers of leaves unless they are bodies.",
        unit="m2",
        ge=0.0,
    )
    superstructure_least: float = parameter(
        0.0,
        "Smaller objects are left out of what is written; the solids are as they are.",
        unit="m2",
        ge=0.0,
    )
    superstructure_flat: float = parameter(
        0.18,
        "Rise per metre under which a roof is flat, 10°: plant and lift housings stand on it, else chimneys "
        "and dormers.",
        ge=0.0,
    )
    largest_chimney: float = parameter(1.5, "Area of the largest chimney.", unit="m2", gt=0.0)
    lowest_lift_housing: float = parameter(1.6, "Height of the lowest lift housing.", unit="m", gt=0.0)


def find_superstructures(
    solids: tuple[Solid, ...],
    roof: Points,
    surface: Surface | None,
    polygon: Polygon,
    spacing: float,
    limits: ObjectLimits,
) -> tuple[Installation, ...]:
    """The objects that roof points (N, 3) show above the model, largest first.

    Points higher over the roof than `residual_limit`, where residuals stop growing, stand together where they
    are near in plan.
    An object has `superstructure_points` of them, most on one level, is no wider strip along a border of the
    roof, and no crown. Its outline is the rectangle along the building's main direction, wider than its
    points by half a spacing.
    """
    height, _, _ = surface or surface_heights(solids, roof[:, :2])
    over = roof[:, 2] - height
    high = np.flatnonzero((over > limits.residual_limit) & (over < limits.level_jump))
    if len(high) < limits.superstructure_points:
        return ()
    main = main_directions(polygon)
    if len(main) == 0:
        return ()
    pairs = cKDTree(roof[high, :2]).query_pairs(limits.clutter_reach * spacing, output_type="ndarray")
    group = connected_groups_kernel(pairs[:, 0], pairs[:, 1], len(high))
    turn = turn_by(float(main[0]))
    clusters = [
        sample
        for sample in members(group, int(group.max()) + 1)
        if len(sample) >= limits.superstructure_points
    ]
    turned = np.column_stack([roof[high, :2] @ turn, roof[high, 2]])
    objects = []
    for cluster in join_overlapping(
        clusters, turned, 0.5 * limits.clutter_reach * spacing, limits.residual_limit
    ):
        sample = high[cluster]
        item = describe_object(solids, roof[sample], over[sample], turn, spacing, limits)
        if item is None or item.polygon.area < limits.superstructure_least:
            continue
        if item.polygon.intersection(polygon).area > LEAST_SHOWN * item.polygon.area:
            objects.append(item)
    objects.sort(key=lambda item: (-item.polygon.area, item.polygon.centroid.x))
    bodies = stand_bodies(solids, [item.polygon for item in objects], [item.top for item in objects])
    return tuple(
        replace(item, solid=body) for item, body in zip(objects, bodies, strict=True) if body is not None
    )


def join_overlapping(
    groups: list[NDArray[np.int64]], points: Points, margin: float, level: float
) -> list[NDArray[np.int64]]:
    """The groups, members of points (N, 3), those as one whose boxes, wider by a `margin` (m), overlap in
    plan and whose tops are equally high to `level` (m): chance leaves gaps among the points of one object.
    """
    while len(groups) > 1:
        low = np.array([points[group, :2].min(axis=0) - margin for group in groups])
        high = np.array([points[group, :2].max(axis=0) + margin for group in groups])
        boxes = shapely.box(*low.T, *high.T)
        top = np.array([top_of(points[group]) for group in groups])
        first, second = shapely.STRtree(boxes).query(boxes, predicate="intersects")
        alike = (first < second) & (np.abs(top[first] - top[second]) <= level)
        if not alike.any():
            break
        joined = connected_groups_kernel(first[alike], second[alike], len(groups))
        groups = [
            np.concatenate([groups[n] for n in cluster]) for cluster in members(joined, int(joined.max()) + 1)
        ]
    return groups


def top_of(points: Points) -> float:
    """The height (m) of the top of an object's points (N, 3)."""
    return quantile(points[:, 2], 0.75)


def describe_object(
    solids: tuple[Solid, ...],
    points: Points,
    over: Values,
    turn: NDArray[np.float64],
    spacing: float,
    limits: ObjectLimits,
) -> Installation | None:
    """The object that points (N, 3), so far `over` the roof (N,; m), make; None when they make none.

    `turn` (2, 2) lays its sides along the axes.
    """
    top = top_of(points)
    if np.mean(np.abs(points[:, 2] - top) < limits.residual_limit + 0.5 * np.ptp(over)) < LEAST_SHOWN:
        return None
    local = points[:, :2] @ turn
    low, high = local.min(axis=0) - 0.5 * spacing, local.max(axis=0) + 0.5 * spacing
    sides = np.sort(high - low)
    filled = len(points) * spacing**2 / float(np.prod(sides))
    if (
        np.prod(sides) > limits.tower_largest
        or filled < 0.4
        or sides[0] < 1.5 * spacing
        or sides[1] > 5.0 * sides[0]
    ):
        return None
    if explained_beside(solids, points, spacing, limits.residual_limit):
        return None
    ring = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    corners = np.vstack([ring, ring.mean(axis=0)]) @ turn.T
    under, cosine, _ = surface_heights(solids, corners)
    if not np.isfinite(under[-1]):
        return None
    base = float(np.nanmin(under))
    rise = float(np.sqrt(max(1.0 / cosine[-1] ** 2 - 1.0, 0.0)))
    area, above = float(np.prod(sides)), float(np.median(over))
    if above < limits.residual_limit or top - base < limits.residual_limit:
        return None
    if rise < limits.superstructure_flat:
        kind = "lift_housing" if area > 2.0 and above >= limits.lowest_lift_housing else "plant"
        kind = (
            "chimney"
            if area <= limits.largest_chimney and above >= 0.8 and sides[1] < 2.0 * sides[0]
            else kind
        )
    else:
        kind = "chimney" if area <= limits.largest_chimney else "dormer"
    return Installation(kind, Polygon(corners[:-1]), top, above, len(points))


def explained_beside(solids: tuple[Solid, ...], points: Points, beside: float, level: float) -> bool:
    """True if the roof `beside` (m) explains most of the points (N, 3) to `level` (m): a border is a little
    off.
    """
    ways = beside * np.array(
        [[1, 0], [0, 1], [-1, 0], [0, -1], [0.7, 0.7], [-0.7, 0.7], [-0.7, -0.7], [0.7, -0.7]]
    )
    places: NDArray[np.float64] = (points[:, None, :2] + ways[None]).reshape(-1, 2)
    height = surface_heights(solids, places)[0].reshape(len(points), len(ways))
    matching = np.abs(np.nan_to_num(height, nan=-1e9) - points[:, 2:3]) < level
    return bool(np.mean(matching.any(axis=1)) > 0.5)
