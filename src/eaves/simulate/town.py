"""A town of which every plane, corner and leaf is known."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from shapely import Polygon

from eaves.model import LOCAL_METRES, Bounds, CoordinateSystem, Values
from eaves.simulate.objects.clutter import (
    hang_power_line,
    install,
    park_car,
    park_lorry,
    put_fence,
    span_bridge,
)
from eaves.simulate.objects.exact import ExactBuilding, Mass, Plane
from eaves.simulate.objects.houses import make_building
from eaves.simulate.objects.streets import Placement, Plot, TownStyle, draw_block, lay_streets
from eaves.simulate.objects.surfaces import (
    Corridor,
    Foliage,
    ScannedSurfaces,
    Terrain,
    TerrainKind,
    building_surfaces,
    cut_corridor,
    grow_hedge,
    grow_shrub,
    grow_tree,
    make_terrain,
)
from eaves.simulate.ray_grid import RayGrid, index_town

logger = logging.getLogger(__name__)

ORIGIN = (2400.0, 4800.0)
"""World metres of local (0, 0): a corner of blocks."""

RIM = 2.0
"""Buildings stay this far inside the town's bounds (m): none is cut."""

APART = 0.05
"""Buildings that overlap by less than this (m²) share a party wall; more, and the later one is not built."""

SHORTEST_CORRIDOR = 250.0
"""A town whose side is shorter (m) has no canal and no embankment."""

GARDEN_REACH = 12.0
"""The trees and cars of a block stand at most this far outside its plot (m)."""

SEARCH = 50.0
"""Side of the squares in which neighbours are looked up (m)."""

TRUNK_CLEARANCE = 0.6
"""A trunk stands at least this far from a wall (m); crowns may hang over roofs."""


@dataclass(frozen=True, eq=False)
class Town:
    """Everything that stands over `bounds`.

    Parameters
    ----------
    bounds : Bounds
        Local metres about `origin`.
    terrain : Terrain
        Heights and classes of the ground.
    buildings : tuple of ExactBuilding
        The buildings.
    furniture : Surfaces
        Cars, walls, vents and other surfaces that are no building.
    foliage : Foliage
        Trees, shrubs and hedges.
    origin : (float, float)
        World metres of local (0, 0).
    system : CoordinateSystem
        Reference system.

    Examples
    --------
    >>> from eaves.simulate import simulate_town
    >>> simulate_town(0.01, seed=3).bounds.width
    100.0
    """

    bounds: Bounds
    terrain: Terrain
    buildings: tuple[ExactBuilding, ...]
    furniture: ScannedSurfaces
    foliage: Foliage
    origin: tuple[float, float] = ORIGIN
    system: CoordinateSystem = LOCAL_METRES

    @cached_property
    def _grid(self) -> RayGrid:
        surfaces = ScannedSurfaces.join([*map(building_surfaces, self.buildings), self.furniture])
        return index_town(self.terrain, surfaces, self.foliage)

    def ray_grid(self) -> RayGrid:
        """The grid of the town for the ray tracer; made once."""
        return self._grid

    @property
    def roof_planes(self) -> dict[int, Plane]:
        """The coefficients of every roof face by its number, in local metres."""
        return {face.number: face.coefficients for building in self.buildings for face in building.faces}


def simulate_town(
    area_km2: float = 0.09,
    buildings: int | None = None,
    terrain: TerrainKind = "flat",
    trees: float = 1.0,
    seed: int = 0,
    *,
    style: TownStyle = "mixed",
    clutter: bool = True,
    leaf_loss: float = 2.5,
) -> Town:
    """A town on a square.

    Parameters
    ----------
    area_km2 : float
        Area of the square (km²), at least 0.01 (100 m by 100 m).
    buildings : int or None
        Largest number of buildings; None builds on every plot. Plots left over are lawns with trees.
    terrain : str
        `flat` (with a canal and bridges), `slope`, `steep`, `hilly` or `terraced` (with an embankment).
    trees : float
        Share of the trees, shrubs and hedges of an ordinary town (≥ 0): 0 for none, above 1 for more.
    seed : int
        The same seed gives the same town.
    style : str
        `suburb` (houses and gardens), `centre` (closed fronts, blocks around courts), `village` (houses,
        halls with yards, thickets) or `mixed`.
    clutter : bool
        True if buildings have vents, skylights, solar panels and balconies, which the reference models leave
        out.
    leaf_loss : float
        Loss of a pulse's energy per metre of crown (1/m): about 2.5 in leaf, 0.6 out of leaf.

    Returns
    -------
    Town
        The town; `scan_town` makes points of it.

    Raises
    ------
    ValueError
        When the area is under 0.01 km², or `buildings` is below 0.

    Examples
    --------
    >>> from eaves.simulate import simulate_town
    >>> town = simulate_town(0.01, terrain="hilly", style="suburb", seed=3)
    >>> len(town.buildings) > 0
    True
    """
    built, plots, corridor = lay_site(area_km2, buildings, terrain, seed, style)
    bounds, ground = built.bounds, built.terrain
    limit = len(plots) * 1000 if buildings is None else buildings
    for number, plot in enumerate(plots):
        room = len(built.buildings) < limit
        uncut = bool(bounds.buffered(-RIM).contains(plot.corners()).all())
        draw_block(plot, style, uncut, room, np.random.default_rng([seed, 34, number]))
        for placement in plot.placements:
            if len(built.buildings) < limit:
                built.build(placement)
        built.furnish(plot, trees, leaf_loss, np.random.default_rng([seed, 35, number]))
    if clutter:
        built.install(seed)
    if buildings is not None and len(built.buildings) < buildings:
        logger.warning(
            "only %d of %d buildings fit on %.3g km²; ask for a larger area",
            len(built.buildings),
            buildings,
            area_km2,
        )
    extras = put_extras(bounds, ground, corridor, np.random.default_rng([seed, 36]))
    return built.finish(extras)


