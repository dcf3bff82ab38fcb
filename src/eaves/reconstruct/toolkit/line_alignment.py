"""Candidate lines laid on the footprint's edges and on better lines that they nearly follow."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from shapely import Polygon

from eaves.reconstruct.toolkit.line import SAME_DIRECTION_DEG, Line, laid_on

SAME_LINE = 0.2
"""Parallel lines nearer than this (m), or than half the spacing, are one: eaves overhang walls by more."""

SHORTEST_EDGE = 0.3
"""Footprint edges shorter than this (m) have no direction to align with."""


def align(lines: list[Line], polygon: Polygon, spacing: float) -> list[Line]:
    """The lines, best supported first; a jump that nearly runs along a footprint edge or a better line
    lies on it.

    A jump beside an edge of the footprint, and the side of a rectangle beside a line, add nothing and go.
    """
    near, beside = max(0.5 * spacing, SAME_LINE), max(0.5 * spacing, 0.15)
    edges = footprint_edges(polygon)
    fixed = FixedLines(edges, len(edges) + len(lines))
    answer: list[Line] = []
    for line in sorted(lines, key=lambda line: (not line.meeting, -line.support, line.offset)):
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
        rows = self.rows[: len(self.lines)]
        x, y = line.middle
        apart = np.abs(rows[:, 0] * x + rows[:, 1] * y - rows[:, 2])
        cross = np.abs(line.normal[0] * rows[:, 1] - line.normal[1] * rows[:, 0])
        found = np.flatnonzero((apart <= near) & (cross <= np.sin(np.radians(SAME_DIRECTION_DEG))))
        found = found[np.argsort(apart[found], kind="stable")]
        return [(int(number), float(apart[number])) for number in found]


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
