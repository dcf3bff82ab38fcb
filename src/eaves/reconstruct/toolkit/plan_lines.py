"""Candidate lines for the plan of a roof: where planes meet, where heights step, around each plane."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely import Polygon

from eaves.geometry.rings import COORDINATE_STEP, FLAT_SLOPE_DEG
from eaves.geometry.tin import Tin
from eaves.kernels import inlined_kernel, kernel
from eaves.methods import parameter
from eaves.model import Integers, Labels, Mask, Points, Values
from eaves.reconstruct.stage import Reconstructor
from eaves.solids.coverage import OVERSHOOT


class LineReconstructor(Reconstructor):
    """A reconstructor whose plan is cut by candidate lines.

    Examples
    --------
    >>> import eaves
    >>> eaves.Arrangement().extension
    1.0
    """

    rectangle_trim: float = parameter(
        2.0,
        "Percentage of a plane's points, on each side, that its rectangle leaves out.",
        unit="percent",
        off=0.0,
        ge=0.0,
        lt=50.0,
    )
    extension: float = parameter(
        1.0,
        "Distance by which a line extends beyond its evidence before it ends on the next one.",
        unit="m",
        ge=0.0,
    )
    level_jump: float = parameter(
        3.0, "Height difference that makes two levels at LoD 1.3.", unit="m", gt=0.0
    )
    clutter_points: int = parameter(
        6,
        "Fewest points that make a level of what no plane explains, or of a plane whose rectangle is drawn.",
        off=10**6,
        ge=1,
    )
    smallest: float = parameter(
        0.1,
        "Roof faces, and levels of what no plane explains, smaller than this are not built, however many "
        "points they hold.",
        unit="m2",
        ge=0.0,
    )
    clutter_reach: float = parameter(
        2.0, "Points without a plane that are this many spacings apart stand together.", gt=0.0
    )
    clutter_step: float = parameter(
        0.5, "They stand together only when their heights differ by less.", unit="m", gt=0.0
    )


SAME_DIRECTION_DEG = 4.0
"""Directions nearer than this are one."""

FEWEST_PLACES = 3
"""Border places that make a line."""

MOST_TOGETHER = 2000
"""Places among which lines are sought together; more are divided, which bounds the work. So many lines, the
best supported, are used at most."""

FLAT = np.tan(np.radians(FLAT_SLOPE_DEG))
"""Rise per metre under which a plane has no direction, and two planes no line in which they meet."""


class Line(NamedTuple):
    """A stretch of the line `normal · x = offset`, from `low` to `high` along its direction (turned left of
    the normal), which `support` border places show."""

    x: float
    y: float
    offset: float
    low: float
    high: float
    support: float


def border_places(points: Points, labels: Labels, polygon: Polygon) -> tuple[Integers, Values]:
    """Pairs of planes (M, 2) whose points are neighbours in a triangulation; the places between (M, 2)."""
    labelled, mark = points[labels >= 0], labels[labels >= 0].astype(np.int64)
    first, second = seams_kernel(Tin(labelled[:, :2]).triangles, mark)
    places = 0.5 * (labelled[first, :2] + labelled[second, :2])
    inside = shapely.contains_xy(polygon, places[:, 0], places[:, 1])
    first, second = mark[first[inside]], mark[second[inside]]
    return np.column_stack([np.minimum(first, second), np.maximum(first, second)]), places[inside]


@kernel
def seams_kernel(triangles: Labels, mark: Integers) -> tuple[Integers, Integers]:
    """The ends (M,), (M,) of the sides of triangles (T, 3) between points of different marks (N,), each
    once."""
    keys, count = np.empty(3 * len(triangles), np.int64), 0
    for triangle in range(len(triangles)):
        for corner in range(3):
            a, b = np.int64(triangles[triangle, corner]), np.int64(triangles[triangle, (corner + 1) % 3])
            if mark[a] != mark[b]:
                keys[count] = min(a, b) * len(mark) + max(a, b)
                count += 1
    key, size = np.unique(keys[:count]), max(len(mark), 1)
    return key // size, key % size


@lru_cache(maxsize=4)
def main_directions(polygon: Polygon) -> Values:
    """Angles (K,) in [0, π/2) of the footprint's edges, longest together first; with their perpendiculars
    understood.
    """
    rings = [polygon.exterior, *polygon.interiors]
    steps = np.vstack([np.diff(np.asarray(ring.coords)[:, :2], axis=0) for ring in rings])
    length = np.hypot(steps[:, 0], steps[:, 1])
    angle = np.mod(np.arctan2(steps[:, 1], steps[:, 0]), np.pi / 2)
    directions: list[float] = []
    free = np.ones(len(length), bool)
    tolerance = np.radians(SAME_DIRECTION_DEG)
    while free.any() and len(directions) < 4:
        apart = np.abs(np.mod(angle[:, None] - angle[None, :] + np.pi / 4, np.pi / 2) - np.pi / 4)
        alike = (apart <= tolerance) & free[:, None] & free[None, :]
        weight = alike @ length
        best = int(np.argmax(weight))
        if directions and weight[best] < 0.15 * length.sum():
            break
        group = alike[:, best]
        turn = np.mod(angle[group] - angle[best] + np.pi / 4, np.pi / 2) - np.pi / 4
        directions.append(float(np.mod(angle[best] + np.average(turn, weights=length[group]), np.pi / 2)))
        free &= ~group
    return np.array(directions)


def turn_by(angle: float) -> Values:
    """The matrix (2, 2) that turns plan coordinates, rows from the left, onto axes at an angle (radians)."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def line_directions(main: Values, planes: Values) -> Values:
    """Normals (A, 2) along and across the footprint's `main` angles (K,), and the falls of planes (P, 3)."""
    angles = [*main, *(main + np.pi / 2)]
    for a, b, _ in planes[np.hypot(planes[:, 0], planes[:, 1]) > FLAT].tolist():
        for angle in (np.arctan2(b, a), np.arctan2(a, -b)):
            apart = np.abs(np.mod(angle - np.array(angles) + np.pi / 2, np.pi) - np.pi / 2)
            if apart.min(initial=np.pi) > np.radians(SAME_DIRECTION_DEG):
                angles.append(angle)
    return np.column_stack([-np.sin(angles), np.cos(angles)])


