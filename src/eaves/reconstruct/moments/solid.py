"""Parts on or cut into a parametric roof, from the residuals, and the solid of a house with its parts."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
import shapely
from numpy.typing import NDArray
from pydantic import BaseModel
from scipy.spatial import cKDTree
from shapely import Polygon

from eaves.figures.attributes import LEAST_SHOWN, NEAR_M
from eaves.geometry.components import connected_groups_kernel, members
from eaves.geometry.tolerance import COORDINATE_STEP
from eaves.methods import parameter
from eaves.model import Mask, Points, Solid
from eaves.reconstruct.moments.building import (
    FEWEST_POINTS,
    LEAST_NOISE,
    ParametricBuilding,
    extent_of,
    squared_up,
)
from eaves.reconstruct.moments.parametric_roof import (
    ANGLE,
    CUT,
    END_SLOPE,
    GABLE,
    HALF_RIDGE,
    HIP,
    LEFT_SLOPE,
    PLANE,
    RIGHT_SLOPE,
    TOP,
    ParametricFit,
    fit_parametric_roof,
)
from eaves.solids.coverage import OVERSHOOT
from eaves.solids.cutting import arrange
from eaves.solids.extrude import extrude
from eaves.solids.soundness import find_defect


class PartLimits(BaseModel):
    """Rules for dormers and terraces: parameters of a method that looks for them."""

    tolerance: float = parameter(
        NEAR_M,
        "Distance from the roof up to which it explains a point, and under which nothing stands on it.",
        unit="m",
        gt=0.0,
    )
    min_part_area: float = parameter(2.0, "Area of the smallest dormer or terrace.", unit="m2", ge=0.0)
    part_link: float = parameter(
        2.0, "Distance, in spacings, at which residual points hang together.", gt=0.0
    )
    part_reach: float = parameter(
        1.5,
        "Distance behind its last clear point at which a dormer may still meet the main roof.",
        unit="m",
        gt=0.0,
    )
    narrowest_part: float = parameter(
        0.8, "Width under which a part is a parapet or a gutter.", unit="m", ge=0.0
    )
    part_filling: float = parameter(
        LEAST_SHOWN,
        "Share of its rectangle that the points of a part cover at least: parapets and L-shapes cover less.",
        ge=0.0,
        le=1.0,
    )


@dataclass(frozen=True, eq=False)
class RoofPart:
    """A rectangle in the axes of the house (m), and planes of which the lowest is its roof.

    `planes` (P, 3) are a, b, c of z = a·u + b·v + c in those axes; `raised` says whether it stands above
    the main roof or is cut into it; `members` (K,) are its points.
    """

    edges: tuple[float, float, float, float]
    planes: NDArray[np.float64]
    raised: bool
    members: NDArray[np.int64]


def main_planes(fit: ParametricFit) -> NDArray[np.float64]:
    """The planes (P, 3) of the main roof, z = a·u + b·v + c in the house's axes; the lowest is the roof."""
    p = fit.parameters
    if fit.form == PLANE:
        return np.array([[p[END_SLOPE], -p[LEFT_SLOPE], p[TOP]]])
    along, across = p[1], p[2]
    planes = [
        (0.0, -p[LEFT_SLOPE], p[TOP] + p[LEFT_SLOPE] * across),
        (0.0, p[RIGHT_SLOPE], p[TOP] - p[RIGHT_SLOPE] * across),
    ]
    if fit.form == HIP:
        steep, ridge = p[END_SLOPE], p[HALF_RIDGE]
        planes.append((-steep, 0.0, p[TOP] + steep * (ridge + along)))
        planes.append((steep, 0.0, p[TOP] + steep * (ridge - along)))
    return np.array(planes)


