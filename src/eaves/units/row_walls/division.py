"""Units merged where no wall shows, and a block's outline divided into them without gap or overlap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString, Polygon

from eaves.geometry.inside import edges_of, points_in_polygons
from eaves.geometry.rings import COORDINATE_STEP, joined_pieces, owned_by_neighbours, pieces_between
from eaves.methods import Method, parameter
from eaves.units.row_walls.evidence import WINDOW_M, Roofs
from eaves.units.row_walls.rows import CELL_M, HouseRow, Plan

Walls = dict[tuple[int, int], float]
"""The probability of a wall between two units, by their numbers from 1, the smaller first."""


@dataclass(frozen=True, eq=False)
class RowUnits:
    """A row, its inner walls (W,) as steps along it, and how sure each is (W,)."""

    row: HouseRow
    walls: NDArray[np.int64]
    certainty: NDArray[np.float64]


def label_unit_cells(plan: Plan, label: NDArray[np.int32], rows: Sequence[RowUnits], first: int) -> int:
    """Writes the number of its unit, from `first` on, into each cell of `label` that a row claims; how many
    units there are.
    """
    number = first
    for units in rows:
        row = units.row
        s, t = row.grid()
        inside = (t >= row.first) & (t < row.last)
        step = np.broadcast_to(np.arange(len(row.first)), s.shape)[inside]
        unit = np.searchsorted(units.walls, step, side="right")
        cells = plan.cells(*row.place(s[inside], t[inside]))
        label[cells] = number + unit
        number += len(units.walls) + 1
    return number - first


def carried_on(
    plan: Plan,
    label: NDArray[np.int32],
    start: NDArray[np.float64],
    way: NDArray[np.float64],
    farthest: float,
) -> float:
    """Distance (m), at most `farthest`, by which a wall that ends at `start` goes on along `way` before it
    meets another unit.
    """
    away = np.arange(2.0 * CELL_M, farthest, CELL_M)
    met = label[plan.cells(*(start + away[:, None] * way).T)] > 0
    return float(away[np.argmax(met)]) if met.any() else farthest


def wall_lines(
    plan: Plan, label: NDArray[np.int32], rows: Sequence[RowUnits], farthest: float
) -> list[LineString]:
    """The lines that divide the block: the inner walls, carried on, and the borders of each row's ground."""
    lines = []
    for units in rows:
        row = units.row
        for wall in units.walls.tolist():
            start = min(row.first[wall - 1], row.first[wall])
            far = max(row.last[wall - 1], row.last[wall])
            ends = np.column_stack(row.place(np.array([wall, wall]) * CELL_M, np.array([start, far])))
            ends[0] -= carried_on(plan, label, ends[0], -row.across, farthest) * row.across
            ends[1] += carried_on(plan, label, ends[1], row.across, farthest) * row.across
            lines.append(LineString(ends))
        lines.append(row.frame())
    return lines


def divide_outline(
    outline: Polygon, plan: Plan, label: NDArray[np.int32], rows: Sequence[RowUnits], farthest: float
) -> tuple[list[Polygon], list[int]]:
    """The parts of an outline, one for each unit that `label` (H, W) has cells of, and the units' numbers
    from 1; the parts fill it.

    A wall is carried on through annexes by at most `farthest` (m).
    """
    walls = np.array(wall_lines(plan, label, rows, farthest), object)
    corners = shapely.points(shapely.get_coordinates([outline, *walls]))
    wall, corner = shapely.STRtree(corners).query(walls, predicate="dwithin", distance=NARROW_M)
    necks = shapely.shortest_line(corners[corner], walls[wall])
    pieces = pieces_between(outline, [*walls, *necks[shapely.length(necks) > COORDINATE_STEP]])
    count = int(label.max(initial=0))
    joined = joined_pieces(pieces, owners_by_cells(pieces, plan, label, count), count)
    parts = {k + 1: part for k, part in enumerate(joined) if part is not None}
    return list(parts.values()), list(parts)


def owners_by_cells(pieces: Sequence[Polygon], plan: Plan, label: NDArray[np.int32], count: int) -> list[int]:
    """The unit (from 0) that has most cells in each piece; a piece without, or one narrower than `NARROW_M`,
    goes to the neighbour it shares the longest border with.
    """
    wide = ~shapely.is_empty(shapely.buffer(pieces, -0.5 * NARROW_M, join_style="mitre"))
    row, column = np.nonzero(label > 0)
    numbers = label[row, column] - 1
    owner = [-1] * len(pieces)
    cell, piece = points_in_polygons(
        plan.places(row, column), *edges_of(np.array(pieces, object)), len(pieces)
    )
    votes = np.bincount(piece * count + numbers[cell], minlength=len(pieces) * count).reshape(-1, count)
    for k in range(len(pieces)):
        area = CELL_M**2 * votes[k].max(initial=0)
        if wide[k] and area > max(0.25 * pieces[k].area, 0.5):
            owner[k] = int(np.argmax(votes[k]))
    return owned_by_neighbours(pieces, owner, count)


NARROW_M = 1.0
"""What is narrower is no part of a house: a strip between a wall and a step of the outline."""

MOST_ODDS = 5.0
"""Log-odds further from 0 are as sure as these."""

OF_ROWS = (0.06, 0.82)
OF_BORDERS = (-0.92, 0.75)
"""Log-odds that a wall is there: a + b · log-odds found; learned on the walls of the towns that the weights
were learned on, by `python -m benchmarks.accuracy.unit_weights`.
"""


