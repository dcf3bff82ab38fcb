"""Candidate lines for the plan of a roof: where planes meet, and where heights jump."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError
from shapely import Polygon

from eaves.model import Labels, Points, Values

WIDE_GAP = 2.0
"""Neighbours further apart than this many spacings have a shadow between them."""

MEETING_JUMP = 0.25
"""Two planes meet (m) where their heights at the border between their points differ by less."""

SAME_DIRECTION_DEG = 4.0
"""Directions nearer than this are one."""

OVERSHOOT = 0.01
"""How far (m) a line runs past the one it ends on, so that rounding leaves no gap."""

MOST_LINES = 80
"""The best supported lines that are used; bounds the work on roofs of thousands of planes."""


@dataclass(frozen=True, eq=False)
class Line:
    """A stretch of the line `normal · x = offset`, from `low` to `high` along its direction (turned left of the normal)."""

    normal: tuple[float, float]
    offset: float
    low: float
    high: float
    support: float
    meeting: bool
    """Whether two planes meet here, so that the line may not be moved."""

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
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Pairs of planes (M, 2) whose points are neighbours in a triangulation, and the places between (M, 2).

    Across a gap the place is half a spacing from the higher point: the gap is the shadow of its wall.
    """
    known = points[labels >= 0]
    mark = labels[labels >= 0]
    nothing = np.zeros((0, 2), np.int64), np.zeros((0, 2))
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
    return np.sort(mark[ends[inside]], axis=1).astype(np.int64), places[inside]


def main_directions(polygon: Polygon) -> Values:
    """Angles (K,) in [0, π/2) of the footprint's edges, longest together first; with their perpendiculars understood."""
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
    pairs, places = border_samples(points, labels, polygon, spacing)
    directions = main_directions(polygon)
    lines: list[Line] = []
    found, number = np.unique(pairs, axis=0, return_inverse=True)
    for one, (a, b) in enumerate(found.tolist()):
        mine = places[number.ravel() == one]
        meeting, rest = meeting_line(mine, planes[a], planes[b], spacing)
        if meeting is not None:
            lines.append(meeting)
        lines += jump_lines(rest, line_angles(directions, planes[[a, b]]), spacing)
    return align(lines, polygon, spacing)


def meeting_line(
    places: NDArray[np.float64], one: NDArray[np.float64], other: NDArray[np.float64], spacing: float
) -> tuple[Line | None, NDArray[np.float64]]:
    """The line in which two planes meet, where their border (M, 2) runs along it, and the places elsewhere."""
    a, b, c = one - other
    steep = float(np.hypot(a, b))
    if steep < 0.02:
        return None, places
    nx, ny, offset = a / steep, b / steep, -c / steep
    away = places @ np.array([nx, ny]) - offset
    near = (np.abs(away) < max(1.5 * spacing, 0.3)) & (np.abs(away) * steep < MEETING_JUMP)
    if near.sum() < 3:
        return None, places
    along = places[near] @ np.array([-ny, nx])
    low, high = float(along.min()), float(along.max())
    if high - low < 2.0 * spacing:
        return None, places
    return Line((nx, ny), offset, low, high, float(near.sum()), True), places[~near]


def line_angles(directions: Values, planes: NDArray[np.float64]) -> Values:
    """Angles (K,) in [0, π) a jump may have: along and across the footprint, and along the planes' falls."""
    angles = [*directions, *(directions + np.pi / 2)]
    tolerance = np.radians(SAME_DIRECTION_DEG)
    for a, b, _ in planes.tolist():
        if np.hypot(a, b) < 0.1:
            continue
        for angle in (np.arctan2(b, a), np.arctan2(a, -b)):
            apart = np.abs(np.mod(np.array(angles) - angle + np.pi / 2, np.pi) - np.pi / 2)
            if len(apart) == 0 or apart.min() > 2.0 * tolerance:
                angles.append(float(np.mod(angle, np.pi)))
    return np.array(angles)


