"""Parametric houses from invariant moments [maas_vosselman1999]."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, ClassVar

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from shapely import Polygon

from eaves.figures.attributes import LEAST_SHOWN, NEAR_M, describe_roof
from eaves.geometry.face_table import roof_point_mask
from eaves.geometry.inside import connected_groups_kernel, members
from eaves.geometry.rings import COORDINATE_STEP
from eaves.methods import Emit, ignore, parameter
from eaves.model import BuildingModel, Failure, Footprint, Mask, Points, RoofPlane, Solid
from eaves.model.cloud import canonical_order
from eaves.published.maas_vosselman.moments.building import (
    FEWEST_POINTS,
    LEAST_NOISE,
    ParametricBuilding,
    extent_of,
    fit_building,
    squared_up,
)
from eaves.published.maas_vosselman.moments.parametric_roof import (
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
    Rectangle,
    fit_parametric_roof,
)
from eaves.reconstruct.stage import Reconstructor
from eaves.reconstruct.toolkit.evidence import points_inside
from eaves.solids.coverage import OVERSHOOT
from eaves.solids.cutting import arrange
from eaves.solids.extrude import extrude
from eaves.solids.soundness import find_defect


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


def find_parts(house: ParametricBuilding, points: Points, limits: Moments) -> list[RoofPart]:
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
    limits: Moments,
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


class Moments(Reconstructor):
    """A house with a flat, shed, gable, hip, half-hip or pyramid roof, its parameters, and their variances.

    The moments of order 0 to 2 of the area under the points, plain and weighted with height, determine a
    house with a simple roof in closed form: its place, orientation, length, width, heights, slope and type.
    They are integrated over the triangles between the points, so that density does not weigh. From there
    one robust least-squares fit of the roof's heights gives orientation, ridge, slopes; the edges follow
    from how far the explained points reach. Residuals that hang together over 2 m² are dormers or terraces
    and become parts of the model. Points that do not fill the rectangle, or that the roof leaves
    unexplained, are not those of a house: a Failure.

    Formula
    -------
    In the axes u along the ridge and v across, with h̄ the mean height and n the area: L = √(12 μ20 / n), W
    = √(12 μ02 / n), Δv = −48 Σ(h − h̄)v² / (n W²), Δu = −48 Σ(h − h̄)u² / (n L²), tilt 12 Σ(h − h̄)v / (n
    W). Gable: Δ = Δv, h_e = h̄ − Δ/2. Hip: Δv = Δ(15L − 7W)/(15L), Δu = ΔW(20L² − 15LW + 3W²)/(15L³), h_e =
    h̄ − Δ(1/2 − W/6L). Pyramid: both 8Δ/15. Shed: Δ is the tilt.

    Fidelity
    --------
    The paper's text prints no formula; these are derived again and tested on exact integrals. The paper sums
    over points; `sums` does, too, and as published it is on. Integrals over triangles correct for uneven
    density and are three times more precise where points lie at random; on scan lines 1 to 2 m apart sums
    are two to five times more precise. The border that the hull of n points loses is given back to integrals
    as 8/3 · ln n / n of the area.
    The axis is tan 2θ = 2 μ11 / (μ20 − μ02), which a square leaves undefined (μ20 = μ02); n points at random
    tell it to L W / (√n (L² − W²)) radians. Squarish houses take the axes of the height tensor, or, where
    heights are the same all around, of the fourth moment, which is above order 2. Of the solutions for each
    type, ridge along and across, the one whose roof lies nearest to the points is taken; points off it are
    dormers and other asymmetries, they take its height, and the moments are integrated again, until the
    same points are off. A ridge beside the middle follows from the tilt: t (1 − q²)² = q (3 − q²), t the tilt
    over Δv, q its distance in half widths. With a ground plan axes, place and sizes are the plan's. The fit
    adds what the closed solution does not have: slopes of their own for both sides, ends that begin above
    the eaves (half-hips; also the name where the ends differ). Edges lie half a gap, Σg²/2Σg of the gaps g
    between points, beyond the outermost points.

    Fails where
    -----------
    Roofs that are none of the six: L-shapes and other areas that are no rectangle, gambrels, mansards:
    `not_a_house`. Annexes are not modelled: a house whose annex is more than a fifth of its points is
    `not_a_house`.

    Complexity
    ----------
    O(N log N) for the triangles, O(N) for each of up to 60 fitting steps.

    References
    ----------
    [maas_vosselman1999]; [renyi_sulanke1963] for the hull; [cox1962] for the gap beyond the last point.
    """

    name: ClassVar[str] = "moments"
    idea: ClassVar[str] = (
        "A simple roof in closed form from moments, one least-squares fit, dormers from the residuals."
    )
    paper: ClassVar[str] = "maas_vosselman1999"

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
    ground_plan: bool = parameter(
        False,
        "Take place, orientation, length and width from the footprint instead of the points, where it is "
        "given: an outline that was drawn from these points is no ground plan.",
    )
    empty_share: float = parameter(
        0.05,
        "Share of the rectangle that may lack points, beside what chance leaves of n: 1/√n, measured on "
        "drawn rectangles of 100 to 2,500 points, random and in scan lines.",
        ge=0.0,
        le=1.0,
    )
    closed_only: bool = parameter(
        False,
        "Leave the fit out: the closed solution alone makes the roof, without standard deviations.",
        off=True,
    )
    sums: bool = parameter(False, "Sum over the points instead of the triangles between them.", off=True)
    only: str = parameter(
        "",
        "Roof that the house has, whatever explains its points better: gable or hip; default: any.",
    )
    unexplained_share: float = parameter(
        0.2, "Share of the roof points that neither the roof nor its parts need explain.", ge=0.0, le=1.0
    )

    def model(
        self,
        points: Points,
        footprint: Footprint,
        planes: list[RoofPlane],
        ground: float,
        emit: Emit = ignore,
    ) -> BuildingModel | Failure:
        """The parametric house of one building from its points (N, 3), or the Failure that says why not."""
        finite = points[np.isfinite(points).all(axis=1)]
        roof = finite[roof_point_mask(finite)]
        roof = roof[canonical_order(roof)]
        house = self.house_of(roof, footprint.polygon, given=footprint.agreement is None)
        if isinstance(house, Failure):
            return replace(house, footprint=footprint)
        emit("closed solution", house.closed)
        emit("house", house)
        parts = find_parts(house, roof, self)
        emit("parts", parts)
        for count in range(len(parts), -1, -1):  # the smallest part may be one that cannot be built
            doubt = self.doubt(house, parts[:count], roof)
            if doubt:
                return Failure("not_a_house", doubt, "reconstruct", footprint)
            solids = solids_of(house, parts[:count], ground)
            if solids is not None:
                return self.present(house, parts[:count], solids, points, roof, footprint, ground)
        return Failure("not_sound", "the roof does not make a sound solid", "reconstruct", footprint)

    def house_of(self, roof: Points, plan: Polygon, given: bool) -> ParametricBuilding | Failure:
        """The house under roof points (N, 3) over a plan, fitted or closed, as the parameters say; a plan
        that is not `given` was drawn from points."""
        used = self.ground_plan and given
        return fit_building(
            roof, plan if used else None, closed_only=self.closed_only, sums=self.sums, only=self.only
        )

    def doubt(self, house: ParametricBuilding, parts: list[RoofPart], roof: Points) -> str:
        """Why the points are not those of a house with this roof; empty when they are."""
        allowed = self.empty_share + 1.0 / np.sqrt(len(roof))
        if abs(house.empty_share) > allowed:
            return (
                f"the points cover {1.0 - house.empty_share:.0%} of a rectangle of "
                f"{house.length:.1f} m × {house.width:.1f} m; {allowed:.0%} may differ"
            )
        unexplained = 1.0 - float(explained(house, parts, roof, self.tolerance).mean())
        if unexplained > self.unexplained_share:
            return (
                f"{unexplained:.0%} of the roof points are off the {house.roof} roof; "
                f"{self.unexplained_share:.0%} may be"
            )
        return ""

    def present(
        self,
        house: ParametricBuilding,
        parts: list[RoofPart],
        built: tuple[list[Solid], NDArray[np.float64]],
        points: Points,
        roof: Points,
        footprint: Footprint,
        ground: float,
    ) -> BuildingModel:
        """The model of a house, its planes with the points on them, and its measures."""
        solids, faces = built
        reach = max(CUT * house.fit.scale, self.tolerance)
        planes = tuple(members_on(points, (float(a), float(b), float(c)), reach) for a, b, c in faces)
        plan = rectangle_of(house)
        model = BuildingModel(footprint.with_(polygon=plan), {"2.2": tuple(solids)}, planes)
        inside, top = points[points_inside(points, plan)], roof[points_inside(roof, plan)]
        figures = measures(house, parts, footprint.origin)
        attributes = {**describe_roof(model, inside, top, ground), **figures}
        attributes[PRIMITIVES] = [{"primitive": 1, "made_by": self.name, **figures}]
        return model.with_(footprint=footprint, attributes=attributes)


def members_on(points: Points, coefficients: tuple[float, float, float], reach: float) -> RoofPlane:
    """The roof plane with those of the points (N, 3) that are within `reach` (m) of it."""
    bare = RoofPlane(coefficients, np.zeros(0, np.int64), 0.0)
    away = bare.distance_to(points)
    members = np.flatnonzero(np.abs(away) <= reach)
    rmse = float(np.sqrt(np.mean(away[members] ** 2))) if len(members) else 0.0
    return RoofPlane(coefficients, members, rmse)


PRIMITIVES = "primitive_rows"
"""Attribute of a model: a record for each of its primitives, the rows of the table `primitives`."""


def place_of(rectangle: Rectangle, origin: tuple[float, float], suffix: str = "") -> dict[str, float]:
    """Place (world metres), axis (degrees from the x axis) and sides (m) of a rectangle about an origin."""
    return {
        f"house_x{suffix}_m": rectangle.x + origin[0],
        f"house_y{suffix}_m": rectangle.y + origin[1],
        f"house_orientation{suffix}_deg": float(np.degrees(rectangle.orientation)) % 180.0,
        f"house_length{suffix}_m": rectangle.length,
        f"house_width{suffix}_m": rectangle.width,
    }


def measures(house: ParametricBuilding, parts: list[RoofPart], origin: tuple[float, float]) -> dict[str, Any]:
    """The parameters of a house as attributes (m, degrees; the place in world metres), with standard
    deviations, fitted and closed. `house_axes` says whose place, axis and sides are; those of a plan have no
    closed solution."""
    closed, deviations = house.closed, house.deviations
    figures: dict[str, Any] = {
        "house_type": house.roof,
        "house_axes": "plan" if house.on_plan else "points",
        **place_of(house, origin),
        "house_eaves_m": house.eaves,
        "house_ridge_m": house.ridge,
        "house_slope_deg": float(np.degrees(house.slope)),
        "house_ridge_offset_m": house.ridge_offset,
        "house_parts": len(parts),
        "house_parts_m2": float(sum(rectangle_of(house, part.edges).area for part in parts)),
        "house_rmse_m": house.rmse,
    }
    own = place_of(closed, origin, "_closed")
    figures |= dict.fromkeys(own) if house.on_plan else own
    figures |= {"house_eaves_closed_m": closed.eaves, "house_ridge_closed_m": closed.ridge}
    figures["house_slope_closed_deg"] = float(np.degrees(closed.slope))
    for name, value in deviations.items():
        unit = "deg" if name in ("orientation", "slope") else "m"
        known = float(np.degrees(value)) if unit == "deg" else float(value)
        figures[f"house_{name}_sd_{unit}"] = known if np.isfinite(known) else None
    return figures
