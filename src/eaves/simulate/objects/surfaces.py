"""What a pulse can hit: the ground, triangles of buildings and other solid things, bodies of leaves."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from eaves.geometry import FaceTable
from eaves.model import (
    BUILDING,
    GROUND_SURFACE,
    HIGH_VEGETATION,
    LOW_VEGETATION,
    MEDIUM_VEGETATION,
    WALL_SURFACE,
    Bounds,
    Labels,
    Mask,
    Solid,
    Values,
)
from eaves.simulate.objects.exact import ExactBuilding

TerrainKind = Literal["flat", "slope", "steep", "hilly", "terraced"]

CELL = 1.0
"""Spacing of the terrain's nodes (m), and of the grid in which rays are traced."""

MARGIN = 30.0
"""Distance (m) by which the terrain extends beyond the town: oblique pulses at its rim must meet ground."""

LEVEL = 10.0
"""Height of the lowest street, about (m)."""


@dataclass(frozen=True, eq=False)
class Terrain:
    """Heights on a lattice: `heights[i, j]` is the node at x = west + i·cell, y = south + j·cell.

    A square of four nodes is two triangles that meet on its south-west to north-east diagonal. `water` marks
    the squares that are water, one fewer than nodes along each side.
    """

    heights: Values
    water: Mask
    west: float
    south: float
    cell: float = CELL

    @classmethod
    def blank(cls, bounds: Bounds) -> Terrain:
        """Level, dry terrain over `bounds` (m) and a margin."""
        wide = bounds.buffered(MARGIN)
        columns, rows = int(np.ceil(wide.width / CELL)), int(np.ceil(wide.height / CELL))
        heights = np.zeros((columns + 1, rows + 1))
        return cls(heights, np.zeros((columns, rows), bool), wide.west, wide.south)

    def at(self, xy: Values) -> Values:
        """Heights (N,) of the two-triangle surface at (N, 2 or 3); the rim's square beyond the rim."""
        columns, rows = self.water.shape
        x, y = (xy[:, 0] - self.west) / self.cell, (xy[:, 1] - self.south) / self.cell
        i = np.clip(np.floor(x).astype(np.int64), 0, columns - 1)
        j = np.clip(np.floor(y).astype(np.int64), 0, rows - 1)
        fx, fy, z = x - i, y - j, self.heights
        southern = z[i, j] + fx * (z[i + 1, j] - z[i, j]) + fy * (z[i + 1, j + 1] - z[i + 1, j])
        northern = z[i, j] + fy * (z[i, j + 1] - z[i, j]) + fx * (z[i + 1, j + 1] - z[i, j + 1])
        return np.where(fx >= fy, southern, northern)

    def nodes(self) -> Values:
        """Plan coordinates of the nodes, (I, J, 2)."""
        x = self.west + self.cell * np.arange(self.heights.shape[0])
        y = self.south + self.cell * np.arange(self.heights.shape[1])
        return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)


@dataclass(frozen=True)
class Corridor:
    """A straight strip across the town that holds an embankment (height above 0) or a canal (below 0).

    Its axis goes through (x, y) in direction `angle` (radians); `half_width` is that of its crown or bed (m).
    """

    x: float
    y: float
    angle: float
    half_width: float
    height: float
    bank_slope: float = 0.6

    def distance(self, xy: Values) -> Values:
        """Distance (N,) or (I, J) from the axis."""
        across = -(xy[..., 0] - self.x) * np.sin(self.angle) + (xy[..., 1] - self.y) * np.cos(self.angle)
        return np.asarray(np.abs(across))

    @property
    def reach(self) -> float:
        """Distance from the axis (m) beyond which the ground is as it was."""
        return self.half_width + abs(self.height) / self.bank_slope


