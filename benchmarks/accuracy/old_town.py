"""An old town on a hillside: terrain with walls, levels and pits, and roofs that go on where it ends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from eaves.model import BRIDGE_DECK, Bounds, Mask, Values
from eaves.simulate.objects.houses import (
    Design,
    draw_church,
    draw_garden_shed,
    draw_hall,
    draw_perimeter,
    draw_town_house,
    flat,
    lifted,
)
from eaves.simulate.objects.streets import Placement, Plot, lay_streets
from eaves.simulate.objects.surfaces import (
    Corridor,
    ScannedSurfaces,
    Terrain,
    cut_corridor,
    make_terrain,
    upright_box,
)
from eaves.simulate.town import BuildingSite, Town

Grid = Values
NODES_M = 0.5
"""Distance of the nodes of the terrain: its walls lean by so much."""
DYKE_SEEDS = 2
"""Number of seeds of which one has a dyke through the town."""
DYKE_M = 25.0
"""Width that is kept free for it."""
STOREY_M = 3.0
LEVEL_M = 20.0
"""Height of the lowest ground, about: pits go no deeper."""


@dataclass(frozen=True)
class Level:
    """A rectangle that was made level: a `terrace` over or a `court` under what is beside it."""

    kind: str
    plot: Plot
    bounds: Bounds
    """In the plot's own coordinates."""

    def contains(self, xyz: Values) -> Mask:
        """Mask (N,) of the points (N, 2 or 3) that lie on it in plan."""
        return self.bounds.contains(np.stack(own_coordinates(self.plot, xyz), axis=-1))


@dataclass(frozen=True, eq=False)
class OldTown:
    """A town and the `levels` of its terrain that are surrounded by walls."""

    town: Town
    levels: tuple[Level, ...]


def own_coordinates(plot: Plot, xy: Values) -> tuple[Grid, Grid]:
    """Coordinates along and across a plot of places (..., 2 or 3) of the town."""
    x, y = xy[..., 0] - plot.x, xy[..., 1] - plot.y
    cos, sin = np.cos(plot.angle), np.sin(plot.angle)
    return x * cos + y * sin, y * cos - x * sin


@dataclass
class Ground:
    """A plot whose terrain is being shaped: heights (I, J) of the town's nodes, and their places in the plot.

    `slope` is the mean rise along and across the plot. What is to stand on it is noted as functions of the
    site, which are called once all terrain is shaped.
    """

    plot: Plot
    heights: Grid
    u: Grid
    v: Grid
    rng: np.random.Generator
    levels: list[Level] = field(default_factory=list)
    later: list[Callable[[BuildingSite], None]] = field(default_factory=list)

    def within(self, bounds: Bounds) -> Mask:
        """The nodes (I, J) in a rectangle of the plot."""
        return bounds.contains(np.stack([self.u, self.v], axis=-1).reshape(-1, 2)).reshape(self.u.shape)

    def rectangle(self, along: float, across: float, u: float = 0.0, v: float = 0.0) -> Bounds:
        """A rectangle about (u, v)."""
        return Bounds(u - along / 2, v - across / 2, u + along / 2, v + across / 2)

    def rises_across(self) -> tuple[bool, float]:
        """True if the plot rises more across than along, and the side to which it rises."""
        inside = self.within(self.rectangle(self.plot.length, self.plot.depth))
        if not inside.any():
            return True, 1.0
        design = np.stack([self.u[inside], self.v[inside], np.ones(inside.sum())], axis=-1)
        along, across, _ = np.linalg.lstsq(design, self.heights[inside], rcond=None)[0]
        # a plot is longer than deep, and what rises twice as much across falls as far
        if abs(across) >= abs(along):
            return True, float(np.sign(across) or 1.0)
        return False, float(np.sign(along) or 1.0)

    def make_level(self, bounds: Bounds, kind: str, share: float, over: float = 0.0) -> float:
        """Level a rectangle at a quantile of its heights and so much over it (m); the height it has then."""
        inside = self.within(bounds)
        if not inside.any():
            return 0.0
        level = float(np.quantile(self.heights[inside], share)) + over
        self.heights[inside] = level
        self.levels.append(Level(kind, self.plot, bounds))
        return level

    def lead_way(self, bounds: Bounds, level: float, outside: bool, width: float, slope: float) -> None:
        """A ramp or stair at the east or west end of a level: outside of it, or cut into it."""
        side = self.rng.choice([-1.0, 1.0])
        edge = bounds.east if side > 0 else -bounds.west
        away = side * self.u - edge
        middle = self.rng.uniform(bounds.south + width, bounds.north - width)
        strip = np.abs(self.v - middle) < width / 2
        if outside:
            strip &= (away >= 0) & (away < 30.0)
            ramp = np.clip(self.heights, level - slope * away, level + slope * away)
        else:
            rim = strip & (away > 0) & (away < 2.0)
            if not rim.any():
                return
            strip &= (away <= 0) & (away > -30.0)
            foot = float(self.heights[rim].mean())
            ramp = np.clip(level, foot + slope * away, foot - slope * away)
        self.heights[strip] = ramp[strip]

    def put(self, design: Design, u: float = 0.0, v: float = 0.0, turn: float = 0.0) -> None:
        """Have a building put up, on the ground as it will be."""
        x, y = self.plot.at(u, v)
        placement = Placement(design, float(x), float(y), self.plot.angle + turn)
        self.later.append(lambda site: site.build(placement))

    def put_flat(self, bounds: Bounds, top: float) -> None:
        """Have a building with a flat roof at a height put up on a rectangle."""
        x, y = self.plot.at((bounds.west + bounds.east) / 2, (bounds.south + bounds.north) / 2)

        def build(site: BuildingSite) -> None:
            masses = flat(bounds.width, bounds.height)
            mass = masses[0].translated(self.plot.angle, float(x), float(y), 0.0)
            design = Design("cellar", lifted(masses, top - site.floor_of(mass.polygon)))
            site.build(Placement(design, float(x), float(y), self.plot.angle))

        self.later.append(build)


