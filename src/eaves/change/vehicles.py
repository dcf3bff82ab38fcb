"""What stands alone and came or went: a vehicle, several side by side, or a small building.

Vehicles move between two flights and sheds hardly do, so what one run alone took for a building is held to
what vehicles are like. Vans are at most 2.1 m wide; what is wider (box bodies, caravans, containers) is at
least as high as a person who stands in it; the tops of all are level but for the front. A garage is wider
than any, a shed shorter, lower for its width, or pitched.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from shapely import MultiPolygon, Polygon

from eaves.geometry.components import connected_groups_kernel, members
from eaves.model import Points

MOSTLY = 0.75
"""Vehicles hold this share of the points, or the body that stands there is something else."""

PRECISE_M = 0.05
"""The width of an outline is measured so precisely (m)."""


@dataclass(frozen=True)
class StandingRules:
    """What vehicles, trailers and containers are like."""

    width: float = 2.7
    """They are nowhere so wide (m): the legal limit is 2.55 m, a garage is wider."""
    length: float = 1.9
    """They are at least so many times longer than wide, as for the detector; sheds are not."""
    height: float = 4.2
    """The highest of them (m)."""
    van_width: float = 2.2
    """A van is narrower (m): 1.9 to 2.1 m, and the outline of one a little more."""
    box_height: float = 2.5
    """What is wider than a van is at least so high (m): caravans, containers, box bodies."""
    level: float = 0.6
    """Half the range (m) of heights on top, as for the detector."""
    tilt: float = 0.16
    """A top leans less to a side or to both: 9°; along it, bonnet and windscreen do."""
    rim: float = 0.3
    """Points so near to the edge (m) may lie on a side."""
    points: int = 20
    """Fewer points tell nothing of a pitched roof."""
    agreeing: float = 0.75
    """Two outlines that share so much of both together are of one building: the next vehicle stands off."""
    area: float = 60.0
    """No lorry, nor two vans side by side, covers so much (m²)."""
    smallest: float = 6.0
    narrowest: float = 1.4
    """None covers less (m²), and the tops of none are narrower (m)."""
    gap: float = 0.5
    """Vehicles stand so far (m) apart: doors open between them."""
    gap_spacings: float = 1.4
    """Points of one top lie nearer than this many times the side of what a point stands for."""


def are_vehicles(
    xyz: Points,
    height: float,
    size: float,
    rules: StandingRules,
    reach: float,
    outline: Polygon | MultiPolygon | None = None,
) -> bool:
    """Whether points of a roof (N, 3) are those of a vehicle, or of several side by side.

    Parameters
    ----------
    xyz
        The points.
    height
        How high they lie over the ground (m).
    size
        The area that a point stands for (m²).
    rules
        What vehicles are like.
    reach
        Points cover what lies so near (m).
    outline
        The run's; None where the points must say how wide it is.
    """
    if len(xyz) == 0 or not height <= rules.height or len(xyz) * size > rules.area:
        return False
    side = float(np.sqrt(size))
    link = max(rules.gap, rules.gap_spacings * side)
    bodies = sorted((xyz[one] for one in linked(xyz[:, :2], link)), key=lambda body: -len(body))
    several = [
        body
        for body in bodies
        if len(body) * size >= rules.smallest and hull_sides(body)[0] >= rules.narrowest
    ]
    if len(several) < 2:  # lines of a scan, or one body with a bush at its side
        several = [bodies[0] if len(bodies[0]) >= MOSTLY * len(xyz) else xyz]
    most = rules.width - side / 2  # the outermost points lie within the sides
    if any(is_wide(body[:, :2], most, reach) or is_pitched(body, rules) for body in several):
        return False
    if len(several) > 1:
        return sum(map(len, several)) >= MOSTLY * len(xyz)
    body = several[0]
    if outline is None:
        return is_long(body, rules)
    width = width_of(outline)
    if rules.van_width < width < rules.width and height < rules.box_height:
        return False
    return outline.area >= rules.length * width**2 or is_long(body, rules)


def is_long(xyz: Points, rules: StandingRules) -> bool:
    """Whether the rectangle about points is as long for its width as vehicles are."""
    width, length = hull_sides(xyz)
    return length >= rules.length * width


def hull_sides(xyz: Points) -> tuple[float, float]:
    """The sides (m) of the smallest rectangle about points (N, 3), the shorter one first: it has a side along
    one of the hull's."""
    hull = shapely.get_coordinates(shapely.convex_hull(shapely.multipoints(xyz[:, :2])))
    edges = np.diff(hull, axis=0)
    length = np.hypot(*edges.T)
    along = edges[length > 0] / length[length > 0, None]
    if not len(along):
        return 0.0, 0.0
    sides = np.stack(
        [np.ptp(hull @ along.T, axis=0), np.ptp(hull @ np.stack([-along[:, 1], along[:, 0]]), axis=0)]
    )
    least, most = np.sort(sides[:, int(np.argmin(sides.prod(axis=0)))]).tolist()
    return least, most


def linked(xy: NDArray[np.float64], link: float) -> list[NDArray[np.int64]]:
    """The numbers of points (N, 2) in groups, each point linked to those nearer than `link` (m)."""
    pairs = cKDTree(xy).query_pairs(link, output_type="ndarray")
    group = connected_groups_kernel(pairs[:, 0], pairs[:, 1], len(xy))
    return members(group, int(group.max(initial=-1)) + 1)


def width_of(outline: Polygon | MultiPolygon) -> float:
    """The diameter (m) of the largest disc in an outline."""
    parts = shapely.get_parts(outline)
    return float(2.0 * max(shapely.maximum_inscribed_circle(part, PRECISE_M).length for part in parts))


def is_pitched(xyz: Points, rules: StandingRules) -> bool:
    """Whether the tops lean to one side, or to both from a ridge along or across them: without the rim, whose
    points lie on the sides, and without what bonnet and windscreen slope."""
    rim = shapely.convex_hull(shapely.multipoints(xyz[:, :2])).buffer(-rules.rim)
    top = xyz[np.abs(xyz[:, 2] - np.median(xyz[:, 2])) < rules.level]
    top = top[shapely.contains_xy(rim, top[:, 0], top[:, 1])]
    if len(top) < rules.points:
        return False
    plan, rise = top[:, :2] - top[:, :2].mean(axis=0), top[:, 2] - top[:, 2].mean()
    across, along = (plan @ np.linalg.eigh(plan.T @ plan)[1]).T
    terms = np.column_stack([across, np.abs(across), np.abs(along), along, np.ones(len(top))])
    slopes = np.linalg.lstsq(terms, rise, rcond=None)[0]
    return bool(np.abs(slopes[:3]).max() > rules.tilt)


def is_wide(xy: NDArray[np.float64], width: float, reach: float) -> bool:
    """Whether points (N, 2), each of which covers what lies within its `reach` (m), cover a disc of some
    diameter (m) between them: strips along edges do not."""
    covered = shapely.union_all(shapely.buffer(shapely.points(xy), reach, quad_segs=2))
    return not shapely.buffer(covered, -reach - width / 2, quad_segs=2).is_empty