def make_terrain(kind: TerrainKind, bounds: Bounds, rng: np.random.Generator) -> Terrain:
    """Terrain over `bounds` (m) and a margin.

    flat: swells of 0.15 m. slope: 4 to 9 % in any direction; steep: 9 to 20 %. hilly: swells of 3 to
    8 m in 150 to 350 m. terraced: a slope of 7 to 12 % in steps of 1.5 to 3 m with retaining walls one
    lattice square wide. On all of them 2 cm of unevenness.
    """
    blank = Terrain.blank(bounds)
    xy = blank.nodes()
    heights = LEVEL + _swells(xy, rng, 0.15, (60.0, 150.0))
    direction = rng.uniform(0.0, 2 * np.pi)
    along = (xy[..., 0] - bounds.west) * np.cos(direction) + (xy[..., 1] - bounds.south) * np.sin(direction)
    if kind == "slope":
        heights = heights + rng.uniform(0.04, 0.09) * along
    elif kind == "steep":
        heights = heights + rng.uniform(0.09, 0.20) * along
    elif kind == "hilly":
        heights = heights + _swells(xy, rng, rng.uniform(3.0, 8.0), (150.0, 350.0)) + 0.02 * along
    elif kind == "terraced":
        tilt, step = rng.uniform(0.07, 0.12), rng.uniform(1.5, 3.0)
        risen = tilt * along / step
        heights = heights + step * (np.floor(risen) + 0.25 * (risen - np.floor(risen)))
    heights += rng.normal(0.0, 0.02, heights.shape)
    return replace(blank, heights=heights - min(heights.min() - 2.0, 0.0))


def _swells(xy: Values, rng: np.random.Generator, amplitude: float, lengths: tuple[float, float]) -> Values:
    """A sum of five waves of random direction and phase whose standard deviation is about `amplitude` (m)."""
    total = np.zeros(xy.shape[:-1])
    for _ in range(5):
        direction, phase, length = rng.uniform(0, 2 * np.pi), rng.uniform(0, 2 * np.pi), rng.uniform(*lengths)
        along = xy[..., 0] * np.cos(direction) + xy[..., 1] * np.sin(direction)
        total += np.sin(2 * np.pi * along / length + phase)
    return np.asarray(total * amplitude * np.sqrt(2 / 5))


def cut_corridor(terrain: Terrain, corridor: Corridor) -> Terrain:
    """The terrain with the embankment raised or the canal dug; a canal's bed is level water."""
    distance = corridor.distance(terrain.nodes())
    bank = np.clip((corridor.reach - distance) * corridor.bank_slope, 0.0, abs(corridor.height))
    if corridor.height >= 0:
        return replace(terrain, heights=terrain.heights + bank)
    bed = distance <= corridor.half_width
    heights = terrain.heights - bank
    heights[bed] = heights[bed].min()
    corners = (bed[:-1, :-1], bed[1:, :-1], bed[:-1, 1:], bed[1:, 1:])
    return replace(terrain, heights=heights, water=terrain.water | np.logical_and.reduce(corners))


UP = np.array([0.0, 0.0, 1.0])
"""The vertical."""

FASCIA = 0.25
"""Height of the board at the edge of an overhanging roof (m)."""

SKIRT = 3.0
"""Distance (m) by which the walls of a city model extend below its base, for ground that lies lower there."""

BELOW_ROOF = 0.02
"""Walls under an overhang end this far below the roof (m), so that no wall pierces it."""


@dataclass(frozen=True, eq=False)
class ScannedSurfaces:
    """T triangles (T, 3, 3) in local metres, and what each is: LAS class, building, roof face (0: none)."""

    corners: NDArray[np.float64]
    truth_class: NDArray[np.uint8]
    building: Labels
    plane: Labels

    @classmethod
    def of(
        cls, corners: Iterable[NDArray[np.float64]], truth_class: int, building: int = 0, plane: int = 0
    ) -> ScannedSurfaces:
        """Triangles that all are the same thing."""
        listed = [np.asarray(part, np.float64).reshape(-1, 3, 3) for part in corners]
        stacked = np.concatenate([np.zeros((0, 3, 3)), *listed])
        count = len(stacked)
        return cls(
            stacked,
            np.full(count, truth_class, np.uint8),
            np.full(count, building, np.int32),
            np.full(count, plane, np.int32),
        )

    @classmethod
    def join(cls, parts: Iterable[ScannedSurfaces]) -> ScannedSurfaces:
        """All the triangles of the parts, in order."""
        every = [vars(part).values() for part in (cls.of([], 0), *parts)]
        return cls(*map(np.concatenate, zip(*every, strict=True)))


def tile_polygon(polygon: Polygon) -> NDArray[np.float64]:
    """Triangles (T, 3, 2) that tile a polygon with holes, counter-clockwise."""
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    if len(parts) == 0:
        return np.zeros((0, 3, 2))
    return np.stack([shapely.get_coordinates(shapely.orient_polygons(part))[:3] for part in parts])


