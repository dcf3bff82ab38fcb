"""Candidate lines for the plan of a roof: where planes meet, where heights step; their alignment."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from eaves.geometry.components import members
from eaves.geometry.percentiles import column_percentiles
from eaves.geometry.tin import Tin
from eaves.kernels import kernel
from eaves.model import Labels, Mask, Points, Values
from eaves.reconstruct.toolkit.height_steps import fall_angles, step_lines
from eaves.reconstruct.toolkit.line import SAME_DIRECTION_DEG, Line, laid_on
from eaves.reconstruct.toolkit.line_limits import LineLimits

LINES_PER_PLANE = 6
"""The best supported lines that are used, for each plane: the plan of a roof has three borders a plane."""

FEWEST_LINES = 80
"""Lines that are used however few planes there are."""

RECTANGLE_WEIGHT = 1e-3
"""Support of a rectangle's side per square metre: any line found among border places goes before."""

OVERSHOOT = 0.01
"""How far (m) a line runs past the one it ends on, so that rounding leaves no gap."""

PARALLEL = 1e-3
"""A stretch that comes this little (m) nearer to a line runs along it and does not cross it."""


def border_samples(
    points: Points, labels: Labels, polygon: Polygon, spacing: float, limits: LineLimits
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
    simplices = Tin(known[:, :2]).triangles
    if len(simplices) == 0:
        return nothing
    ends = np.vstack([simplices[:, [0, 1]], simplices[:, [1, 2]], simplices[:, [2, 0]]]).astype(np.int64)
    ends = ends[mark[ends[:, 0]] != mark[ends[:, 1]]]
    sides = np.unique(ends.min(axis=1) * len(known) + ends.max(axis=1))
    ends = np.column_stack([sides // len(known), sides % len(known)])
    higher_first = known[ends[:, 0], 2] >= known[ends[:, 1], 2]
    high = np.where(higher_first, ends[:, 0], ends[:, 1])
    low = np.where(higher_first, ends[:, 1], ends[:, 0])
    step = known[low, :2] - known[high, :2]
    gap = np.maximum(np.hypot(step[:, 0], step[:, 1]), 1e-9)
    share = np.where(gap > limits.wide_gap * spacing, 0.5 * spacing / gap, 0.5)
    places = known[high, :2] + share[:, None] * step
    inside = shapely.contains_xy(polygon, places[:, 0], places[:, 1])
    weight = np.clip(known[high, 2] - known[low, 2], limits.least_weight, 1.0)
    return np.sort(mark[ends[inside]], axis=1).astype(np.int64), places[inside], weight[inside]


@lru_cache(maxsize=4)
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


def turn_by(angle: float) -> NDArray[np.float64]:
    """The matrix (2, 2) that turns plan coordinates, rows from the left, onto axes at an angle (radians)."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def candidate_lines(
    points: Points,
    labels: Labels,
    planes: NDArray[np.float64],
    polygon: Polygon,
    spacing: float,
    limits: LineLimits,
) -> list[Line]:
    """The lines along which the roof may change its plane.

    `labels` (N,) are the planes of the points (N, 3), -1 for none; `planes` (P, 3) their coefficients.
    """
    pairs, places, weights = border_samples(points, labels, polygon, spacing, limits)
    lines: list[Line] = []
    jumps = np.ones(len(places), bool)
    found, number = np.unique(pairs[:, 0] * len(planes) + pairs[:, 1], return_inverse=True)
    for pair, mine in zip(found.tolist(), members(number, len(found)), strict=True):
        a, b = divmod(pair, len(planes))
        meeting, near = meeting_line(places[mine], planes[a], planes[b], spacing, limits.meeting_jump)
        if meeting is not None:
            lines.append(meeting)
            jumps[mine[near]] = False
    if len(found):
        used, main = np.unique(pairs), main_directions(polygon)
        lines += step_lines(
            places[jumps], weights[jumps], main, fall_angles(planes[used], limits.least_fall), spacing, limits
        )
        of_plane = members(labels, len(planes))
        for one in used.tolist():
            lines += rectangle_lines(points[of_plane[one], :2], main, spacing, limits)
    return align(lines, polygon, spacing, limits)[: FEWEST_LINES + LINES_PER_PLANE * len(planes)]


def meeting_line(
    places: NDArray[np.float64],
    one: NDArray[np.float64],
    other: NDArray[np.float64],
    spacing: float,
    jump: float,
) -> tuple[Line | None, Mask]:
    """The line in which two planes meet, where their border (M, 2) runs along it; which places do (M,).

    Their heights differ there by less than `jump` (m).
    """
    a, b, c = one - other
    steep = float(np.hypot(a, b))
    if steep < 0.02:
        return None, np.zeros(len(places), bool)
    nx, ny, offset = a / steep, b / steep, -c / steep
    away = places @ np.array([nx, ny]) - offset
    near = (np.abs(away) < max(1.5 * spacing, 0.3)) & (np.abs(away) * steep < max(jump, steep * spacing))
    if near.sum() < 3:
        return None, np.zeros(len(places), bool)
    along = places[near] @ np.array([-ny, nx])
    low, high = float(along.min()), float(along.max())
    if high - low < 2.0 * spacing:
        return None, np.zeros(len(places), bool)
    return Line((nx, ny), offset, low, high, float(near.sum()), True), near


def rectangle_lines(
    places: NDArray[np.float64], main: Values, spacing: float, limits: LineLimits
) -> list[Line]:
    """The sides of the rectangle around a plane's points (K, 2), when they fill one along a main direction.

    The sides of a dormer are too short to gather border places; its rectangle is not.
    """
    if len(places) < limits.rectangle_points or len(main) == 0:
        return []
    best: tuple[float, float, Values, Values] | None = None
    for angle in main.tolist():
        turned = places @ turn_by(angle)
        low, high = column_percentiles(turned, (limits.rectangle_trim, 100.0 - limits.rectangle_trim))
        low, high = low - 0.5 * spacing, high + 0.5 * spacing
        area = float(np.prod(high - low))
        if best is None or area < best[0]:
            best = area, angle, low, high
    assert best is not None
    area, angle, low, high = best
    if len(places) * spacing**2 < limits.rectangle_filling * area:
        return []
    cosine, sine = float(np.cos(angle)), float(np.sin(angle))
    weight = RECTANGLE_WEIGHT * len(places) * spacing**2
    across = [Line((cosine, sine), float(u), low[1], high[1], weight, False) for u in (low[0], high[0])]
    along = [Line((-sine, cosine), float(v), -high[0], -low[0], weight, False) for v in (low[1], high[1])]
    return [*across, *along]


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
    up, down = free_ways_kernel(normal, offset, low, high, starts, ends)
    last_along = np.where(np.isfinite(up), high + up + OVERSHOOT, high)
    first_along = np.where(np.isfinite(down), low - down - OVERSHOOT, low)
    return np.hstack([foot + direction * first_along[:, None], foot + direction * last_along[:, None]])


@kernel
def free_ways_kernel(
    normal: NDArray[np.float64],
    offset: Values,
    low: Values,
    high: Values,
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
) -> tuple[Values, Values]:
    """How far (L,; m) lines run on beyond `high` and before `low` to the next segment; infinite without one.

    The lines have a `normal` (L, 2) and an `offset` (L,), the segments go from `starts` to `ends` (S, 2).
    """
    up, down = np.full(len(offset), np.inf), np.full(len(offset), np.inf)
    for line in range(len(offset)):
        nx, ny = normal[line, 0], normal[line, 1]
        for other in range(len(starts)):
            before = starts[other, 0] * nx + starts[other, 1] * ny - offset[line]
            after = ends[other, 0] * nx + ends[other, 1] * ny - offset[line]
            if before * after > 0.0 or abs(before - after) <= PARALLEL:
                continue
            share = before / (before - after)
            x = starts[other, 0] + share * (ends[other, 0] - starts[other, 0])
            y = starts[other, 1] + share * (ends[other, 1] - starts[other, 1])
            along = x * -ny + y * nx
            if along >= high[line]:
                up[line] = min(up[line], along - high[line])
            if along <= low[line]:
                down[line] = min(down[line], low[line] - along)
    return up, down


def align(lines: list[Line], polygon: Polygon, spacing: float, limits: LineLimits) -> list[Line]:
    """The lines, best supported first; a jump that nearly runs along a footprint edge or a better line
    lies on it.

    A jump beside an edge of the footprint, and the side of a rectangle beside a line, add nothing and go.
    """
    near, beside = max(0.5 * spacing, limits.same_line), max(0.5 * spacing, 0.15)
    edges = footprint_edges(polygon, limits.shortest_edge)
    fixed = FixedLines(edges, len(edges) + len(lines))
    answer: list[Line] = []
    for line in sorted(
        lines, key=lambda line: (not line.meeting, -line.support, line.low - line.high, line.offset)
    ):
        if line.meeting:
            answer.append(line)
            fixed.add(line)
            continue
        moved: Line | None = None
        needless = False
        for number, apart in fixed.beside(line, near):
            other = fixed.lines[number]
            onto = laid_on(line, other)
            covered = other.low - near <= onto.low and onto.high <= other.high + near
            edge = number < len(edges)
            if edge and covered and apart > beside:
                continue
            needless = covered and (edge or line.support < 1.0)
            moved = onto
            break
        if moved is None:
            fixed.add(line)
        if not needless:
            answer.append(moved or line)
    return answer


class FixedLines:
    """The lines that others may be laid on, in the order they were fixed."""

    def __init__(self, lines: list[Line], most: int) -> None:
        self.lines: list[Line] = []
        self.rows = np.zeros((most, 3))
        for line in lines:
            self.add(line)

    def add(self, line: Line) -> None:
        """Take one more line as fixed."""
        self.rows[len(self.lines)] = *line.normal, line.offset
        self.lines.append(line)

    def beside(self, line: Line, near: float) -> list[tuple[int, float]]:
        """Number and distance (m) from the middle of `line` of the lines that run beside it, nearer than
        `near`; the nearest first."""
        most = float(np.sin(np.radians(SAME_DIRECTION_DEG)))
        found, apart = beside_kernel(self.rows, len(self.lines), *line.middle, *line.normal, near, most)
        order = np.argsort(apart, kind="stable")
        return list(zip(found[order].tolist(), apart[order].tolist(), strict=True))


@kernel
def beside_kernel(
    rows: NDArray[np.float64], count: int, x: float, y: float, nx: float, ny: float, near: float, most: float
) -> tuple[NDArray[np.int64], Values]:
    """The numbers of those of the first `count` lines (L, 3: normal, offset) that pass x, y within `near` (m)
    and whose direction has a sine of at most `most` to the normal nx, ny; and their distances."""
    found, apart = np.empty(count, np.int64), np.empty(count)
    size = 0
    for row in range(count):
        away = abs(rows[row, 0] * x + rows[row, 1] * y - rows[row, 2])
        if away <= near and abs(nx * rows[row, 1] - ny * rows[row, 0]) <= most:
            found[size], apart[size] = row, away
            size += 1
    return found[:size], apart[:size]


def footprint_edges(polygon: Polygon, shortest: float) -> list[Line]:
    """The edges of the footprint that are long enough to align with: at least `shortest` (m)."""
    answer = []
    for ring in (polygon.exterior, *polygon.interiors):
        places = np.asarray(ring.coords)[:, :2]
        for start, end in pairwise(places):
            dx, dy = (end - start).tolist()
            length = float(np.hypot(dx, dy))
            if length >= shortest:
                nx, ny = dy / length, -dx / length
                low = float(start @ np.array([-ny, nx]))
                offset = float(start @ np.array([nx, ny]))
                answer.append(Line((nx, ny), offset, low, low + length, length, True))
    return answer