def simulate_old_town(area_km2: float = 0.04, seed: int = 0) -> OldTown:
    """A town of podiums, terraces, sunken courts and yards behind gates on a slope of 6 to 22 %.

    Parameters
    ----------
    area_km2 : float
        Area of the square (km²).
    seed : int
        The same seed gives the same town.

    Returns
    -------
    OldTown
        The town, and the levels of its terrain that are surrounded by walls.

    Examples
    --------
    >>> from benchmarks.accuracy.old_town import simulate_old_town
    >>> old = simulate_old_town(0.01, seed=3)
    >>> len(old.levels) > 0
    True
    """
    rng = np.random.default_rng([seed, 41])
    side = float(np.round(np.sqrt(area_km2 * 1e6)))
    bounds = Bounds(0.0, 0.0, side, side)
    with_dyke = seed % DYKE_SEEDS == 0
    plots, strip = lay_streets(bounds, "centre", DYKE_M if with_dyke else 0.0, rng)
    terrain = in_finer_nodes(make_terrain("hilly", bounds, rng))
    direction, rise = rng.uniform(0.0, 2 * np.pi), rng.uniform(0.06, 0.22)
    nodes = terrain.nodes()
    tilt = rise * (nodes[..., 0] * np.cos(direction) + nodes[..., 1] * np.sin(direction))
    heights = terrain.heights + tilt + LEVEL_M - float(tilt.min())
    if with_dyke:
        dyke = Corridor(strip.x, strip.y, strip.angle, 2.5, rng.uniform(2.5, 5.0), rng.uniform(0.4, 0.8))
        heights = cut_corridor(replace(terrain, heights=heights), dyke).heights
    grounds = []
    for number, plot in enumerate(plots):
        plot_rng = np.random.default_rng([seed, 42, number])
        grounds.append(Ground(plot, heights, *own_coordinates(plot, nodes), plot_rng))
        KINDS[(number + seed) % len(KINDS)](grounds[-1])
    site = BuildingSite(bounds, replace(terrain, heights=heights))
    for ground in grounds:
        for act in ground.later:
            act(site)
    for ground in grounds:
        plant(ground.plot, ground.rng)
        site.furnish(ground.plot, 1.0, 2.5, ground.rng)
    return OldTown(site.finish(), tuple(level for ground in grounds for level in ground.levels))


def in_finer_nodes(terrain: Terrain) -> Terrain:
    """The terrain with a node every `NODES_M`."""
    times = round(terrain.cell / NODES_M)
    rows, columns = (times * (n - 1) + 1 for n in terrain.heights.shape)
    blank = replace(
        terrain,
        heights=np.zeros((rows, columns)),
        water=np.zeros((rows - 1, columns - 1), bool),
        cell=NODES_M,
    )
    return replace(blank, heights=terrain.at(blank.nodes().reshape(-1, 2)).reshape(rows, columns))


