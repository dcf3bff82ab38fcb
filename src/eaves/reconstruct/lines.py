"""Candidate lines for the plan of a roof: where planes meet, and where heights jump."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError
from shapely import Polygon

from eaves.model import Labels, Mask, Points, Values

WIDE_GAP = 2.0
"""Neighbours further apart than this many spacings have a shadow between them."""

WINDOW = 1.2
"""Width, in spacings, of the strip in which border places make one line."""

FEWEST_SAMPLES = 3
"""Border places that make a line."""

MAIN_WEIGHT = 1.3
"""How much more a line along the footprint is trusted than one along a plane's fall."""

LEAST_WEIGHT = 0.15
"""Weight of a border place where heights do not differ; one of a metre or more weighs 1."""

FEWEST_IN_RECTANGLE = 6
"""Points of a plane whose rectangle is worth drawing."""

LEAST_FILLING = 0.7
"""Share of its rectangle that a plane's points fill when it is one."""

RECTANGLE_WEIGHT = 1e-3
"""Support of a rectangle's side per square metre: any line found among border places goes before."""

LEAST_FALL = 0.1
"""Rise per metre below which a plane has no direction worth following."""

MEETING_JUMP = 0.25
"""Two planes meet (m) where their heights at the border between their points differ by less."""

SAME_DIRECTION_DEG = 4.0
"""Directions nearer than this are one."""

SAME_LINE = 0.4
"""Parallel lines nearer than this (m), or than the spacing, are one."""

OVERSHOOT = 0.01
"""How far (m) a line runs past the one it ends on, so that rounding leaves no gap."""

PARALLEL = 1e-3
"""A stretch that comes this little (m) nearer to a line runs along it and does not cross it."""

MOST_LINES = 80
"""The best supported lines that are used; bounds the work on roofs of thousands of planes."""

SHORTEST_EDGE = 0.3
"""Footprint edges shorter than this (m) have no direction to align with."""


@dataclass(frozen=True, eq=False)
class Line:
    """A stretch of the line `normal · x = offset`, from `low` to `high` along its direction (turned left
    of the normal).
    """

    normal: tuple[float, float]
    offset: float
    low: float
    high: float
    support: float
    meeting: bool
    """Whether two planes meet here, so that the line may not be moved."""

    @property
    def middle(self) -> tuple[float, float]:
        """x, y halfway."""
        nx, ny = self.normal
        along = 0.5 * (self.low + self.high)
        return nx * self.offset - ny * along, ny * self.offset + nx * along

    def ends(self) -> list[float]:
        """x, y, x, y of the stretch."""
        nx, ny = self.normal
        dx, dy = -ny, nx
        low, high = self.low, self.high
        return [
            nx * self.offset + dx * low,
            ny * self.offset + dy * low,
            nx * self.offset + dx * high,
            ny * self.offset + dy * high,
        ]


def border_samples(
    points: Points, labels: Labels, polygon: Polygon, spacing: float
) -> tuple[NDArray[np.int64], NDArray[np.float64], Values]:
    """Pairs of planes (M, 2) whose points are neighbours, the places between (M, 2), and their weights (M,).

    Neighbours are those of a triangulation. A place weighs what its height difference is worth, up to 1 m.

    Across a gap the place is half a spacing from the higher point: the gap is the shadow of its wall.
    """
    known = points[labels >= 0]
    mark = labels[labels >= 0]
    nothing = np.zeros((0, 2), np.int64), np.zeros((0, 2)), np.zeros(0)
    if len(np.unique(mark)) < 2:
        return nothing
    try:
        simplices = Delaunay(known[:, :2]).simplices
    except QhullError:
        return nothing
    ends = np.vstack([simplices[:, [0, 1]], simplices[:, [1, 2]], simplices[:, [2, 0]]])
    ends = np.unique(np.sort(ends[mark[ends[:, 0]] != mark[ends[:, 1]]], axis=1), axis=0)
    higher_first = known[ends[:, 0], 2] >= known[ends[:, 1], 2]
    high = np.where(higher_first, ends[:, 0], ends[:, 1])
    low = np.where(higher_first, ends[:, 1], ends[:, 0])
    step = known[low, :2] - known[high, :2]
    gap = np.maximum(np.hypot(step[:, 0], step[:, 1]), 1e-9)
    share = np.where(gap > WIDE_GAP * spacing, 0.5 * spacing / gap, 0.5)
    places = known[high, :2] + share[:, None] * step
    inside = shapely.contains_xy(polygon, places[:, 0], places[:, 1])
    weight = np.clip(known[high, 2] - known[low, 2], LEAST_WEIGHT, 1.0)
    return np.sort(mark[ends[inside]], axis=1).astype(np.int64), places[inside], weight[inside]