def candidate_lines(
    points: Points,
    labels: Labels,
    planes: Values,
    polygon: Polygon,
    spacing: float,
    limits: LineReconstructor,
) -> list[Line]:
    """The lines along which the roof may change its plane: where two meet, best supported first, where
    heights step, and the sides of the rectangle around the points of each.

    `labels` (N,) are the planes of the points (N, 3), -1 for none; `planes` (P, 3) their coefficients.
    """
    pairs, places = border_places(points, labels, polygon)
    meeting, jumps = meeting_lines_kernel(pairs, places, planes, spacing)
    planes_met, main = np.unique(pairs), main_directions(polygon)
    across = line_directions(main, planes[planes_met])
    stepping = [line for cluster in divide(places[jumps]) for line in step_lines(cluster, across, spacing)]
    fewest, trim = limits.clutter_points, limits.rectangle_trim
    around = rectangles_kernel(points, labels, planes_met, main, 0.5 * spacing, fewest, trim)
    lines = [
        line
        for kind in (as_lines(meeting), stepping, as_lines(around))
        for line in sorted(kind, key=lambda line: (-line.support, line.low - line.high, line.offset))
    ]
    return distinct_lines(lines, 0.5 * spacing)[:MOST_TOGETHER]


def distinct_lines(lines: list[Line], reach: float) -> list[Line]:
    """The lines without those that run within `reach` (m) of a better one, from end to end."""
    distinct = distinct_kernel(np.array(lines, np.float64).reshape(-1, 6), reach)
    return [lines[number] for number in np.flatnonzero(distinct)]


@kernel
def distinct_kernel(rows: Values, reach: float) -> Mask:
    """Mask (L,) of the lines, best first, rows of the numbers of `Line`, that `distinct_lines` keeps."""
    distinct = np.ones(len(rows), np.bool_)
    for row in range(len(rows)):
        x, y, offset = rows[row, 0], rows[row, 1], rows[row, 2]
        for better in range(row):
            if not distinct[better]:
                continue
            nx, ny = rows[better, 0], rows[better, 1]
            inside = True
            for end in range(2):
                place = rows[row, 3 + end]
                ex, ey = x * offset - y * place, y * offset + x * place
                along = ey * nx - ex * ny
                inside &= abs(ex * nx + ey * ny - rows[better, 2]) <= reach
                inside &= rows[better, 3] - reach <= along <= rows[better, 4] + reach
            if inside:
                distinct[row] = False
                break
    return distinct


def as_lines(rows: Values) -> list[Line]:
    """The lines of rows (L, 6) of their numbers."""
    return [Line(*row) for row in rows.tolist()]


