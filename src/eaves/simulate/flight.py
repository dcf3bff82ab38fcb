"""Origins and directions of pulses: flight lines with overlap, and the pattern of the mirror."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from eaves.model import Bounds, Values

Pattern = Literal["lines", "zigzag", "ellipse", "random"]

BATCH = 200_000
"""Pulses made and traced at a time."""

BEYOND = 20.0
"""Pulses are aimed this far outside the town too (m): on low ground they come in from there."""

ABOVE = 30.0
"""Pulses that only look down (pattern `random`) start this far above the highest thing (m)."""


@dataclass(frozen=True)
class Flight:
    """One survey flight of parallel strips.

    The axes of the two strips nearest to the middle of the town lie half a strip spacing on either side of
    it.

    Parameters
    ----------
    height : float
        Height (m, > 0) above the town.
    half_angle_deg : float
        Half the opening angle (degrees).
    overlap : float
        Side overlap of neighbouring strips, as a share of their width (0 to 1).
    heading_deg : float
        Direction of flight (degrees).
    jitter : float
        Standard deviation of a pulse's place on the ground, as a share of the spacing.

    Examples
    --------
    >>> from eaves.simulate import Flight
    >>> Flight(height=800.0).half_angle_deg
    20.0
    """

    height: float = 1000.0
    half_angle_deg: float = 20.0
    overlap: float = 0.3
    heading_deg: float = 15.0
    jitter: float = 0.15

    @property
    def swath(self) -> float:
        """Width of a strip on the ground (m)."""
        return 2 * self.height * float(np.tan(np.radians(self.half_angle_deg)))


@dataclass(frozen=True, eq=False)
class Pulses:
    """P pulses: `origins` and unit `directions` (P, 3), the number of the strip from 1, the time (s)."""

    origins: Values
    directions: Values
    strip: int
    time_s: Values


LINE_RATE = 100.0
"""Mirror lines per second, only used to give pulses a time."""


def fly(
    flight: Flight, bounds: Bounds, level: float, top: float, density: float, pattern: Pattern, seed: int
) -> Iterator[Pulses]:
    """The pulses of all strips over `bounds` (m) in batches; their mean density there is `density` (1/m²).

    `level` is the mean height of the ground (m), `top` that of the highest thing.
    """
    if pattern == "random":
        yield from _from_above(bounds, top + ABOVE, density, seed)
        return
    spacing_of_strips = flight.swath * (1 - flight.overlap)
    middle = np.array([(bounds.west + bounds.east) / 2, (bounds.south + bounds.north) / 2])
    half_diagonal = float(np.hypot(bounds.width, bounds.height)) / 2
    reach = half_diagonal + flight.swath / 2
    count = 2 * int(np.ceil(reach / spacing_of_strips))
    heading = np.radians(flight.heading_deg)
    offsets = [(strip + 0.5 - count / 2) * spacing_of_strips for strip in range(count)]
    per_strip = density / _strips_over(bounds, middle, float(heading), offsets, flight.swath)
    for strip, offset in enumerate(offsets):
        if abs(offset) > reach:
            continue
        turn = heading + (np.pi if strip % 2 else 0.0)
        side = -1.0 if strip % 2 else 1.0
        rng = np.random.default_rng([seed, 11, strip])
        lateral = side * offset
        for swept in _mirror(flight, pattern, per_strip, half_diagonal + BEYOND, lateral, rng):
            yield _aim(flight, bounds, level, middle, turn, lateral, strip + 1, swept, rng)


def _strips_over(bounds: Bounds, middle: Values, heading: float, offsets: list[float], swath: float) -> float:
    """Mean number of strips that cover a place of the town."""
    share = (np.arange(50) + 0.5) / 50
    x, y = np.meshgrid(bounds.west + share * bounds.width, bounds.south + share * bounds.height)
    across = -(x - middle[0]) * np.sin(heading) + (y - middle[1]) * np.cos(heading)
    return (
        float(np.mean([np.sum(np.abs(across - offset) < swath / 2) for offset in offsets]) * len(offsets))
        / x.size
    )


@dataclass(frozen=True, eq=False)
class _Sweep:
    """P pulses of a strip: the aircraft's place along it and the target's lead before that (m), the angle
    across (radians), the time (s); and the spacing of the pulses (m).
    """

    along: Values
    lead: Values
    angle: Values
    time_s: Values
    spacing: float


def _mirror(
    flight: Flight,
    pattern: Pattern,
    density: float,
    half_length: float,
    offset: float,
    rng: np.random.Generator,
) -> Iterator[_Sweep]:
    """The pulses of one strip in its own coordinates, some lines of the mirror at a time.

    lines: a turning polygon, parallel lines. zigzag: an oscillating mirror, whose speed is even. ellipse: a
    turning wedge, a circle on the ground. Spacing along and across are equal below the aircraft. Angles that
    look past the town, which is a disc of radius `half_length` (m) to the side at `offset`, are left out.
    """
    half = float(np.radians(flight.half_angle_deg))
    radius = flight.height * float(np.tan(half))
    spacing = float(np.sqrt(half / (np.tan(half) * density)))
    per_line = max(2, round(2 * half * flight.height / spacing))
    share = (np.arange(float(per_line)) + 0.5) / per_line
    turn = 2 * np.pi * share
    angle = np.arctan(np.tan(half) * np.sin(turn)) if pattern == "ellipse" else half * (2 * share - 1)
    lead = radius * np.cos(turn) if pattern == "ellipse" else np.zeros(per_line)
    across = flight.height * np.tan(angle)
    in_range = np.abs(offset + across) < half_length
    if pattern == "zigzag":  # every second line swings the other way
        in_range |= np.abs(offset - across) < half_length
    share, angle, lead = share[in_range], angle[in_range], lead[in_range]
    start = -half_length - np.abs(lead).max(initial=0.0) + rng.uniform(0.0, spacing)
    lines, at_once = int(np.ceil(-2 * start / spacing)) + 1, max(1, BATCH // max(len(share), 1))
    for first in range(0, lines, at_once):
        line = np.arange(float(first), float(min(first + at_once, lines)))
        time = (line[:, None] + share).reshape(-1)
        swing = np.tile(angle, len(line))
        along = np.repeat(start + line * spacing, len(share))
        if pattern == "zigzag":
            swing = np.where(np.floor(time) % 2 == 0, swing, -swing)
            along = start + time * spacing
        yield _Sweep(along, np.tile(lead, len(line)), swing, time / LINE_RATE, spacing)


def _aim(
    flight: Flight,
    bounds: Bounds,
    level: float,
    middle: Values,
    turn: float,
    offset: float,
    strip: int,
    swept: _Sweep,
    rng: np.random.Generator,
) -> Pulses:
    """Those of some pulses that can meet the town, with their jitter."""
    ahead = np.array([np.cos(turn), np.sin(turn)])
    left = np.array([-ahead[1], ahead[0]])
    across = offset + flight.height * np.tan(swept.angle)
    shake = rng.normal(0.0, flight.jitter * swept.spacing, (len(across), 2))
    target = (
        middle
        + np.outer(swept.along + swept.lead + shake[:, 0], ahead)
        + np.outer(across + shake[:, 1], left)
    )
    inside = np.flatnonzero(bounds.buffered(BEYOND).contains(target))
    foot = middle + np.outer(swept.along[inside], ahead) + offset * left
    origins = np.column_stack([foot, np.full(len(inside), level + flight.height)])
    aim = np.column_stack([target[inside], np.full(len(inside), level)]) - origins
    aim /= np.linalg.norm(aim, axis=1, keepdims=True)
    return Pulses(origins, aim, strip, swept.time_s[inside])


def _from_above(bounds: Bounds, top: float, density: float, seed: int) -> Iterator[Pulses]:
    """Pulses straight down at random places."""
    rng = np.random.default_rng([seed, 12])
    count = round(density * bounds.width * bounds.height)
    for first in range(0, count, BATCH):
        size = min(BATCH, count - first)
        xy = rng.uniform((bounds.west, bounds.south), (bounds.east, bounds.north), (size, 2))
        down = np.tile([0.0, 0.0, -1.0], (size, 1))
        time_s = np.arange(float(first), float(first + size)) * 1e-5
        yield Pulses(np.column_stack([xy, np.full(size, top)]), down, 1, time_s)