def main_directions(polygon: Polygon) -> Values:
    """Angles (K,) in [0, π/2) of the footprint's edges, longest together first; with their perpendiculars
    understood.
    """
    rings = [polygon.exterior, *polygon.interiors]
    steps = np.vstack([np.diff(np.asarray(ring.coords)[:, :2], axis=0) for ring in rings])
    length = np.hypot(steps[:, 0], steps[:, 1])
    angle = np.mod(np.arctan2(steps[:, 1], steps[:, 0]), np.pi / 2)
    found: list[float] = []
    left = np.ones(len(length), bool)
    tolerance = np.radians(SAME_DIRECTION_DEG)
    while left.any() and len(found) < 4:
        apart = np.abs(np.mod(angle[:, None] - angle[None, :] + np.pi / 4, np.pi / 2) - np.pi / 4)
        near = (apart <= tolerance) & left[:, None] & left[None, :]
        weight = near @ length
        best = int(np.argmax(weight))
        if found and weight[best] < 0.15 * length.sum():
            break
        group = near[:, best]
        turn = np.mod(angle[group] - angle[best] + np.pi / 4, np.pi / 2) - np.pi / 4
        found.append(float(np.mod(angle[best] + np.average(turn, weights=length[group]), np.pi / 2)))
        left &= ~group
    return np.array(found)


def candidate_lines(
    points: Points, labels: Labels, planes: NDArray[np.float64], polygon: Polygon, spacing: float
) -> list[Line]:
    """The lines along which the roof may change its plane.

    `labels` (N,) are the planes of the points (N, 3), -1 for none; `planes` (P, 3) their coefficients.
    """
    pairs, places, weights = border_samples(points, labels, polygon, spacing)
    lines: list[Line] = []
    jumps = np.ones(len(places), bool)
    found, number = np.unique(pairs, axis=0, return_inverse=True)
    for one, (a, b) in enumerate(found.tolist()):
        mine = np.flatnonzero(number.ravel() == one)
        meeting, near = meeting_line(places[mine], planes[a], planes[b], spacing)
        if meeting is not None:
            lines.append(meeting)
            jumps[mine[near]] = False
    if len(found):
        used, main = np.unique(pairs), main_directions(polygon)
        lines += jump_lines(places[jumps], weights[jumps], main, fall_angles(planes[used]), spacing)
        for one in used.tolist():
            lines += rectangle_lines(points[labels == one, :2], main, spacing)
    return align(lines, polygon, spacing)


def meeting_line(
    places: NDArray[np.float64], one: NDArray[np.float64], other: NDArray[np.float64], spacing: float
) -> tuple[Line | None, Mask]:
    """The line in which two planes meet, where their border (M, 2) runs along it; which places do (M,)."""
    a, b, c = one - other
    steep = float(np.hypot(a, b))
    if steep < 0.02:
        return None, np.zeros(len(places), bool)
    nx, ny, offset = a / steep, b / steep, -c / steep
    away = places @ np.array([nx, ny]) - offset
    near = (np.abs(away) < max(1.5 * spacing, 0.3)) & (
        np.abs(away) * steep < max(MEETING_JUMP, steep * spacing)
    )
    if near.sum() < 3:
        return None, np.zeros(len(places), bool)
    along = places[near] @ np.array([-ny, nx])
    low, high = float(along.min()), float(along.max())
    if high - low < 2.0 * spacing:
        return None, np.zeros(len(places), bool)
    return Line((nx, ny), offset, low, high, float(near.sum()), True), near