@kernel
def meeting_lines_kernel(
    pairs: Integers, places: Values, planes: Values, spacing: float
) -> tuple[Values, Mask]:
    """The lines (L, 6) in which two planes (P, 3) meet, where the border (M, 2) of the `pairs` (M, 2) runs
    along it; which places run along none (M,)."""
    lines, count, jumps = np.empty((len(places), 6)), 0, np.ones(len(places), np.bool_)
    code = pairs[:, 0] * len(planes) + pairs[:, 1]
    order, begin = np.argsort(1.0 * code, kind="mergesort"), 0
    along = np.empty(len(places))
    for stop in range(1, len(order) + 1):
        if stop < len(order) and code[order[stop]] == code[order[begin]]:
            continue
        a, b, c = planes[pairs[order[begin], 0]] - planes[pairs[order[begin], 1]]
        steep, support, low, high = np.hypot(a, b), 0, np.inf, -np.inf
        for place in order[begin:stop]:
            x, y = places[place]
            if abs(a * x + b * y + c) / max(steep, FLAT) < spacing:
                along[place] = (y * a - x * b) / max(steep, FLAT)
                support, low, high = support + 1, min(low, along[place]), max(high, along[place])
        if steep >= FLAT and support >= FEWEST_PLACES and high - low >= 2.0 * spacing:
            lines[count] = (a / steep, b / steep, -c / steep, low, high, float(support))
            count += 1
            for place in order[begin:stop]:
                jumps[place] = not abs(a * places[place, 0] + b * places[place, 1] + c) / steep < spacing
        begin = stop
    return lines[:count], jumps


def divide(places: Values) -> Iterator[Values]:
    """The places (M, 2) in groups of at most `MOST_TOGETHER`, halved across their longer side."""
    if len(places) <= MOST_TOGETHER:
        yield places
        return
    order = np.argsort(places[:, int(np.argmax(np.ptp(places, axis=0)))], kind="stable")
    for half in np.array_split(places[order], 2):
        yield from divide(half)


def step_lines(places: Values, normals: Values, spacing: float) -> list[Line]:
    """Lines across `normals` (A, 2) through places (M, 2), again and again the strip, one spacing wide, that
    holds most of them; of each its longest stretch without a gap.
    """
    width, gap = max(spacing, 0.25), max(2.5 * spacing, 0.8)
    offsets, along = normals @ places.T, normals @ np.vstack([places[:, 1], -places[:, 0]])
    order = np.argsort(offsets, axis=1, kind="stable")
    rows = step_lines_kernel(np.take_along_axis(offsets, order, axis=1), along, order, width, gap)
    low, high, support = rows[:, 2:].T
    long = (support >= FEWEST_PLACES) & (high - low >= max(2.0 * spacing, 0.6))
    return [Line(*normals[int(direction)].tolist(), *line) for direction, *line in rows[long].tolist()]


@kernel
def step_lines_kernel(columns: Values, along: Values, order: Integers, width: float, gap: float) -> Values:
    """Direction, middle offset, ends and number of places of each stretch (L, 5) that `step_lines` tries.

    `columns` (A, M) are the offsets of the places `order` (A, M) in each direction, ascending; the places lie
    so far `along` (A, M) it.
    """
    left, count = columns.shape[1], 0
    free, rows = np.ones(left, np.bool_), np.empty((left, 5))
    strips, counted = np.full((len(columns), 3), left), np.full(len(columns), -1)
    while left >= FEWEST_PLACES:
        best = np.argmax(strips[:, 0])
        while counted[best] < count:  # of fewer places no strip has more
            strips[best], counted[best] = fullest_strip_kernel(columns[best], order[best], free, width), count
            best = np.argmax(strips[:, 0])
        _, start, end = strips[best]
        position = start + np.flatnonzero(free[order[best, start:end]])
        strip = order[best][position]
        ways = along[best][strip]
        turn = np.argsort(ways, kind="mergesort")
        first, most, begin = 0, 0, 0
        for place in range(1, len(turn) + 1):
            if place == len(turn) or ways[turn[place]] - ways[turn[place - 1]] > gap:
                if place - begin > most:
                    first, most = begin, place - begin
                begin = place
        stretch = turn[first : first + most]
        free[strip[stretch]] = False
        left -= most
        middle = np.median(columns[best][position[stretch]])
        rows[count] = (float(best), middle, ways[stretch[0]], ways[stretch[-1]], float(most))
        count += 1
    return rows[:count]


