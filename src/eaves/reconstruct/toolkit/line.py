"""A stretch of a line in plan, and how two of them lie to each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SAME_DIRECTION_DEG = 4.0
"""Directions nearer than this are one."""


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


def angle_between(one: float, other: float) -> float:
    """Angle (radians, at most π/2) between two undirected directions."""
    return float(abs(np.mod(one - other + np.pi / 2, np.pi) - np.pi / 2))


def laid_on(line: Line, other: Line) -> Line:
    """The stretch of `other`'s line that lies beside `line`."""
    x, y = line.middle
    along = -other.normal[1] * x + other.normal[0] * y
    half = 0.5 * (line.high - line.low)
    return Line(other.normal, other.offset, along - half, along + half, line.support, False)