def jump_lines(places: NDArray[np.float64], angles: Values, spacing: float) -> list[Line]:
    """Lines of given angles through the border places (M, 2), best supported first."""
    lines: list[Line] = []
    width = max(1.2 * spacing, 0.25)
    while len(places) >= 4 and len(lines) < 8:
        best = None
        for angle in angles.tolist():
            nx, ny = -np.sin(angle), np.cos(angle)
            offset = places @ np.array([nx, ny])
            order = np.sort(offset)
            count = np.searchsorted(order, order + width, side="right") - np.arange(len(order))
            most = int(np.argmax(count))
            if best is None or count[most] > best[0]:
                best = (int(count[most]), nx, ny, float(order[most]))
        assert best is not None
        count_in, nx, ny, first = best
        offset = places @ np.array([nx, ny])
        near = (offset >= first) & (offset <= first + width)
        along = places[near] @ np.array([-ny, nx])
        low, high = float(along.min()), float(along.max())
        if count_in < 4:
            break
        if high - low >= max(2.0 * spacing, 0.6):
            lines.append(Line((nx, ny), float(np.median(offset[near])), low, high, float(count_in), False))
        places = places[np.abs(offset - np.median(offset[near])) > width]
    return lines


def align(lines: list[Line], polygon: Polygon, spacing: float) -> list[Line]:
    """The lines, best supported first; jumps that nearly continue a footprint edge or a better line lie on it."""
    tolerance = np.radians(SAME_DIRECTION_DEG)
    near = max(1.0 * spacing, 0.25)
    fixed: list[tuple[float, float, float, float, float, bool]] = []
    for ring in (polygon.exterior, *polygon.interiors):
        places = np.asarray(ring.coords)[:, :2]
        for start, end in zip(places[:-1], places[1:], strict=True):
            length = float(np.hypot(*(end - start)))
            if length < 0.3:
                continue
            dx, dy = (end - start) / length
            nx, ny = dy, -dx
            along = (float(start @ [-ny, nx]), float(end @ [-ny, nx]))
            fixed.append((nx, ny, float(start @ [nx, ny]), min(along), max(along), True))
    answer: list[Line] = []
    for line in sorted(lines, key=lambda line: (not line.meeting, -line.support, line.offset)):
        if line.meeting:
            answer.append(line)
            fixed.append((*line.normal, line.offset, line.low, line.high, False))
            continue
        middle = 0.5 * (line.low + line.high)
        place = np.array(line.ends()).reshape(2, 2).mean(axis=0)
        moved, dropped = line, False
        for nx, ny, offset, low, high, edge in fixed:
            cross = line.normal[0] * ny - line.normal[1] * nx
            if abs(cross) > np.sin(tolerance) or abs(nx * place[0] + ny * place[1] - offset) > near:
                continue
            sign = 1.0 if nx * line.normal[0] + ny * line.normal[1] > 0 else -1.0
            along = float(place @ [-ny, nx])
            half = 0.5 * (line.high - line.low)
            if edge and low - near <= along - half and along + half <= high + near:
                dropped = True
            moved = Line((nx, ny), offset, along - half, along + half, line.support, False)
            del sign, middle
            break
        if not dropped:
            answer.append(moved)
            if moved is line:
                fixed.append((*line.normal, line.offset, line.low, line.high, False))
    return answer[:MOST_LINES]


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
    crosses = before * after <= 0.0
    share = before / np.where(before == after, 1.0, before - after)
    along = starts @ direction.T + share * ((ends - starts) @ direction.T)
    crosses &= before != after
    up = np.where(crosses & (along >= high), along, np.inf).min(axis=0)
    down = np.where(crosses & (along <= low), along, -np.inf).max(axis=0)
    last = np.where(np.isfinite(up), up + OVERSHOOT, high)
    first = np.where(np.isfinite(down), down - OVERSHOOT, low)
    return np.hstack([foot + direction * first[:, None], foot + direction * last[:, None]])