def plant(plot: Plot, rng: np.random.Generator) -> None:
    """Trees and shrubs here and there in a plot and along its street, and cars."""
    places = rng.uniform(-0.55, 0.55, (int(rng.integers(4, 14)), 2)) * [plot.length, plot.depth]
    plot.trees.extend(plot.at(float(u), float(v)) for u, v in places)
    places = rng.uniform(-0.5, 0.5, (8, 2)) * [plot.length, plot.depth]
    plot.shrubs.extend(plot.at(float(u), float(v)) for u, v in places)
    for u in np.arange(-plot.length / 2 + 6.0, plot.length / 2 - 4.0, 6.0):
        if rng.random() < 0.4:
            plot.park(float(u), plot.depth / 2 + 3.0)


def draw_podium(ground: Ground) -> None:
    """A hall or church on a level with walls, stairs or a ramp up to it."""
    plot, rng = ground.plot, ground.rng
    bounds = ground.rectangle(0.94 * plot.length, 0.94 * plot.depth)
    level = ground.make_level(bounds, "terrace", rng.uniform(0.5, 1.0))
    ground.lead_way(bounds, level, True, rng.uniform(2.5, 6.0), rng.uniform(0.15, 0.5))
    if rng.random() < 0.35:
        ground.put(draw_church(rng))
    else:
        room = rng.uniform(0.4, 0.6) * plot.length, rng.uniform(0.45, 0.65) * plot.depth
        ground.put(draw_hall(*room, rng), rng.uniform(-0.15, 0.15) * plot.length)


def draw_sunken_court(ground: Ground) -> None:
    """A plaza under the street between two rows of houses, with a stair or ramp down."""
    plot, rng = ground.plot, ground.rng
    put_rows(ground, rng.uniform(7.0, 9.0))
    bounds = ground.rectangle(rng.uniform(0.5, 0.8) * plot.length, plot.depth - 20.0)
    level = ground.make_level(bounds, "court", 0.0, -rng.uniform(1.5, 4.0))
    ground.lead_way(bounds, level, False, rng.uniform(2.0, 4.0), rng.uniform(0.15, 0.5))


def draw_gate_court(ground: Ground) -> None:
    """A yard surrounded by wings: one enters it by a gate under them."""
    plot, rng = ground.plot, ground.rng
    level = ground.rectangle(plot.length - 24.0, plot.depth - 24.0)
    ground.make_level(level, "court", rng.uniform(0.2, 0.9))
    ground.put(draw_perimeter(plot.length - 4.0, plot.depth - 4.0, rng))


def draw_garden_terraces(ground: Ground) -> None:
    """Levels of 1.2 to 3 m over each other with walls between, stairs, and a few sheds."""
    plot, rng = ground.plot, ground.rng
    across, side = ground.rises_across()
    length, depth = (plot.length, plot.depth) if across else (plot.depth, plot.length)
    wide = rng.uniform(7.0, 14.0)
    before = ground.heights.copy()
    for start in np.arange(-depth / 2, depth / 2 - wide, wide):
        middle = side * (start + wide / 2)
        bounds = (
            ground.rectangle(length, wide, 0.0, middle) if across else ground.rectangle(wide, length, middle)
        )
        ground.make_level(bounds, "terrace", rng.uniform(0.3, 0.8))
    stair = np.abs((ground.u if across else ground.v) - rng.uniform(-0.3, 0.3) * length) < 1.25
    ground.heights[stair] = before[stair]
    for _ in range(2):
        place = rng.uniform(-0.4, 0.4, 2) * [plot.length, plot.depth]
        ground.put(draw_garden_shed(rng), *map(float, place))


def draw_level_roof(ground: Ground) -> None:
    """A terrace uphill, and built against its wall a house whose flat roof is as high."""
    plot, rng = ground.plot, ground.rng
    across, side = ground.rises_across()
    length, depth = (plot.length, plot.depth) if across else (plot.depth, plot.length)
    deep, room = rng.uniform(9.0, 14.0), rng.uniform(0.5, 0.95) * length

    def place(size: float, middle: float, along: float) -> Bounds:
        middle *= side
        return ground.rectangle(along, size, 0.0, middle) if across else ground.rectangle(size, along, middle)

    upper = place(depth / 2, depth / 4, length)
    level = ground.make_level(upper, "terrace", rng.uniform(0.5, 0.9))
    lower = place(depth / 2 - 2.0, -depth / 4 - 1.0, length)
    foot = ground.make_level(lower, "court", rng.uniform(0.1, 0.6))
    if level - foot < STOREY_M:
        ground.heights[ground.within(lower)] = level - rng.uniform(1.0, 2.0) * STOREY_M
    ground.put_flat(place(deep, -deep / 2 - 0.3, room), level + rng.uniform(-0.2, 0.5))


