"""The default unit method: rows along fronts, each divided along the walls its points show."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from eaves.methods import Emit, ignore, parameter
from eaves.model import Points, Values
from eaves.units.base import Division, UnitMethod
from eaves.units.chain import best_walls
from eaves.units.division import RowUnits, divide_outline, label_cells
from eaves.units.merging import merged_units
from eaves.units.rows import CELL_M, Plan, Row, rows_of
from eaves.units.volumes import main_volumes
from eaves.units.wall_evidence import wall_odds, wall_signs

SMALLEST_BLOCK_M2 = 60.0
"""A smaller outline is one building: two of the narrowest and shallowest houses fill as much."""


class RowWalls(UnitMethod):
    """Houses in rows."""

    name: ClassVar[str] = "row_walls"
    idea: ClassVar[str] = "Rows along fronts, each divided where its points show walls, by one sum."
    paper: ClassVar[str] = "own"

    narrowest: float = parameter(4.5, "Width under which a unit is unlikely.", unit="m", gt=0.0)
    spread: float = parameter(0.15, "Spread of the logarithm of widths below the narrowest.", gt=0.0)
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
        odds = wall_odds(wall_signs(row, points, 0.03))
        width = np.maximum(np.arange(1, len(odds) + 1) * CELL_M, CELL_M)
        score = -0.5 * (np.minimum(np.log(width / self.narrowest), 0.0) / self.spread) ** 2
        score = np.concatenate([[-np.inf], score])
        walls, certainty = best_walls(odds, score)
        return RowUnits(row, walls, certainty)


def directions_of(outline: Polygon) -> NDArray[np.float64]:
    """Unit vectors (K, 2) along the longest edges of an outline, each direction once."""
    step = np.vstack([np.diff(np.asarray(ring.coords)[:, :2], axis=0) for ring in rings_of(outline)])
    length = np.hypot(step[:, 0], step[:, 1])
    angles: list[float] = []
    for k in np.argsort(-length, kind="stable").tolist():
        if length[k] < SHORTEST_EDGE_M or len(angles) == MOST_DIRECTIONS:
            break
        angle = float(np.arctan2(step[k, 1], step[k, 0]))
        if all(abs(np.mod(angle - other + np.pi / 2, np.pi) - np.pi / 2) > SAME_RAD for other in angles):
            angles.append(angle)
    return np.column_stack([np.cos(angles), np.sin(angles)])


def rings_of(outline: Polygon) -> list[shapely.LinearRing]:
    """The outer ring and the holes."""
    return [outline.exterior, *outline.interiors]


SHORTEST_EDGE_M, MOST_DIRECTIONS, SAME_RAD = 3.0, 8, float(np.radians(4.0))
"""Edges so long (m) show how walls run; so many directions, so far apart, are looked at."""
