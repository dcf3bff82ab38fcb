"""A block's outline divided along found walls, without gap or overlap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString, Polygon

from eaves.geometry.inside import edges_of, points_in_polygons
from eaves.geometry.pieces import borders_of, joined_pieces
from eaves.geometry.tolerance import COORDINATE_STEP
from eaves.outline.toolkit.shared_edges import welded_outlines
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
        own = (t >= row.first) & (t < row.last)
        step = np.broadcast_to(np.arange(len(row.first)), s.shape)[own]
        unit = np.searchsorted(units.walls, step, side="right")
        cells = plan.cells(*row.place(s[own], t[own]))
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
            near = min(row.first[wall - 1], row.first[wall])
            far = max(row.last[wall - 1], row.last[wall])
            ends = np.column_stack(row.place(np.array([wall, wall]) * CELL_M, np.array([near, far])))
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
    cuts = [outline.boundary, *wall_lines(plan, label, rows, farthest)]
    pieces = [
        piece
        for piece in shapely.get_parts(
            shapely.polygonize([shapely.union_all(cuts, grid_size=COORDINATE_STEP)])
        )
        if outline.covers(piece.representative_point())
    ]
    count = int(label.max(initial=0))
    owner = owners_by_cells(pieces, plan, label, count)
    found = joined_pieces(pieces, owner, count)
    parts = [part for part in found if part is not None]
    kept = [k + 1 for k, part in enumerate(found) if part is not None]
    whole = []
    for part in welded_outlines(parts):
        plain = shapely.remove_repeated_points(part, 3.0 * COORDINATE_STEP)
        whole.append(shapely.orient_polygons(plain if plain.is_valid else part))
    return whole, kept


def owners_by_cells(pieces: Sequence[Polygon], plan: Plan, label: NDArray[np.int32], count: int) -> list[int]:
    """The unit (from 0) that has most cells in each piece; a piece without goes to the neighbour
    it shares the longest border with.
    """
    row, column = np.nonzero(label > 0)
    numbers = label[row, column] - 1
    x = plan.west + (column + 0.5) * CELL_M
    y = plan.south + (row + 0.5) * CELL_M
    owner = [-1] * len(pieces)
    cell, piece = points_in_polygons(
        np.column_stack([x, y]), *edges_of(np.array(pieces, object)), len(pieces)
    )
    votes = np.bincount(piece * count + numbers[cell], minlength=len(pieces) * count).reshape(-1, count)
    for k in range(len(pieces)):
        area = CELL_M**2 * votes[k].max(initial=0)
        if area > max(0.25 * pieces[k].area, 0.5):
            owner[k] = int(np.argmax(votes[k]))
    changed = True
    while changed:
        changed = False
        for k in np.flatnonzero(np.array(owner) < 0).tolist():
            border = borders_of(k, pieces, owner, count)
            if border.max(initial=0.0) > 0.0:
                owner[k] = int(np.argmax(border))
                changed = True
    return owner