@kernel
def fullest_strip_kernel(column: Values, order: Integers, free: Mask, width: float) -> tuple[int, int, int]:
    """Number of places in the strip with the most of them, its first and last position in the column.

    The `column` (M,) has the offsets of the places `order` (M,) in one direction, ascending; only those still
    `free` count.
    """
    most, start, stop, total, end = 0, 0, 0, 0, 0
    for first in range(len(column)):
        if not free[order[first]]:
            continue
        while end < len(column) and column[end] <= column[first] + width:
            total += free[order[end]]
            end += 1
        if total > most:
            most, start, stop = total, first, end
        total -= 1
    return most, start, stop


@kernel
def rectangles_kernel(
    points: Points, labels: Labels, which: Integers, main: Values, margin: float, fewest: int, trim: float
) -> Values:
    """The sides (L, 6), rows of the numbers of `Line`, of the least rectangle along one of the `main` angles
    (K,) around the points (N, 3) of each label of `which` (P,) that has the `fewest`, without `trim` per
    cent of them on each side, and wider by the margin (m).

    The sides of a dormer are too short to gather border places; its rectangle is not.
    """
    lines, count = np.empty((4 * len(which), 6)), 0
    low, high = trim / 100.0, (100.0 - trim) / 100.0
    for label in which if len(main) else which[:0]:
        own = points[np.flatnonzero(labels == label)]
        if len(own) < fewest:
            continue
        least, sides = np.inf, (0.0, 0.0, 0.0, 0.0)
        x, y = 0.0, 0.0
        for angle in main:
            cosine, sine = np.cos(angle), np.sin(angle)
            u = np.sort(own[:, 0] * cosine + own[:, 1] * sine)
            v = np.sort(own[:, 1] * cosine - own[:, 0] * sine)
            west, east = share_kernel(u, low) - margin, share_kernel(u, high) + margin
            south, north = share_kernel(v, low) - margin, share_kernel(v, high) + margin
            area = (east - west) * (north - south)
            if area < least:
                least, sides, x, y = area, (west, east, south, north), cosine, sine
        west, east, south, north = sides
        lines[count] = (x, y, west, south, north, float(len(own)))
        lines[count + 1] = (x, y, east, south, north, float(len(own)))
        lines[count + 2] = (-y, x, south, -east, -west, float(len(own)))
        lines[count + 3] = (-y, x, north, -east, -west, float(len(own)))
        count += 4
    return lines[:count]


@inlined_kernel
def share_kernel(ordered: Values, share: float) -> Any:
    """The quantile of ordered values (N,), to the bit as `numpy.percentile` has it."""
    place = (len(ordered) - 1) * share
    low = int(place)
    before, after = ordered[low], ordered[min(low + 1, len(ordered) - 1)]
    step, part = after - before, place - low
    return before + step * part if part < 0.5 else after - step * (1.0 - part)


def extend(lines: list[Line], polygon: Polygon, extension: float) -> Values:
    """Segments (S, 4) of the lines, lengthened by `extension` (m) and on to the next line or footprint edge.

    A line that reaches only as far as its evidence would hang free and cut nothing.
    """
    x, y, offset, low, high, _ = np.array(lines, np.float64).reshape(-1, 6).T
    normal, direction = np.column_stack([x, y]), np.column_stack([-y, x])
    low, high = low - extension, high + extension
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
    normal: Values,
    offset: Values,
    low: Values,
    high: Values,
    starts: Values,
    ends: Values,
) -> tuple[Values, Values]:
    """Distance (L,; m) from `high` onwards and from `low` backwards to the next segment; infinite without
    one.

    The lines have a `normal` (L, 2) and an `offset` (L,), the segments go from `starts` to `ends` (S, 2).
    """
    up, down = np.full(len(offset), np.inf), np.full(len(offset), np.inf)
    for line in range(len(offset)):
        nx, ny = normal[line, 0], normal[line, 1]
        for obstacle in range(len(starts)):
            before = starts[obstacle, 0] * nx + starts[obstacle, 1] * ny - offset[line]
            after = ends[obstacle, 0] * nx + ends[obstacle, 1] * ny - offset[line]
            if before * after > 0.0 or abs(before - after) <= COORDINATE_STEP:
                continue
            share = before / (before - after)
            x = starts[obstacle, 0] + share * (ends[obstacle, 0] - starts[obstacle, 0])
            y = starts[obstacle, 1] + share * (ends[obstacle, 1] - starts[obstacle, 1])
            along = x * -ny + y * nx
            if along >= high[line]:
                up[line] = min(up[line], along - high[line])
            if along <= low[line]:
                down[line] = min(down[line], low[line] - along)
    return up, down