def lowest(
    planes: NDArray[np.float64], u: NDArray[np.float64], v: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Height (N,) of the lowest plane (P, 3) over places (N,), (N,)."""
    return np.asarray((planes[:, :1] * u + planes[:, 1:2] * v + planes[:, 2:]).min(axis=0))


def find_parts(house: ParametricBuilding, points: Points, limits: PartLimits) -> list[RoofPart]:
    """The parts of at least `min_part_area` in points (N, 3) that the main roof leaves, largest first."""
    west, east, south, north = house.edges
    u, v = house.fit.axes(points)
    inside = (u >= west) & (u <= east) & (v >= south) & (v <= north)
    spacing = float(np.sqrt(house.length * house.width / max(int(inside.sum()), 1)))
    away = house.fit.residuals
    step = max(CUT * house.fit.scale, limits.tolerance)
    parts = []
    for sign in (1.0, -1.0):
        outliers = np.flatnonzero(inside & (sign * away > step))
        for inner in clusters_of(points[outliers], limits.part_link * spacing):
            if len(inner) * spacing**2 >= limits.min_part_area and len(inner) >= 5:
                part = shape_part(house, points, outliers[inner], sign > 0, limits)
                if part is not None:
                    parts.append(part)
    return sorted(parts, key=lambda part: (-len(part.members), int(part.members[0])))


def clusters_of(points: Points, link: float) -> list[NDArray[np.int64]]:
    """Groups of points (N, 3) that hang together in plan over at most `link` (m)."""
    if len(points) == 0:
        return []
    pairs = cKDTree(points[:, :2]).query_pairs(link, output_type="ndarray")
    group = connected_groups_kernel(pairs[:, 0], pairs[:, 1], len(points))
    return members(group, int(group.max()) + 1)


def shape_part(
    house: ParametricBuilding,
    points: Points,
    members: NDArray[np.int64],
    raised: bool,
    limits: PartLimits,
) -> RoofPart | None:
    """The rectangle and planes of a part: one plane, or a small gable across the ridge; None for scatter."""
    points_of_part = points[members]
    u, v = house.fit.axes(points_of_part)
    start = np.zeros(8)
    start[ANGLE], start[TOP] = house.fit.parameters[ANGLE], float(np.median(points_of_part[:, 2]))
    fit = fit_parametric_roof(PLANE, points_of_part, house.fit.centre, start, LEAST_NOISE)
    planes = main_planes(fit)
    if fit.scale > 2.0 * house.fit.scale and len(members) >= FEWEST_POINTS:
        start[ANGLE] += np.pi / 2.0
        start[2] = -float(np.median(u))
        start[TOP] = float(np.quantile(points_of_part[:, 2], 0.95))
        start[LEFT_SLOPE] = start[RIGHT_SLOPE] = 0.7
        small = fit_parametric_roof(GABLE, points_of_part, house.fit.centre, start, LEAST_NOISE)
        p = small.parameters
        if small.scale < fit.scale and min(p[LEFT_SLOPE], p[RIGHT_SLOPE]) > 0.1:
            fit = small
            ridge = -p[2]
            planes = np.array(
                [
                    (p[LEFT_SLOPE], 0.0, p[TOP] - p[LEFT_SLOPE] * ridge),
                    (-p[RIGHT_SLOPE], 0.0, p[TOP] + p[RIGHT_SLOPE] * ridge),
                ]
            )
    good = np.abs(fit.residuals) <= CUT * fit.scale
    if fit.scale > max(CUT * house.fit.scale, limits.tolerance) or good.sum() < 5:
        return None
    west, east, _ = extent_of(u[good])
    south, north, _ = extent_of(v[good])
    spacing_square = house.length * house.width / max(int(house.inlier.sum()), 1)
    if good.sum() * spacing_square < limits.part_filling * (east - west) * (north - south):
        return None
    edges = reach_main_roof(house, planes, (west, east, south, north), limits.part_reach)
    narrow = min(edges[1] - edges[0], edges[3] - edges[2]) < limits.narrowest_part
    return None if narrow else RoofPart(edges, planes, raised, members)


def reach_main_roof(
    house: ParametricBuilding,
    planes: NDArray[np.float64],
    edges: tuple[float, float, float, float],
    reach_back: float,
) -> tuple[float, float, float, float]:
    """The edges (m) moved, where the part meets the main roof behind its last point, by at most
    `reach_back` (m), to that line.
    """
    west, east, south, north = edges
    steps = np.arange(0.0, reach_back, 0.05)
    main = main_planes(house.fit)
    moved = []
    for edge, outwards in ((south, -1.0), (north, 1.0)):
        v = edge + outwards * steps
        u = np.full(len(v), 0.5 * (west + east))
        above = lowest(planes, u, v) - lowest(main, u, v)
        crossing = np.flatnonzero(np.sign(above[1:]) != np.sign(above[0]))
        moved.append(float(v[crossing[0] + 1] + outwards * 0.05) if len(crossing) else edge)
    low, high, left, right = house.edges[2], house.edges[3], house.edges[0], house.edges[1]
    return max(west, left), min(east, right), max(moved[0], low), min(moved[1], high)


def explained(house: ParametricBuilding, parts: list[RoofPart], points: Points, tolerance: float) -> Mask:
    """The points (N, 3) inside that lie within `tolerance` (m) of the main roof, or belong to a part."""
    slope = np.cos(house.slope)
    fits = np.abs(house.fit.residuals) * slope <= tolerance
    for part in parts:
        fits[part.members] = True
    west, east, south, north = house.edges
    u, v = house.fit.axes(points)
    rim = tolerance
    inside = (u >= west - rim) & (u <= east + rim) & (v >= south - rim) & (v <= north + rim)
    return np.asarray(fits & inside)


Edges = tuple[float, float, float, float]


def rectangle_of(house: ParametricBuilding, edges: Edges | None = None) -> Polygon:
    """The plan of the main roof, or of a part with these edges."""
    west, east, south, north = edges or house.edges
    corners = np.array([[west, south], [east, south], [east, north], [west, north]])
    return Polygon(np.round(to_world(house, corners) / COORDINATE_STEP) * COORDINATE_STEP)


def to_world(house: ParametricBuilding, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Places (N, 2) in the axes of the house as x, y."""
    cosine, sine = np.cos(house.fit.parameters[0]), np.sin(house.fit.parameters[0])
    return np.asarray(places @ np.array([[cosine, sine], [-sine, cosine]]) + house.fit.centre)


def solids_of(
    house: ParametricBuilding, parts: list[RoofPart], base: float
) -> tuple[list[Solid], NDArray[np.float64]] | None:
    """The solids down to `base` (m), and the planes (C, 3) their roof faces number; None when not sound."""
    rectangle = rectangle_of(house)
    lines = house_segments(house, parts)
    places = to_world(house, lines.reshape(-1, 2))
    for corner in shapely.get_coordinates(rectangle):
        places[np.hypot(*(places - corner).T) < OVERSHOOT] = corner
    coverage = arrange(rectangle, places.reshape(-1, 4))
    if coverage is None:
        return None
    inside = shapely.get_coordinates(shapely.point_on_surface(coverage.polygons()))
    label, planes = name_cells(house, parts, inside)
    merged, names = coverage.merged(label)
    world = np.array([to_world_plane(house, plane) for plane in planes])[names]
    solids = extrude(merged, world, base)
    if not solids or any(find_defect(solid) for solid in solids):
        return None
    return solids, world


def house_segments(house: ParametricBuilding, parts: list[RoofPart]) -> NDArray[np.float64]:
    """Ridges, hips and borders of parts (S, 4), in the axes of the house, a little past its rectangle."""
    main = main_planes(squared_up(house))
    segments = creases(main, house.edges)
    for part in parts:
        segments += creases(part.planes, part.edges) + crossings(main, part.planes, part.edges)
        west, east, south, north = part.edges
        sides = [(west, south), (east, south), (east, north), (west, north)]
        segments += [(*sides[k], *sides[(k + 1) % 4]) for k in range(4)]
    return reach_out(np.array(segments, float).reshape(-1, 4), house.edges)


def reach_out(segments: NDArray[np.float64], edges: Edges) -> NDArray[np.float64]:
    """Segments (S, 4) with the ends that lie on the rectangle's sides moved a little outwards.

    The sides are rounded to the grid, and an end that misses its side by a rounding cuts nothing. Ends in
    corners stay, for they are set onto the corner, and a hip beside its corner would leave a sliver.
    """
    west, east, south, north = edges
    reached = segments.copy()
    for end, far in ((slice(0, 2), slice(2, 4)), (slice(2, 4), slice(0, 2))):
        place, way = segments[:, end], segments[:, end] - segments[:, far]
        gaps = np.column_stack([np.abs(place[:, :1] - [west, east]), np.abs(place[:, 1:] - [south, north])])
        on = (gaps < 1e-6).any(axis=1)
        corner = (gaps[:, :2].min(axis=1) < OVERSHOOT) & (gaps[:, 2:].min(axis=1) < OVERSHOOT)
        length = np.hypot(way[:, 0], way[:, 1])[:, None]
        reached[:, end] = np.where((on & ~corner)[:, None], place + 2.0 * OVERSHOOT * way / length, place)
    return reached


def creases(planes: NDArray[np.float64], edges: Edges) -> list[tuple[float, float, float, float]]:
    """The segments inside a rectangle along which two planes (P, 3) are the lowest together."""
    return [
        segment
        for i, j in combinations(range(len(planes)), 2)
        if (segment := clip_line(planes[i] - planes[j], [plane - planes[i] for plane in planes], edges))
    ]


def crossings(
    main: NDArray[np.float64], part: NDArray[np.float64], edges: Edges
) -> list[tuple[float, float, float, float]]:
    """The segments inside a rectangle along which the roofs of lowest planes (P, 3) and (Q, 3) meet."""
    return [
        segment
        for plane_a in main
        for plane_b in part
        if (
            segment := clip_line(
                plane_a - plane_b,
                [plane - plane_a for plane in main] + [plane - plane_b for plane in part],
                edges,
            )
        )
    ]


def clip_line(
    line: NDArray[np.float64], above: list[NDArray[np.float64]], edges: Edges
) -> tuple[float, float, float, float] | None:
    """The segment of a·u + b·v + c = 0 inside a rectangle where all of `above` (a, b, c) are not negative."""
    size = float(np.hypot(line[0], line[1]))
    if size < 1e-9:
        return None
    foot = -line[2] * line[:2] / size**2
    way = np.array([-line[1], line[0]]) / size
    west, east, south, north = edges
    limits = [np.array(limit) for limit in ((1, 0, -west), (-1, 0, east), (0, 1, -south), (0, -1, north))]
    low, high = -1e6, 1e6
    for a, b, c in (*limits, *above):
        value, rate = a * foot[0] + b * foot[1] + c, a * way[0] + b * way[1]
        if abs(rate) < 1e-9:
            if value < -1e-6:
                return None
        elif rate > 0:
            low = max(low, -value / rate)
        else:
            high = min(high, -value / rate)
    if high - low < OVERSHOOT:
        return None
    start, end = foot + low * way, foot + high * way
    return float(start[0]), float(start[1]), float(end[0]), float(end[1])


def name_cells(
    house: ParametricBuilding, parts: list[RoofPart], inside: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The plane's number (C,) of every cell, by a place inside it (C, 2), and the planes."""
    main = main_planes(squared_up(house))
    planes = np.vstack([main, *(part.planes for part in parts)])
    u, v = house.fit.axes(inside)
    heights = planes[:, :1] * u + planes[:, 1:2] * v + planes[:, 2:]
    label = np.argmin(heights[: len(main)], axis=0)
    height = lowest(main, u, v)
    first = len(main)
    for part in parts:
        west, east, south, north = part.edges
        lowest_plane = np.argmin(heights[first : first + len(part.planes)], axis=0) + first
        level = lowest(part.planes, u, v)
        better = level > height if part.raised else level < height
        takes = (u > west) & (u < east) & (v > south) & (v < north) & better
        label, height = np.where(takes, lowest_plane, label), np.where(takes, level, height)
        first += len(part.planes)
    return label.astype(np.int64), planes


def to_world_plane(house: ParametricBuilding, plane: NDArray[np.float64]) -> tuple[float, float, float]:
    """The plane z = a·u + b·v + c in the axes of the house as coefficients of x and y."""
    cosine, sine = np.cos(house.fit.parameters[0]), np.sin(house.fit.parameters[0])
    a, b = plane[0] * cosine - plane[1] * sine, plane[0] * sine + plane[1] * cosine
    return float(a), float(b), float(plane[2] - a * house.fit.centre[0] - b * house.fit.centre[1])
