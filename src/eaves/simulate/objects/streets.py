"""Layout of a town: streets, blocks of a style each, lots, houses, gardens, parked cars."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from eaves.model import Bounds, Values
from eaves.simulate.objects.houses import (
    Design,
    draw_angled_hall,
    draw_church,
    draw_detached,
    draw_garden_shed,
    draw_hall,
    draw_perimeter,
    draw_row,
    draw_slab,
    draw_tower,
    draw_town_house,
)

STREET = 11.0
"""Width of a street with its pavements (m)."""

SMALL_BLOCKS = ("detached", "rows", "town houses", "park", "yard", "scrub")
"""Blocks that may be cut by the rim of the town: of small buildings, or of one that may be left out."""

TownStyle = Literal["mixed", "suburb", "centre", "village"]

BLOCK_SHARES: dict[TownStyle, dict[str, float]] = {
    "mixed": {
        "detached": 0.40,
        "rows": 0.20,
        "perimeter": 0.10,
        "town houses": 0.10,
        "slabs": 0.07,
        "hall": 0.06,
        "church": 0.02,
        "tower": 0.02,
        "park": 0.03,
    },
    "suburb": {"detached": 0.65, "rows": 0.25, "park": 0.10},
    "centre": {
        "town houses": 0.50,
        "perimeter": 0.22,
        "rows": 0.12,
        "slabs": 0.05,
        "church": 0.04,
        "tower": 0.02,
        "park": 0.05,
    },
    "village": {"detached": 0.55, "yard": 0.28, "scrub": 0.17},
}
"""Shares of the kinds of blocks in a town, by style."""

PLOTS_BEYOND = 20.0
"""Plots are kept whose middle is at most this far outside the town (m)."""

BLOCK_DEPTH: dict[TownStyle, tuple[float, float]] = {
    "mixed": (38.0, 54.0),
    "suburb": (38.0, 54.0),
    "centre": (32.0, 46.0),
    "village": (38.0, 54.0),
}
"""Depth of a block between two streets (m)."""

SHORTEST_ROW = 22.0
"""A row of houses is at least so long (m)."""

BLOCK_TURN_DEG = 4.0
"""A block turns away from the town's grid by up to this angle."""

LOT_TURN_DEG = 3.0
"""A detached house turns away from its block by up to this angle."""


@dataclass(frozen=True, eq=False)
class Placement:
    """A design and where it stands: centre (m) and direction (radians)."""

    design: Design
    x: float
    y: float
    angle: float


Segment = tuple[Values, Values]


@dataclass(frozen=True, eq=False)
class Plot:
    """The rectangle of a block: its centre, direction and size (m); and what it holds, in town coordinates.

    Trees and shrubs are places (x, y).
    """

    x: float
    y: float
    angle: float
    length: float
    depth: float
    placements: list[Placement] = field(default_factory=list)
    trees: list[Values] = field(default_factory=list)
    shrubs: list[Values] = field(default_factory=list)
    hedges: list[Segment] = field(default_factory=list)
    fences: list[Segment] = field(default_factory=list)
    cars: list[tuple[float, float, float]] = field(default_factory=list)
    lorries: list[tuple[float, float, float]] = field(default_factory=list)

    def at(self, u: float, v: float) -> Values:
        """The town coordinates of a place in the block's own."""
        cos, sin = np.cos(self.angle), np.sin(self.angle)
        return np.array([self.x + u * cos - v * sin, self.y + u * sin + v * cos])

    def corners(self) -> Values:
        """The four corners (4, 2)."""
        half = self.length / 2, self.depth / 2
        return np.stack([self.at(a * half[0], b * half[1]) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))])

    def inner(self, border: float, across: float) -> Plot:
        """The bare rectangle within, smaller by so much (m) along and across."""
        return Plot(self.x, self.y, self.angle, self.length - border, self.depth - across)

    def put(self, design: Design, u: float, v: float, turn: float = 0.0) -> None:
        """Place a building, turned (radians)."""
        x, y = self.at(u, v)
        self.placements.append(Placement(design, float(x), float(y), self.angle + turn))

    def park(self, u: float, v: float, turn: float = 0.0) -> None:
        """Place a car, turned (radians)."""
        x, y = self.at(u, v)
        self.cars.append((float(x), float(y), self.angle + turn))

    def scatter(self, count: int, rng: np.random.Generator) -> list[Values]:
        """Places at random."""
        u, v = rng.uniform(-0.5, 0.5, (2, count)) * [[self.length], [self.depth]]
        return [self.at(float(a), float(b)) for a, b in zip(u, v, strict=True)]