def lay_site(
    area_km2: float, buildings: int | None, terrain: TerrainKind, seed: int, style: TownStyle
) -> tuple[BuildingSite, list[Plot], Corridor | None]:
    """The empty ground of a town, its plots, and its canal or embankment where it has one."""
    if area_km2 < 0.01:
        raise ValueError(f"area_km2 must be at least 0.01 (100 m by 100 m), not {area_km2}")
    if buildings is not None and buildings < 0:
        raise ValueError(f"buildings must be at least 0, not {buildings}")
    side = float(np.round(np.sqrt(area_km2 * 1e6)))
    bounds = Bounds(0.0, 0.0, side, side)
    corridor = (
        _draw_corridor(terrain, np.random.default_rng([seed, 33])) if side >= SHORTEST_CORRIDOR else None
    )
    gap = 0.0 if corridor is None else 2 * corridor.reach
    plots, strip = lay_streets(bounds, style, gap, np.random.default_rng([seed, 31]))
    ground = make_terrain(terrain, bounds, np.random.default_rng([seed, 32]))
    if corridor is not None:
        corridor = replace(corridor, x=strip.x, y=strip.y, angle=strip.angle)
        ground = cut_corridor(ground, corridor)
    return BuildingSite(bounds, ground), plots, corridor


def _draw_corridor(kind: TerrainKind, rng: np.random.Generator) -> Corridor:
    """A canal in flat towns, an embankment in others; its place is yet to be found."""
    height = -rng.uniform(1.2, 2.0) if kind == "flat" else rng.uniform(2.5, 4.5)
    return Corridor(0.0, 0.0, 0.0, rng.uniform(4.0, 7.0), height)


def put_extras(
    bounds: Bounds, terrain: Terrain, corridor: Corridor | None, rng: np.random.Generator
) -> list[ScannedSurfaces]:
    """Bridges over the canal every 70 m, and in a town wide enough a power line along one side."""
    extras = []
    if corridor is not None and corridor.height < 0:
        along = np.array([np.cos(corridor.angle), np.sin(corridor.angle)])
        for step in np.arange(-10, 11) * 70.0:
            x, y = np.array([corridor.x, corridor.y]) + step * along
            if bounds.buffered(-15.0).contains(np.array([[x, y]])).all():
                extras.append(span_bridge(float(x), float(y), corridor, terrain))
    if bounds.width >= 200.0:
        x = rng.uniform(0.02, 0.06) * bounds.width
        start, end = (
            np.array([x, bounds.south - 10.0]),
            np.array([x + rng.uniform(-8.0, 8.0), bounds.north + 10.0]),
        )
        extras.append(hang_power_line(start, end, terrain, rng))
    return extras