def fan(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Triangles (K−2, 3, 3) of a convex polygon in space (K, 3)."""
    return np.stack([np.stack([corners[0], *pair]) for pair in pairwise(corners[1:])])


def curtain(low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float64]:
    """Two upright triangles between a lower segment (2, 3) and the upper one (2, 3) over it."""
    return fan(np.stack([low[0], low[1], high[1], high[0]]))


def curtains(low: NDArray[np.float64], high: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Curtains from each corner of a lower line (K, 3) to the next, up to the line (K, 3) over it."""
    return [curtain(low[k : k + 2], high[k : k + 2]) for k in range(len(low) - 1)]


def closed(ring: NDArray[np.float64]) -> NDArray[np.float64]:
    """The corners of a ring (K, 3) with the first one again at its end."""
    return np.concatenate([ring, ring[:1]])


def building_surfaces(building: ExactBuilding) -> ScannedSurfaces:
    """The roof faces, the walls (set back under overhanging eaves), the fascia boards, the walls at steps."""
    if building.shell is not None:
        return _shell_surfaces(building, building.shell)
    parts = []
    for face in building.faces:
        plan = tile_polygon(face.polygon)
        z = face.height_at(plan.reshape(-1, 2)).reshape(-1, 3, 1)
        parts.append(
            ScannedSurfaces.of([np.concatenate([plan, z], axis=2)], BUILDING, building.number, face.number)
        )
    overhangs = not building.walls.equals(building.footprint)
    walls = []
    solid = building.solid()
    for shell in solid.faces:
        if shell.surface != WALL_SURFACE:
            continue
        corners = solid.vertices[list(shell.rings[0])]
        if overhangs and corners[:, 2].min() < building.base + BELOW_ROOF:
            top = corners[corners[:, 2] > building.base + BELOW_ROOF]
            rim = np.stack([top[0], top[-1]])
            walls.append(curtain(rim - FASCIA * UP, rim))
        else:
            walls.append(fan(corners))
    if overhangs:
        walls += _walls_under_eaves(building)
    return ScannedSurfaces.join([*parts, ScannedSurfaces.of(walls, BUILDING, building.number)])


def _shell_surfaces(building: ExactBuilding, shell: Solid) -> ScannedSurfaces:
    """The faces of a city model as they are, and its lowest ring sunk a little into the ground."""
    table = FaceTable.of_solids([shell])
    corner, face = table.triangles()
    numbers = np.array([*(face.number for face in building.faces), 0], np.int32)  # 0 for `NO_PLANE`
    faces = ScannedSurfaces.of(table.corners[corner], BUILDING, building.number)
    skirts = []
    for number in np.flatnonzero(shell.surfaces == GROUND_SURFACE).tolist():
        high = closed(table.rings_of(number)[0])
        skirts += curtains(high - SKIRT * UP, high)
    labelled = replace(faces, plane=numbers[shell.planes[face]])
    return ScannedSurfaces.join([labelled, ScannedSurfaces.of(skirts, BUILDING, building.number)])


def _walls_under_eaves(building: ExactBuilding) -> list[NDArray[np.float64]]:
    """Upright triangles from the base to just under the roof, along the outline of the walls."""
    walls = []
    for face in building.faces:
        on_face = shapely.intersection(shapely.boundary(building.walls), face.polygon)
        for line in shapely.get_parts(on_face):
            if line.geom_type != "LineString":
                continue
            plan = shapely.get_coordinates(line)
            low = np.column_stack([plan, np.full(len(plan), building.base)])
            high = np.column_stack([plan, face.height_at(plan) - BELOW_ROOF])
            walls += curtains(low, high)
    return walls


def upright_box(
    x: float, y: float, z: float, size: tuple[float, float, float], angle: float, with_top: bool = True
) -> list[NDArray[np.float64]]:
    """Triangles of an upright box: its middle in plan, the height of its foot, its size, its direction."""
    length, width, height = size
    cos, sin = np.cos(angle), np.sin(angle)
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * [length / 2, width / 2]
    plan = np.column_stack([x + corners @ np.array([cos, -sin]), y + corners @ np.array([sin, cos])])
    low = np.column_stack([plan, np.full(4, z)])
    high = low + height * UP
    sides = curtains(closed(low), closed(high))
    return [*sides, fan(high)] if with_top else sides


ELLIPSOID, CONE, BLOCK = 0, 1, 2
"""Shapes of a body of leaves: a broad crown or shrub, a conifer, a clipped hedge."""

MEDIUM_FROM, HIGH_FROM = 0.5, 2.0
"""Tops above ground (m) from which vegetation is called medium and high; national rules differ a little."""


@dataclass(frozen=True, eq=False)
class Foliage:
    """V bodies of leaves.

    `bodies` (V, 9): x, y, z of the centre, half sizes along its own x, y and up, cosine and sine of its
    direction, and the mean loss of a pulse's energy per metre (1/m). `shape` and `truth_class` are (V,).
    """

    bodies: NDArray[np.float64]
    shape: NDArray[np.int32]
    truth_class: NDArray[np.uint8]

    @classmethod
    def none(cls) -> Foliage:
        """No leaves at all."""
        return cls(np.zeros((0, 9)), np.zeros(0, np.int32), np.zeros(0, np.uint8))

    @classmethod
    def join(cls, parts: list[Foliage]) -> Foliage:
        """All the bodies of the parts, in order."""
        every = [vars(part).values() for part in (cls.none(), *parts)]
        return cls(*map(np.concatenate, zip(*every, strict=True)))


def _one(
    shape: int,
    centre: tuple[float, float, float],
    half: tuple[float, float, float],
    angle: float,
    loss: float,
    top: float,
) -> Foliage:
    kind = LOW_VEGETATION if top < MEDIUM_FROM else MEDIUM_VEGETATION if top < HIGH_FROM else HIGH_VEGETATION
    body = np.array([[*centre, *half, np.cos(angle), np.sin(angle), loss]])
    return Foliage(body, np.array([shape], np.int32), np.array([kind], np.uint8))


def grow_tree(
    x: float, y: float, ground: float, rng: np.random.Generator, leaf_loss: float = 2.5
) -> tuple[Foliage, ScannedSurfaces]:
    """A tree's leaves and its trunk.

    Three in four are broadleaved: height 5 to 20 m (mean 10), crown as wide as 0.45 to 0.75 of it, of one to
    four lobes. The others are conifers. `leaf_loss` (1/m) is the loss of energy per metre of crown.
    """
    height = float(np.clip(rng.gamma(6.0, 1.75), 4.0, 22.0))
    parts = []
    if rng.random() < 0.75:
        radius = height * rng.uniform(0.22, 0.38)
        clear = height * rng.uniform(0.15, 0.35)
        for _ in range(int(rng.integers(1, 5))):
            share = rng.uniform(0.6, 1.0)
            shift = radius * (1 - share) * np.array([rng.uniform(-1.2, 1.2), rng.uniform(-1.2, 1.2)])
            deep = (height - clear) / 2 * rng.uniform(0.7, 1.0)
            centre = (x + shift[0], y + shift[1], ground + height - deep - rng.uniform(0, 0.15) * height)
            half = (radius * share, radius * share, deep)
            parts.append(_one(ELLIPSOID, centre, half, 0.0, leaf_loss * rng.uniform(0.6, 1.5), height))
    else:
        clear, radius = height * rng.uniform(0.05, 0.2), height * rng.uniform(0.13, 0.22)
        half = (radius, radius, (height - clear) / 2)
        centre = (x, y, ground + (height + clear) / 2)
        parts.append(_one(CONE, centre, half, 0.0, 1.6 * leaf_loss, height))
    thick = 0.02 * height + 0.08
    trunk = upright_box(x, y, ground - 0.5, (thick, thick, 0.5 * height), 0.0)
    return Foliage.join(parts), ScannedSurfaces.of(trunk, HIGH_VEGETATION)


def grow_shrub(x: float, y: float, ground: float, rng: np.random.Generator) -> Foliage:
    """A shrub of 0.3 to 2.5 m."""
    height, radius = rng.uniform(0.3, 2.5), rng.uniform(0.4, 1.2)
    half = (radius, radius * rng.uniform(0.7, 1.0), 0.55 * height)
    return _one(ELLIPSOID, (x, y, ground + 0.45 * height), half, rng.uniform(0, np.pi), 3.0, height)


def grow_hedge(
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    ground: NDArray[np.float64],
    rng: np.random.Generator,
) -> Foliage:
    """A clipped hedge of 0.8 to 2.2 m along a segment, in pieces that follow the `ground` (K,) under it."""
    height, thick = rng.uniform(0.8, 2.2), rng.uniform(0.5, 0.9)
    steps = np.linspace(0.0, 1.0, len(ground) + 1)
    corners = start + steps[:, None] * (end - start)
    length = float(np.hypot(*(end - start))) / len(ground)
    angle = float(np.arctan2(*(end - start)[::-1]))
    pieces = []
    for middle, level in zip((corners[1:] + corners[:-1]) / 2, ground, strict=True):
        half = (length / 2, thick / 2, height / 2)
        pieces.append(_one(BLOCK, (*middle, level + height / 2), half, angle, 4.0, height))
    return Foliage.join(pieces)