def lay_streets(
    bounds: Bounds, style: TownStyle, gap: float, rng: np.random.Generator
) -> tuple[list[Plot], Plot]:
    """The plots between the streets of a town: a grid of one direction, its blocks 55 to 95 m long.

    Those at the rim stick out of `bounds`; what would stand outside is not built. Two rows of blocks near
    the middle stand apart by `gap` (m), for a canal or an embankment; the strip between them is returned
    second.
    """
    angle = rng.uniform(0.0, np.pi)
    town = Plot((bounds.west + bounds.east) / 2, (bounds.south + bounds.north) / 2, float(angle), 0.0, 0.0)
    reach = float(np.hypot(bounds.width, bounds.height)) / 2 + 60.0
    strip_at = rng.uniform(-0.1, 0.1) * reach
    plots, strip = [], town
    v = -reach
    while v < reach:
        if gap > 0 and strip is town and v > strip_at:
            middle = town.at(0.0, v + gap / 2)
            strip = Plot(float(middle[0]), float(middle[1]), float(angle), 2 * reach, gap)
            v += gap + STREET
        depth = rng.uniform(*BLOCK_DEPTH[style])
        u = -reach + rng.uniform(0.0, 60.0)
        while u < reach:
            length = rng.uniform(55.0, 95.0)
            x, y = town.at(u + length / 2, v + depth / 2)
            turn = np.radians(rng.uniform(-BLOCK_TURN_DEG, BLOCK_TURN_DEG))
            plots.append(Plot(float(x), float(y), float(angle + turn), length, depth))
            u += length + STREET
        v += depth + STREET
    nearby = [
        plot for plot in plots if bounds.buffered(PLOTS_BEYOND).contains(np.array([[plot.x, plot.y]])).all()
    ]
    return [nearby[k] for k in rng.permutation(len(nearby))], strip


def draw_block(plot: Plot, style: TownStyle, uncut: bool, built: bool, rng: np.random.Generator) -> None:
    """The buildings and trees of a plot, drawn by the town's style, with its street trees and parked cars.

    A plot that is not `uncut` gets small houses only; one that is not `built` is a park.
    """
    blocks: dict[str, Callable[[Plot, np.random.Generator], None]] = {
        "detached": _detached,
        "rows": _rows,
        "perimeter": _perimeter,
        "town houses": _town_houses,
        "slabs": _slabs,
        "hall": _hall,
        "yard": _yard,
        "scrub": _scrub,
        "church": _church,
        "tower": _tower,
        "park": _park,
    }
    shares = BLOCK_SHARES[style]
    kind = str(rng.choice(list(shares), p=list(shares.values())))
    if not uncut and kind not in SMALL_BLOCKS:
        kind = "detached"
    blocks[kind if built else "park"](plot, rng)
    for side in (-1.0, 1.0):
        _along_street(plot, side, rng)


def _along_street(plot: Plot, side: float, rng: np.random.Generator) -> None:
    """Trees every 7 to 12 m on four streets in five, and cars at the kerb."""
    kerb = side * (plot.depth / 2 + 2.0)
    if rng.random() < 0.8:
        step = rng.uniform(7.0, 12.0)
        for u in np.arange(-plot.length / 2 + 3.0, plot.length / 2, step):
            plot.trees.append(plot.at(float(u), kerb))
    for u in np.arange(-plot.length / 2 + 6.0, plot.length / 2 - 4.0, 6.0):
        if rng.random() < 0.4:
            plot.park(float(u), kerb + side * 1.8, rng.normal(0.0, 0.03))


def _detached(plot: Plot, rng: np.random.Generator) -> None:
    """Two rows of lots back to back; each has a house, often a shed, a hedge or fence, two or three trees."""
    for side in (-1.0, 1.0):
        u = -plot.length / 2
        while (frontage := rng.uniform(13.0, 20.0)) + u <= plot.length / 2:
            middle, turn = u + frontage / 2, np.radians(rng.uniform(-LOT_TURN_DEG, LOT_TURN_DEG))
            turn += (0.0 if side < 0 else np.pi) + (np.pi / 2 if rng.random() < 0.25 else 0.0)
            plot.put(
                draw_detached(rng),
                middle,
                side * (plot.depth / 2 - rng.uniform(7.5, 10.0)),
                turn,
            )
            if rng.random() < 0.35:
                place = middle + rng.uniform(-0.3, 0.3) * frontage, side * rng.uniform(2.5, 4.5)
                plot.put(draw_garden_shed(rng), *place, float(turn))
            border = plot.at(u, side * plot.depth / 2), plot.at(u, 0.0)
            (plot.hedges if rng.random() < 0.5 else plot.fences).append(border)
            for planted, low, high in ((plot.trees, 1, 6), (plot.shrubs, 3, 10)):
                for _ in range(int(rng.integers(low, high))):
                    place = u + rng.uniform(0.0, frontage), side * rng.uniform(0.0, plot.depth / 2)
                    planted.append(plot.at(*place))
            u += frontage