def fall_angles(planes: NDArray[np.float64]) -> Values:
    """Angles (K,) in [0, π) along and across the falls of sloped planes (P, 3), each direction once."""
    steep = planes[np.hypot(planes[:, 0], planes[:, 1]) > LEAST_FALL]
    angles: list[float] = []
    for a, b, _ in steep.tolist():
        for angle in (np.arctan2(b, a), np.arctan2(a, -b)):
            if all(angle_between(angle, other) > np.radians(SAME_DIRECTION_DEG) for other in angles):
                angles.append(float(np.mod(angle, np.pi)))
    return np.array(angles)


def angle_between(one: float, other: float) -> float:
    """Angle (radians, at most π/2) between two undirected directions."""
    return float(abs(np.mod(one - other + np.pi / 2, np.pi) - np.pi / 2))


def jump_lines(
    places: NDArray[np.float64], weights: Values, main: Values, falls: Values, spacing: float
) -> list[Line]:
    """Lines through the border places (M, 2) where heights jump, best supported first.

    Their angles are those of the footprint, `main` and its perpendiculars, or else those of the planes'
    falls.
    """
    angles = [*main, *(main + np.pi / 2)]
    trust = [MAIN_WEIGHT] * len(angles)
    for angle in falls.tolist():
        if all(angle_between(angle, other) > 2.0 * np.radians(SAME_DIRECTION_DEG) for other in angles):
            angles.append(angle)
            trust.append(1.0)
    normals = np.column_stack([-np.sin(angles), np.cos(angles)])
    lines: list[Line] = []
    width, gap = max(WINDOW * spacing, 0.25), max(2.5 * spacing, 0.8)
    shortest = max(2.0 * spacing, 0.6)
    while len(places) >= FEWEST_SAMPLES and len(lines) < MOST_LINES:
        offsets = places @ normals.T
        score, first = np.zeros(len(angles)), np.zeros(len(angles))
        for number in range(len(angles)):
            order = np.argsort(offsets[:, number], kind="stable")
            column = offsets[order, number]
            total = np.append(0.0, np.cumsum(weights[order]))
            inside = total[np.searchsorted(column, column + width, side="right")] - total[:-1]
            most = int(np.argmax(inside))
            score[number], first[number] = trust[number] * inside[most], column[most]
        best = int(np.argmax(score))
        offset = offsets[:, best]
        near = np.flatnonzero((offset >= first[best]) & (offset <= first[best] + width))
        nx, ny = normals[best].tolist()
        along = places[near] @ np.array([-ny, nx])
        turn = np.argsort(along, kind="stable")
        near, along = near[turn], along[turn]
        stretch = np.split(np.arange(len(near)), np.flatnonzero(np.diff(along) > gap) + 1)
        longest = max(stretch, key=lambda some: float(weights[near[some]].sum()))
        low, high = float(along[longest[0]]), float(along[longest[-1]])
        if len(longest) >= FEWEST_SAMPLES and high - low >= shortest:
            middle = float(np.median(offset[near[longest]]))
            lines.append(Line((nx, ny), middle, low, high, float(weights[near[longest]].sum()), False))
        places = np.delete(places, near[longest], axis=0)
        weights = np.delete(weights, near[longest])
    return lines


def rectangle_lines(places: NDArray[np.float64], main: Values, spacing: float) -> list[Line]:
    """The sides of the rectangle around a plane's points (K, 2), when they fill one along a main direction.

    The sides of a dormer are too short to gather border places; its rectangle is not.
    """
    if len(places) < FEWEST_IN_RECTANGLE or len(main) == 0:
        return []
    best: tuple[float, float, Values, Values] | None = None
    for angle in main.tolist():
        turned = places @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        low, high = np.percentile(turned, [2.0, 98.0], axis=0)
        low, high = low - 0.5 * spacing, high + 0.5 * spacing
        area = float(np.prod(high - low))
        if best is None or area < best[0]:
            best = area, angle, low, high
    assert best is not None
    area, angle, low, high = best
    if len(places) * spacing**2 < LEAST_FILLING * area:
        return []
    cosine, sine = float(np.cos(angle)), float(np.sin(angle))
    weight = RECTANGLE_WEIGHT * len(places) * spacing**2
    across = [Line((cosine, sine), float(u), low[1], high[1], weight, False) for u in (low[0], high[0])]
    along = [Line((-sine, cosine), float(v), -high[0], -low[0], weight, False) for v in (low[1], high[1])]
    return [*across, *along]