def draw_garages(ground: Ground) -> None:
    """Two rows of houses, and ramps down to garages under them."""
    rng, plot = ground.rng, ground.plot
    put_rows(ground, 11.0)
    wide, slope = rng.uniform(3.0, 5.0), rng.uniform(0.12, 0.22)
    for side in (-1.0, 1.0):
        start = rng.uniform(-0.4, 0.1) * plot.length
        bounds = ground.rectangle(16.0, wide, start + 8.0, side * (plot.depth / 2 - 11.0 - wide / 2 - 2.5))
        inside = ground.within(bounds)
        ground.heights[inside] -= slope * (ground.u[inside] - start)
        ground.levels.append(Level("court", plot, bounds))


def draw_houses(ground: Ground) -> None:
    """Rows of houses on the slope, the lane between them a few metres wide."""
    put_rows(ground, ground.rng.uniform(0.5, 0.9) * (ground.plot.depth / 2 - 2.0))


def put_rows(ground: Ground, deep: float) -> None:
    """Have two rows of town houses put up along the streets."""
    plot, rng = ground.plot, ground.rng
    for side in (-1.0, 1.0):
        u = -plot.length / 2 + 2.0
        while (frontage := rng.uniform(6.5, 13.0)) + u < plot.length / 2 - 2.0:
            if rng.random() < 0.85:
                design = draw_town_house(frontage, deep, rng)
                ground.put(
                    design, u + frontage / 2, side * (plot.depth / 2 - deep / 2 - 1.5), np.pi * (side > 0)
                )
            u += frontage


def draw_bridge_house(ground: Ground) -> None:
    """A house in a court, and a bridge from the street to an upper floor of it."""
    plot, rng = ground.plot, ground.rng
    bounds = ground.rectangle(0.9 * plot.length, 0.9 * plot.depth)
    level = ground.make_level(bounds, "court", 0.3, -rng.uniform(2.0, 4.0))
    ground.lead_way(bounds, level, False, 4.0, rng.uniform(0.15, 0.3))
    deep, high = 0.45 * plot.depth, float(STOREY_M * rng.integers(2, 5))
    ground.put_flat(ground.rectangle(0.5 * plot.length, deep), level + high)
    x, y = plot.at(0.0, plot.depth / 4 + deep / 4 + 1.0)
    length, wide = plot.depth / 2 - deep / 2 + 3.0, rng.uniform(2.0, 4.0)

    def span(site: BuildingSite) -> None:
        end = plot.at(0.0, plot.depth / 2 + 2.0)
        deck = upright_box(
            float(x), float(y), float(site.terrain.at(end[None])[0]) - 0.3, (wide, length, 0.45), plot.angle
        )
        site.surfaces.append(ScannedSurfaces.of(deck, BRIDGE_DECK))

    ground.later.append(span)


def draw_quarry(ground: Ground) -> None:
    """A pit with upright walls and a ramp down."""
    plot, rng = ground.plot, ground.rng
    bounds = ground.rectangle(0.9 * plot.length, 0.9 * plot.depth)
    level = ground.make_level(bounds, "court", 0.0, -rng.uniform(3.0, 9.0))
    inside = ground.within(bounds)
    ground.heights[inside] += rng.normal(0.0, 0.15, inside.sum())
    ground.lead_way(bounds, level, False, rng.uniform(4.0, 7.0), rng.uniform(0.15, 0.4))


def draw_hillside_hall(ground: Ground) -> None:
    """A hall dug into the slope, its roof hardly over the ground uphill."""
    plot, rng = ground.plot, ground.rng
    bounds = ground.rectangle(rng.uniform(0.6, 0.9) * plot.length, rng.uniform(0.5, 0.8) * plot.depth)
    around = ground.within(bounds.buffered(1.0))
    if around.any():
        ground.put_flat(bounds, float(ground.heights[around].max()) + rng.uniform(0.3, 1.5))


KINDS: tuple[Callable[[Ground], None], ...] = (
    draw_podium,
    draw_sunken_court,
    draw_houses,
    draw_level_roof,
    draw_gate_court,
    draw_hillside_hall,
    draw_garden_terraces,
    draw_bridge_house,
    draw_garages,
    draw_quarry,
)
