"""The solid of a parametric house with its parts."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from eaves.geometry.tolerance import COORDINATE_STEP
from eaves.model import Solid
from eaves.reconstruct.moments.building import ParametricBuilding, squared_up
from eaves.reconstruct.moments.parts import RoofPart, lowest, main_planes
from eaves.solids.coverage import OVERSHOOT
from eaves.solids.cutting import arrange
from eaves.solids.extrude import extrude
from eaves.solids.soundness import find_defect

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
    merged, kept = coverage.merged(label)
    world = np.array([to_world_plane(house, plane) for plane in planes])[kept]
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
    answer = segments.copy()
    for end, other in ((slice(0, 2), slice(2, 4)), (slice(2, 4), slice(0, 2))):
        place, way = segments[:, end], segments[:, end] - segments[:, other]
        near = np.column_stack([np.abs(place[:, :1] - [west, east]), np.abs(place[:, 1:] - [south, north])])
        on = (near < 1e-6).any(axis=1)
        corner = (near[:, :2].min(axis=1) < OVERSHOOT) & (near[:, 2:].min(axis=1) < OVERSHOOT)
        length = np.hypot(way[:, 0], way[:, 1])[:, None]
        answer[:, end] = np.where((on & ~corner)[:, None], place + 2.0 * OVERSHOOT * way / length, place)
    return answer


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
        for one in main
        for other in part
        if (
            segment := clip_line(
                one - other, [plane - one for plane in main] + [plane - other for plane in part], edges
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
        own = np.argmin(heights[first : first + len(part.planes)], axis=0) + first
        level = lowest(part.planes, u, v)
        better = level > height if part.raised else level < height
        takes = (u > west) & (u < east) & (v > south) & (v < north) & better
        label, height = np.where(takes, own, label), np.where(takes, level, height)
        first += len(part.planes)
    return label.astype(np.int64), planes


def to_world_plane(house: ParametricBuilding, plane: NDArray[np.float64]) -> tuple[float, float, float]:
    """The plane z = a·u + b·v + c in the axes of the house as coefficients of x and y."""
    cosine, sine = np.cos(house.fit.parameters[0]), np.sin(house.fit.parameters[0])
    a, b = plane[0] * cosine - plane[1] * sine, plane[0] * sine + plane[1] * cosine
    return float(a), float(b), float(plane[2] - a * house.fit.centre[0] - b * house.fit.centre[1])