class MergeRules(Method):
    """Rules for units that are too small, and walls that are too short."""

    smallest_unit: float = parameter(
        25.0,
        "Area of the smallest unit; a smaller one is part of that with which it shares its longest border.",
        unit="m2",
        ge=0.0,
    )
    shortest_border: float = parameter(
        WINDOW_M, "Shortest common border of units that stand wall to wall.", unit="m", ge=0.0
    )


def merged_units(
    plan: Plan,
    label: NDArray[np.int32],
    rows: Sequence[RowUnits],
    roofs: Roofs,
    limits: MergeRules,
) -> tuple[NDArray[np.int32], Walls]:
    """The labels with small units given to those that they share the longest border with, numbered without
    gaps; and the walls between them.
    """
    count = int(label.max(initial=0))
    owner = np.repeat(np.arange(len(rows)), [len(row.walls) + 1 for row in rows])
    target = np.arange(count + 1)
    area = np.bincount(label.ravel(), minlength=count + 1) * CELL_M**2
    borders = borders_between(label)
    for unit in range(count, 0, -1):
        longest = max(
            (
                (len(places), -neighbour)
                for pair, places in borders.items()
                if unit in pair
                for neighbour in pair
                if neighbour != unit
            ),
            default=None,
        )
        if longest is not None and area[unit] < limits.smallest_unit:
            target[head_of(target, unit)] = head_of(target, -longest[1])
    target = np.array([head_of(target, unit) for unit in range(count + 1)])
    names, number = np.unique(target[label], return_inverse=True)
    number = number.reshape(label.shape)
    if names[0] != 0:
        number = number + 1
    final = np.zeros(count + 1, np.int64)
    final[label.ravel()] = number.ravel()
    walls: Walls = {}
    sure = np.concatenate([[0.0], *([*row.certainty, 0.0] for row in rows)])
    for (a, b), places in sorted(borders.items(), key=lambda item: (-len(item[1]), item[0])):
        first, second = sorted((int(final[a]), int(final[b])))
        if first == second or (first, second) in walls:
            continue
        if owner[a - 1] == owner[b - 1]:
            walls[first, second] = sure_in_row(float(sure[min(a, b)]))
            continue
        if len(places) * CELL_M < limits.shortest_border:
            continue
        walls[first, second] = sure_on_border(border_odds(plan, places, roofs))
    return number.astype(np.int32), walls


def head_of(target: NDArray[np.int64], unit: int) -> int:
    """The unit that a unit was given to in the end."""
    while target[unit] != unit:
        unit = int(target[unit])
    return unit


def borders_between(label: NDArray[np.int32]) -> dict[tuple[int, int], NDArray[np.float64]]:
    """The places (M, 2; row, column) between cells of two units, by their numbers, the smaller first."""
    pairs, places = [], []
    for axis in (0, 1):
        first = label[:-1] if axis == 0 else label[:, :-1]
        second = label[1:] if axis == 0 else label[:, 1:]
        row, column = np.nonzero((first != second) & (first > 0) & (second > 0))
        pairs.append(np.sort(np.column_stack([first[row, column], second[row, column]]), axis=1))
        places.append(np.column_stack([row + (axis == 0) * 0.5, column + (axis == 1) * 0.5]))
    couples, where = np.vstack(pairs), np.vstack(places)
    if len(couples) == 0:
        return {}
    names, number = np.unique(couples, axis=0, return_inverse=True)
    order = np.argsort(number.ravel(), kind="stable")
    cuts = np.searchsorted(number.ravel()[order], np.arange(1, len(names)))
    return {
        (int(a), int(b)): where[members]
        for (a, b), members in zip(names.tolist(), np.split(order, cuts), strict=True)
    }


def border_odds(plan: Plan, places: NDArray[np.float64], roofs: Roofs) -> float:
    """Log-odds of a wall along the border through places (M, 2; row, column), from the points beside it."""
    xy = plan.places(*places.T)
    centre = xy.mean(axis=0)
    _, _, axes = np.linalg.svd(xy - centre, full_matrices=False)
    across = axes[0] * (1.0 if axes[0][int(np.argmax(np.abs(axes[0])))] > 0 else -1.0)
    along = np.array([across[1], -across[0]])
    t = (xy - centre) @ across
    steps = int(2 * WINDOW_M / CELL_M)
    row = HouseRow(
        centre - WINDOW_M * along, along, across, np.full(steps, t.min()), np.full(steps, t.max() + CELL_M)
    )
    odds, _ = roofs.wall_odds(row)
    return float(odds[steps // 2 - 2 : steps // 2 + 3].max())


def sure_in_row(chance: float) -> float:
    """The calibrated probability of a wall in a row, from that among all divisions of the row."""
    with np.errstate(divide="ignore"):
        return calibrated(float(np.log(chance) - np.log1p(-chance)), OF_ROWS)


def sure_on_border(odds: float) -> float:
    """The calibrated probability of a wall on the border of two rows, from its log-odds."""
    return calibrated(odds, OF_BORDERS)


def calibrated(odds: float, line: tuple[float, float]) -> float:
    """The probability at log-odds on a line [platt1999]."""
    bounded = float(np.clip(odds, -MOST_ODDS, MOST_ODDS))
    return float(1.0 / (1.0 + np.exp(-line[0] - line[1] * bounded)))