def _squares(extent: Bounds) -> list[tuple[int, int]]:
    """The squares of a coarse grid that a rectangle meets."""
    columns = range(int(extent.west // SEARCH), int(extent.east // SEARCH) + 1)
    rows = range(int(extent.south // SEARCH), int(extent.north // SEARCH) + 1)
    return [(column, row) for column in columns for row in rows]


class BuildingSite:
    """The town while it is being built."""

    def __init__(self, bounds: Bounds, terrain: Terrain) -> None:
        self.bounds, self.area, self.terrain = bounds, bounds.buffered(-RIM), terrain
        self.buildings: list[ExactBuilding] = []
        self.masses: list[tuple[Mass, ...]] = []
        self.overhangs: list[float] = []
        self.surfaces: list[ScannedSurfaces] = []
        self.leaves: list[Foliage] = []
        self.outlines: list[Polygon] = []
        self.at: dict[tuple[int, int], set[int]] = {}
        self.faces = 0

    def build(self, placement: Placement) -> None:
        """Put up the building, unless it would stand in another one or cannot be one closed solid."""
        at_street = [
            mass.translated(placement.angle, placement.x, placement.y, 0.0)
            for mass in placement.design.masses
        ]
        outline = shapely.union_all([mass.polygon for mass in at_street])
        if not self.area.contains(shapely.get_coordinates(outline)).all() or self.overlaps(outline):
            return
        base = float(np.floor(self.levels_around(outline).min() * 1000.0) / 1000.0)
        masses = [mass.translated(0.0, 0.0, 0.0, self.floor_of(outline)) for mass in at_street]
        number = len(self.buildings) + 1
        design = placement.design
        try:
            building = make_building(masses, number, self.faces + 1, design.kind, base, design.overhang)
            building.solid()
        except ValueError as reason:
            logger.info("a %s is left out: %s", design.kind, reason)
            return
        self.masses.append(tuple(masses))
        self.overhangs.append(design.overhang)
        self.add(building)

    def levels_around(self, outline: Polygon) -> Values:
        """The ground (N,) along the walls (m)."""
        return self.terrain.at(shapely.get_coordinates(shapely.segmentize(shapely.boundary(outline), 2.0)))

    def floor_of(self, outline: Polygon) -> float:
        """The level (m) that a building stands on: three quarters of the ground around it lie lower."""
        return float(np.quantile(self.levels_around(outline), 0.75))

    def finish(self, extras: Sequence[ScannedSurfaces] = ()) -> Town:
        """The town of all that was built and planted, and of `extras`."""
        surfaces = ScannedSurfaces.join([*self.surfaces, *extras])
        return Town(self.bounds, self.terrain, tuple(self.buildings), surfaces, Foliage.join(self.leaves))

    def add(self, building: ExactBuilding) -> None:
        """Put up a building that is drawn, where it stands."""
        self.buildings.append(building)
        self.outlines.append(building.footprint)
        self.locate(len(self.outlines) - 1)
        self.faces += len(building.faces)

    def locate(self, k: int) -> None:
        """Note in which squares the k-th outline lies."""
        for square in _squares(Bounds(*self.outlines[k].bounds)):
            self.at.setdefault(square, set()).add(k)

    def overlaps(self, outline: Polygon) -> bool:
        """True if the outline overlaps a building that is there."""
        outlines = (self.outlines[k] for k in self.near(Bounds(*outline.bounds)))
        return any(shapely.intersection(neighbour, outline).area > APART for neighbour in outlines)

    def near(self, extent: Bounds) -> list[int]:
        """The numbers of the outlines whose bounds meet a rectangle, in the order they were built."""
        numbers = sorted({k for square in _squares(extent) for k in self.at.get(square, ())})
        return [k for k in numbers if Bounds(*self.outlines[k].bounds).intersects(extent)]

    def install(self, seed: int) -> None:
        """Put on the buildings what no reference model has."""
        tree = shapely.STRtree(self.outlines)

        def free(place: Values) -> bool:
            return len(tree.query(shapely.Point(place), predicate="within")) == 0

        for building in self.buildings:
            rng = np.random.default_rng([seed, 37, building.number])
            self.surfaces.append(install(building, free, rng))

    def furnish(self, plot: Plot, trees: float, leaf_loss: float, rng: np.random.Generator) -> None:
        """Plant and park what the plot holds, where no building stands."""
        neighbours = self.near(Bounds.of(plot.corners()).buffered(GARDEN_REACH))
        built = shapely.union_all([shapely.buffer(self.outlines[k], TRUNK_CLEARANCE) for k in neighbours])
        shapely.prepare(built)

        def free(place: Values) -> bool:
            return not shapely.contains_xy(built, place[0], place[1])

        def level(place: Values) -> float:
            return float(self.terrain.at(place[None, :])[0])

        def plant(place: Values) -> None:
            leaves, trunk = grow_tree(float(place[0]), float(place[1]), level(place), rng, leaf_loss)
            self.leaves.append(leaves)
            self.surfaces.append(trunk)

        for place in plot.trees:
            if rng.random() < trees and free(place):
                plant(place)
        for place in plot.shrubs:
            if rng.random() < trees and free(place):
                self.leaves.append(grow_shrub(float(place[0]), float(place[1]), level(place), rng))
        for start, end in plot.hedges:
            steps = max(1, int(np.hypot(*(end - start)) / 2.0))
            middle = start + (np.arange(steps)[:, None] + 0.5) / steps * (end - start)
            if rng.random() < trees and all(free(place) for place in middle):
                self.leaves.append(grow_hedge(start, end, self.terrain.at(middle), rng))
        for start, end in plot.fences:
            if not shapely.intersects(built, shapely.LineString([start, end])):
                self.surfaces.append(put_fence(start, end, self.terrain, rng))
        for x, y, angle in plot.cars:
            place = np.array([x, y])
            if free(place):
                self.surfaces.append(park_car(x, y, level(place), angle, rng))
        for x, y, angle in plot.lorries:
            self.surfaces.append(park_lorry(x, y, level(np.array([x, y])), angle, rng))
        low, high = plot.corners().min(axis=0), plot.corners().max(axis=0)
        # a wooded town has trees wherever there is room
        for _ in range(int(max(trees - 1.0, 0.0) * len(plot.trees))):
            place = rng.uniform(low, high)
            if free(place):
                plant(place)
