"""The ground of a simulated town: flat, sloping, hilly or terraced, with an embankment or a canal."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from eaves.model import Bounds, Mask, Values

TerrainKind = Literal["flat", "slope", "hilly", "terraced"]

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

    flat: swells of 0.15 m. slope: 4 to 9 % in any direction. hilly: swells of 3 to 8 m in 150 to 350 m.
    terraced: a slope of 7 to 12 % in steps of 1.5 to 3 m with retaining walls one lattice square wide. On
    all of them 2 cm of unevenness.
    """
    blank = Terrain.blank(bounds)
    xy = blank.nodes()
    heights = LEVEL + _swells(xy, rng, 0.15, (60.0, 150.0))
    direction = rng.uniform(0.0, 2 * np.pi)
    along = (xy[..., 0] - bounds.west) * np.cos(direction) + (xy[..., 1] - bounds.south) * np.sin(direction)
    if kind == "slope":
        heights = heights + rng.uniform(0.04, 0.09) * along
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