def _rows(plot: Plot, rng: np.random.Generator) -> None:
    """Two rows of houses back to back with sheds at the ends of the gardens."""
    for side in (-1.0, 1.0):
        room = plot.length - 4.0
        start = -room / 2
        while room / 2 - start > SHORTEST_ROW:
            design = draw_row(room / 2 - start, rng)
            west, _, east, _ = design.outline.bounds
            turn = 0.0 if side < 0 else np.pi
            plot.put(design, start + (east - west) / 2, side * (plot.depth / 2 - 7.5), turn)
            start += east - west + 3.0
        for u in np.arange(-room / 2 + 3.0, room / 2, 6.0):
            if rng.random() < 0.25:
                plot.put(draw_garden_shed(rng), float(u), side * 3.2, np.pi / 2)
            if rng.random() < 0.6:
                plot.trees.append(plot.at(float(u) + 2.5, side * rng.uniform(4.0, 9.0)))
            if rng.random() < 0.5:
                plot.fences.append(
                    (plot.at(float(u) + 3.0, side * 1.0), plot.at(float(u) + 3.0, side * 10.0))
                )
            plot.shrubs.append(plot.at(float(u), side * rng.uniform(5.0, 10.0)))
    plot.hedges.append((plot.at(-plot.length / 2 + 3.0, 0.0), plot.at(plot.length / 2 - 3.0, 0.0)))


def _perimeter(plot: Plot, rng: np.random.Generator) -> None:
    """One building around a courtyard with trees."""
    plot.put(draw_perimeter(plot.length - 4.0, plot.depth - 4.0, rng), 0.0, 0.0)
    inner = plot.inner(34.0, 34.0)
    plot.trees.extend(inner.scatter(int(rng.integers(6, 16)), rng))
    plot.shrubs.extend(inner.scatter(10, rng))


def _town_houses(plot: Plot, rng: np.random.Generator) -> None:
    """Two rows of separate buildings wall to wall, each of its own height."""
    for side in (-1.0, 1.0):
        u = -plot.length / 2 + 2.0
        deep = rng.uniform(10.0, 13.0)
        while (frontage := rng.uniform(6.5, 13.0)) + u < plot.length / 2 - 2.0:
            design = draw_town_house(frontage, deep, rng)
            plot.put(
                design,
                u + frontage / 2,
                side * (plot.depth / 2 - deep / 2 - 1.5),
                0.0 if side < 0 else np.pi,
            )
            u += frontage
    inner = plot.inner(8.0, 30.0)
    plot.trees.extend(inner.scatter(int(rng.integers(8, 22)), rng))


def _slabs(plot: Plot, rng: np.random.Generator) -> None:
    """Slabs of flats on a lawn with trees and parked cars."""
    plot.put(draw_slab(plot.length - 12.0, rng), 0.0, -plot.depth / 2 + 11.0)
    if plot.depth > 50.0:
        plot.put(draw_slab(plot.length - 20.0, rng), rng.uniform(-4.0, 4.0), plot.depth / 2 - 11.0)
    plot.trees.extend(plot.scatter(int(rng.integers(15, 35)), rng))


def _hall(plot: Plot, rng: np.random.Generator) -> None:
    """An industrial hall with a fenced yard."""
    length, width = rng.uniform(0.55, 0.85) * plot.length, rng.uniform(0.5, 0.75) * plot.depth
    plot.put(draw_hall(length, width, rng), 0.0, 0.0)
    corners = plot.corners()
    for k in range(3):
        plot.fences.append((corners[k], corners[k + 1]))
    for u in np.arange(-plot.length / 2 + 4.0, plot.length / 2 - 4.0, 3.0):
        if rng.random() < 0.5:
            plot.park(float(u), -plot.depth / 2 + 3.5, np.pi / 2)


def _yard(plot: Plot, rng: np.random.Generator) -> None:
    """A hall, on two of five an angle, and buses, lorries and containers beside it."""
    length, width = rng.uniform(0.5, 0.75) * plot.length, rng.uniform(0.5, 0.75) * plot.depth
    draw = draw_angled_hall if rng.random() < 0.4 else draw_hall
    plot.put(draw(length, width, rng), 0.0, 0.0)
    for u in np.arange(-plot.length / 2 + 8.0, plot.length / 2 - 6.0, 14.0):
        if rng.random() < 0.6:
            x, y = plot.at(float(u), plot.depth / 2 - 2.5)
            plot.lorries.append((float(x), float(y), plot.angle))


def _scrub(plot: Plot, rng: np.random.Generator) -> None:
    """Thickets of shrubs, some of the size of a house, and few trees."""
    for middle in plot.scatter(12, rng):
        wide = rng.uniform(1.0, 3.5)
        plot.shrubs.extend(middle + rng.normal(0.0, wide, (int(4 * wide**2), 2)))
    plot.trees.extend(plot.scatter(6, rng))


def _church(plot: Plot, rng: np.random.Generator) -> None:
    plot.put(draw_church(rng), 0.0, 0.0)
    plot.trees.extend(plot.scatter(20, rng))


def _tower(plot: Plot, rng: np.random.Generator) -> None:
    plot.put(draw_tower(rng), rng.uniform(-0.2, 0.2) * plot.length, 0.0)
    plot.trees.extend(plot.scatter(15, rng))


def _park(plot: Plot, rng: np.random.Generator) -> None:
    """Trees and shrubs, a hut."""
    plot.trees.extend(plot.scatter(int(plot.length * plot.depth / 50.0), rng))
    plot.shrubs.extend(plot.scatter(25, rng))
    plot.put(draw_garden_shed(rng), 0.0, 0.0)
