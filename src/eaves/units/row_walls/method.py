"""The default unit method: rows along fronts, each divided along the walls its points show."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from eaves.methods import Emit, ignore, parameter
from eaves.model import Points, Values
from eaves.units.row_walls.chain import best_walls, total_of
from eaves.units.row_walls.division import RowUnits, divide_outline, label_cells
from eaves.units.row_walls.evidence import wall_odds, wall_signs
from eaves.units.row_walls.merging import merged_units
from eaves.units.row_walls.rows import CELL_M, Plan, Row, rows_of
from eaves.units.row_walls.volumes import main_volumes
from eaves.units.stage import Division, UnitMethod

SMALLEST_BLOCK_M2 = 60.0
"""A smaller outline is one building: two of the narrowest and shallowest houses fill as much."""


class RowWalls(UnitMethod):
    """Houses in rows."""

    name: ClassVar[str] = "row_walls"
    idea: ClassVar[str] = "Rows along fronts, each divided where its points show walls, by one sum."
    paper: ClassVar[str] = "own"

    boldness: float = parameter(
        0.7, "Logarithm of how many false walls are worth as much as a missed one; chosen on simulated towns."
    )
    narrowest: float = parameter(4.0, "Width under which a unit is unlikely.", unit="m", gt=0.0)
    spread: float = parameter(0.15, "Spread of the logarithm of widths below the narrowest.", gt=0.0)
    likeness: float = parameter(0.07, "Spread of the logarithm of widths in a regular row.", gt=0.0)
    odd_share: float = parameter(0.3, "Share of units of another width in a regular row.", gt=0.0, lt=1.0)
    width_range: float = parameter(1.7, "Range of the logarithm of widths of units.", gt=0.0)
    widest_usual: float = parameter(12.0, "Greatest usual width of a regular row.", unit="m", gt=0.0)
    regular_gain: float = parameter(
        2.0, "Logarithm by which a regular row must explain its signs better.", ge=0.0
    )
    deepest: float = parameter(30.0, "Greatest depth of a row.", unit="m", gt=0.0)
    border_odds: float = parameter(-1.0, "Log-odds above which a border of two rows is a wall.")

    def divide(
        self, points: Points, height: Values, outline: Polygon, spacing: float, emit: Emit = ignore
    ) -> Division:
        """The division; see the class."""
        whole = Division((outline,), (1.0,))
        if outline.area < SMALLEST_BLOCK_M2:
            return whole
        volumes = main_volumes(outline, points, height)
        plan = Plan.of(outline, volumes, points)
        rows = list(rows_of(plan, directions_of(outline), self.deepest))
        if not rows:
            return whole
        found = [self.walls_of(row, points) for row in rows]
        emit("rows", rows)
        label = np.zeros(plan.main.shape, np.int32)
        label_cells(plan, label, found, 1)
        label, found = merged_units(plan, label, found, points, self.border_odds)
        if label.max() < 2:
            return whole
        parts, certainty = divide_outline(outline, plan, label, found)
        return Division(tuple(parts), tuple(certainty))

    def walls_of(self, row: Row, points: Points) -> RowUnits:
        """The inner walls of one row."""
        odds = np.exp(wall_odds(wall_signs(row, points, 0.03)) + self.boldness)
        width = np.maximum(np.arange(len(odds)), 1) * CELL_M
        broad = np.exp(-0.5 * (np.minimum(np.log(width / self.narrowest), 0.0) / self.spread) ** 2)
        best, weight = total_of(odds, broad) + self.regular_gain, broad
        usual = self.narrowest
        while usual <= min(self.widest_usual, row.length / 3.0):
            regular = self.regular_width(width, usual, broad)
            total = total_of(odds, regular)
            if total > best:
                best, weight = total, regular
            usual *= 1.0 + 0.5 * self.likeness
        return RowUnits(row, *best_walls(odds, weight))

    def regular_width(self, width: Values, usual: float, broad: Values) -> Values:
        """How much more often a unit has a `width` (K,; m) in a row whose houses have a usual width than in
        others.
        """
        peak = (
            np.exp(-0.5 * (np.log(width / usual) / self.likeness) ** 2) / self.likeness / np.sqrt(2 * np.pi)
        )
        return np.asarray(self.odd_share * broad + (1.0 - self.odd_share) * peak * self.width_range)


def directions_of(outline: Polygon) -> NDArray[np.float64]:
    """Unit vectors (K, 2) along the edges of an outline, those with most length first, each once."""
    step = np.vstack([np.diff(np.asarray(ring.coords)[:, :2], axis=0) for ring in rings_of(outline)])
    length = np.hypot(step[:, 0], step[:, 1])
    angle = np.arctan2(step[:, 1], step[:, 0])
    found: list[float] = []
    while len(found) < MOST_DIRECTIONS and len(length):
        apart = np.mod(angle[:, None] - angle[None, :] + np.pi / 2, np.pi) - np.pi / 2
        weight = (np.abs(apart) < SAME_RAD) @ length
        best = int(np.argmax(weight))
        if weight[best] < SHORTEST_EDGE_M:
            break
        mine = np.abs(apart[best]) < SAME_RAD
        found.append(float(angle[best] - np.average(apart[best][mine], weights=length[mine])))
        length, angle = length[~mine], angle[~mine]
    return np.column_stack([np.cos(found), np.sin(found)])


def rings_of(outline: Polygon) -> list[shapely.LinearRing]:
    """The outer ring and the holes."""
    return [outline.exterior, *outline.interiors]


SHORTEST_EDGE_M, MOST_DIRECTIONS, SAME_RAD = 5.0, 8, float(np.radians(2.0))
"""Edges so long (m) show how walls run; so many directions, so far apart, are looked at."""