def align(lines: list[Line], polygon: Polygon, spacing: float) -> list[Line]:
    """The lines, best supported first; a jump that nearly runs along a footprint edge or a better line
    lies on it.

    A jump beside an edge of the footprint, and the side of a rectangle beside a line, add nothing and go.
    """
    near, beside = max(spacing, SAME_LINE), max(0.5 * spacing, 0.15)
    edges = footprint_edges(polygon)
    fixed = list(edges)
    answer: list[Line] = []
    for line in sorted(lines, key=lambda line: (not line.meeting, -line.support, line.offset)):
        if line.meeting:
            answer.append(line)
            fixed.append(line)
            continue
        moved: Line | None = None
        needless = False
        for other in fixed:
            apart = distance_between(line, other)
            if apart > near:
                continue
            onto = laid_on(line, other)
            covered = other.low - near <= onto.low and onto.high <= other.high + near
            edge = any(other is one for one in edges)
            if edge and covered and apart > beside:
                continue
            needless = covered and (edge or line.support < 1.0)
            moved = onto
            break
        if moved is None:
            fixed.append(line)
        if not needless:
            answer.append(moved or line)
    return answer[:MOST_LINES]


def footprint_edges(polygon: Polygon) -> list[Line]:
    """The edges of the footprint that are long enough to align with."""
    answer = []
    for ring in (polygon.exterior, *polygon.interiors):
        places = np.asarray(ring.coords)[:, :2]
        for start, end in pairwise(places):
            dx, dy = (end - start).tolist()
            length = float(np.hypot(dx, dy))
            if length >= SHORTEST_EDGE:
                nx, ny = dy / length, -dx / length
                low = float(start @ np.array([-ny, nx]))
                offset = float(start @ np.array([nx, ny]))
                answer.append(Line((nx, ny), offset, low, low + length, length, True))
    return answer


def distance_between(line: Line, other: Line) -> float:
    """Distance (m) of the middle of a line from another; infinite when their directions differ."""
    cross = line.normal[0] * other.normal[1] - line.normal[1] * other.normal[0]
    if abs(cross) > np.sin(np.radians(SAME_DIRECTION_DEG)):
        return float("inf")
    x, y = line.middle
    return abs(other.normal[0] * x + other.normal[1] * y - other.offset)


def laid_on(line: Line, other: Line) -> Line:
    """The stretch of `other`'s line that lies beside `line`."""
    x, y = line.middle
    along = -other.normal[1] * x + other.normal[0] * y
    half = 0.5 * (line.high - line.low)
    return Line(other.normal, other.offset, along - half, along + half, line.support, False)


def extend(lines: list[Line], polygon: Polygon, extension: float) -> NDArray[np.float64]:
    """Segments (S, 4) of the lines, lengthened by `extension` (m) and on to the next line or footprint edge.

    A line that reaches only as far as its evidence would hang free and cut nothing.
    """
    if not lines:
        return np.zeros((0, 4))
    normal = np.array([line.normal for line in lines])
    offset = np.array([line.offset for line in lines])
    low = np.array([line.low for line in lines]) - extension
    high = np.array([line.high for line in lines]) + extension
    direction = np.column_stack([-normal[:, 1], normal[:, 0]])
    foot = normal * offset[:, None]
    rings = [np.asarray(ring.coords)[:, :2] for ring in (polygon.exterior, *polygon.interiors)]
    starts = np.vstack([foot + direction * low[:, None], *(ring[:-1] for ring in rings)])
    ends = np.vstack([foot + direction * high[:, None], *(ring[1:] for ring in rings)])
    before = starts @ normal.T - offset
    after = ends @ normal.T - offset
    crosses = (before * after <= 0.0) & (np.abs(before - after) > PARALLEL)
    share = before / np.where(crosses, before - after, 1.0)
    along = starts @ direction.T + share * ((ends - starts) @ direction.T)
    up = np.where(crosses & (along >= high), along, np.inf).min(axis=0)
    down = np.where(crosses & (along <= low), along, -np.inf).max(axis=0)
    last = np.where(np.isfinite(up), up + OVERSHOOT, high)
    first = np.where(np.isfinite(down), down - OVERSHOOT, low)
    return np.hstack([foot + direction * first[:, None], foot + direction * last[:, None]])
