"""Rows of a block: along which fronts houses can stand side by side, and which ground each front has."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from eaves.geometry.inside import edges_of
from eaves.methods import Method, parameter
from eaves.model import Integers, Mask, Points, Values

CELL_M = 0.25
"""Side of a cell (m) of the plan on which rows claim their ground; the finest that a wall's place needs."""


SAME_DEG = 2.0
"""Directions nearer to each other than this are one: a tolerance."""
CLEAR = 1.6
"""Walls lean where that makes heights change so many times as much alike: points moved by a part of a cell
change the coherence of a row by less."""
JOG_M, HOUSE_M = 1.5, 15.0
"""Distance (m) by which a front may step back and forth and still be one, and largest depth (m) of a house in
a row: what lies behind has another front, or is a yard's; a row of two is looked at twice as deep."""


class RowRules(Method):
    """The measures of a row."""

    jog: float = parameter(
        JOG_M,
        "Distance by which a front may step back and forth and still be one: bays, porches, unequal "
        "overhangs.",
        unit="m",
        ge=0.0,
    )
    shortest_front: float = parameter(
        5.0,
        "Shortest front of two houses side by side; edges of this length show how walls run.",
        unit="m",
        gt=0.0,
    )
    most_deeper: float = parameter(
        2.0,
        "Depth of ground, in multiples of the row's median depth, beyond which another row stands behind.",
        gt=1.0,
    )
    most_turn: float = parameter(
        5.0,
        "Largest angle by which jogs turn a front away from the edges it consists of.",
        unit="degree",
        ge=0.0,
        le=45.0,
    )
    narrowest: float = parameter(
        4.0,
        "Width under which a unit is unlikely: 99 of 100 houses in rows are wider; none is shallower.",
        unit="m",
        gt=0.0,
    )
    most_lean: float = parameter(
        40.0,
        "Largest angle by which party walls lean from upright on the front.",
        unit="degree",
        ge=0.0,
        lt=90.0,
    )
    least_square: float = parameter(
        0.7,
        "Share of the outline around a row that runs along its front or its walls: else its walls are none "
        "of this building.",
        ge=0.0,
        le=1.0,
    )


@dataclass(frozen=True, eq=False)
class Plan:
    """Cells of a block along its own length, for a row on the diagonal fills no square: `main` (H, W), `west`
    and `south` (m) the corner of cell (0, 0) in coordinates turned by `turn` (2, 2)."""

    main: Mask
    height: Values
    """Mean height (m) of the points in each cell (H, W), NaN where there is none."""
    west: float
    south: float
    turn: Values
    outline: Polygon

    @classmethod
    def of(cls, outline: Polygon, points: Points) -> Plan:
        """The cells over an outline, with the heights of points (N, 3)."""
        sides = np.diff(shapely.get_coordinates(shapely.oriented_envelope(outline)), axis=0)
        along = sides[np.argmax(np.hypot(*sides.T))]
        along = along / np.hypot(*along)
        turn = np.array([along, [-along[1], along[0]]])
        turned = shapely.transform(outline, lambda xy: xy @ turn.T)
        west, south, east, north = turned.bounds
        west, south = west - 2.0, south - 2.0
        columns, rows = int((east - west + 2.0) / CELL_M) + 1, int((north - south + 2.0) / CELL_M) + 1
        x = west + (np.arange(columns) + 0.5) * CELL_M
        y = south + (np.arange(rows) + 0.5) * CELL_M
        places = [part.ravel() for part in np.meshgrid(x, y)]
        shapely.prepare(turned)
        main = shapely.contains_xy(turned, *places)
        xy = points[:, :2] @ turn.T
        column = np.clip(((xy[:, 0] - west) / CELL_M).astype(np.int64), 0, columns - 1)
        row = np.clip(((xy[:, 1] - south) / CELL_M).astype(np.int64), 0, rows - 1)
        cell = row * columns + column
        count, total = (
            ndimage.uniform_filter(
                np.bincount(cell, weights, rows * columns).astype(np.float64).reshape(rows, columns), 3
            )
            for weights in (None, points[:, 2])
        )
        height = np.where(count > 1e-9, total / np.maximum(count, 1e-9), np.nan)
        return cls(main.reshape(rows, columns), height, west, south, turn, outline)

    def cells(self, x: Values, y: Values) -> tuple[Integers, Integers]:
        """Row and column of the cells that places lie in, held inside the plan's empty rim."""
        rows, columns = self.main.shape
        column = ((x * self.turn[0, 0] + y * self.turn[0, 1] - self.west) / CELL_M).astype(np.int64)
        row = ((x * self.turn[1, 0] + y * self.turn[1, 1] - self.south) / CELL_M).astype(np.int64)
        return np.minimum(np.maximum(row, 0), rows - 1), np.minimum(np.maximum(column, 0), columns - 1)

    def places(self, row: NDArray[Any], column: NDArray[Any]) -> Values:
        """x, y (K, 2) of the middles of cells."""
        turned = [self.west + (column + 0.5) * CELL_M, self.south + (row + 0.5) * CELL_M]
        return np.asarray(np.column_stack(turned) @ self.turn)


@dataclass(frozen=True, eq=False)
class HouseRow:
    """Ground behind a front: a place is `origin` + s · `along` + t · `across`, both unit vectors.

    `first` and `last` (S,) bound t (m) over each step of s; where they are equal the row has no ground.
    """

    origin: Values
    along: Values
    across: Values
    first: Values
    last: Values
    behind: float = HOUSE_M
    """How far (m) the block goes on behind the front; a row is no deeper than a house."""

    @property
    def length(self) -> float:
        """Of the front (m)."""
        return len(self.first) * CELL_M

    def grid(self) -> tuple[Values, Values]:
        """Row coordinates s, t (T, S) of a grid of cells over the row."""
        s = (np.arange(len(self.first)) + 0.5) * CELL_M
        filled = self.last > self.first
        return np.meshgrid(s, np.arange(self.first[filled].min(), self.last.max(), CELL_M) + 0.5 * CELL_M)

    def ground(self) -> tuple[Values, Values]:
        """x, y (M,) of the middles of the row's cells."""
        s, t = self.grid()
        inside = (t >= self.first) & (t < self.last)
        return self.place(s[inside], t[inside])

    def place(self, s: Values, t: Values) -> tuple[Values, Values]:
        """x, y of row coordinates."""
        x, y = (self.origin[k] + s * self.along[k] + t * self.across[k] for k in range(2))
        return x, y

    def coordinates(self, xy: Values) -> tuple[Values, Values]:
        """Row coordinates s, t (N,) of places (N, 2)."""
        turn = np.linalg.inv(np.column_stack([self.along, self.across]))
        x, y = xy[:, 0] - self.origin[0], xy[:, 1] - self.origin[1]
        s, t = (x * a + y * b for a, b in turn)
        return s, t

    def rim(self) -> Values:
        """Places (M, 2) around the row's ground, from step to step."""
        filled = np.flatnonzero(self.last > self.first)
        s = CELL_M * np.concatenate([filled + 0.5, filled[::-1] + 0.5])
        s[[0, -1]], s[[len(filled) - 1, len(filled)]] = 0.0, self.length
        return np.column_stack(self.place(s, np.concatenate([self.first[filled], self.last[filled][::-1]])))

    def frame(self) -> LineString:
        """The parallelogram around the row's ground."""
        low, far = float(self.first.min()), float(self.last.max())
        s, t = np.array([0.0, self.length, self.length, 0.0, 0.0]), np.array([low, low, far, far, low])
        return LineString(np.column_stack(self.place(s, t)))


def fronts_of(outline: Polygon, directions: Values, limits: RowRules) -> Iterator[tuple[Values, Values]]:
    """Start and end (2,) of the straight fronts of an outline along directions (K, 2), the interior on their
    left: edges along one direction that follow each other on a ring with no more than a jog between them.
    """
    oriented = shapely.orient_polygons(outline)
    for ring in (oriented.exterior, *oriented.interiors):
        xy = np.asarray(ring.coords)[:-1, :2]
        step = np.roll(xy, -1, axis=0) - xy
        cosine = step @ directions.T / np.maximum(np.hypot(step[:, 0], step[:, 1]), CELL_M)[:, None]
        nearest = np.argmax(np.abs(cosine), axis=1)
        cosine = cosine[np.arange(len(xy)), nearest]
        parallel = np.abs(cosine) >= np.cos(np.radians(limits.most_turn))
        for k, sign in product(range(len(directions)), (-1.0, 1.0)):
            along = sign * directions[k]
            across = np.array([-along[1], along[0]])
            s, t = xy @ along, xy @ across
            for edges in chains_of(
                np.flatnonzero(parallel & (nearest == k) & (cosine * sign > 0)), s, t, limits
            ):
                ends = (edges + 1) % len(xy)
                offset = np.average(0.5 * (t[edges] + t[ends]), weights=s[ends] - s[edges])
                if s[ends].max() - s[edges].min() >= limits.shortest_front:
                    yield s[edges].min() * along + offset * across, s[ends].max() * along + offset * across


def chains_of(edges: Integers, s: Values, t: Values, limits: RowRules) -> list[Integers]:
    """The edges (K,) of a ring of places s, t (N,), by their first vertices, in chains: from each to the next
    the ring leaves the front by no more than a jog."""
    linked = []
    for edge, following in zip(edges, np.roll(edges, -1), strict=True):
        between = np.arange(edge + 1, following + 1 if following > edge else following + 1 + len(s)) % len(s)
        back = s[between[0]] - s[following]
        linked.append(np.ptp(t[between]) <= limits.jog and back <= limits.jog)
    cuts = np.flatnonzero(~np.array(linked, bool))
    return np.split(np.roll(edges, -cuts[0] - 1), cuts[1:] - cuts[0]) if len(cuts) else [edges] * bool(linked)


def by_length(front: tuple[Values, Values]) -> tuple[float, float, float]:
    """The key that sorts fronts, longest first, then by place."""
    start, end = front
    return -round(float(np.hypot(*(end - start))), 3), float(start[0]), float(start[1])


def rows_of(plan: Plan, directions: Values, limits: RowRules) -> Iterator[HouseRow]:
    """The rows of a block, longest front first; what one claims no other has.

    `directions` (K, 2) are unit vectors along which fronts run, and walls, where they do not stand upright.
    """
    free: BaseGeometry = plan.outline
    if len(directions) == 0:
        return
    for start, end in sorted(fronts_of(plan.outline, directions, limits), key=by_length):
        along = (end - start) / np.hypot(*(end - start))
        upright = np.array([-along[1], along[0]])
        best = ground_behind(plan.outline, free, start, end, upright, limits)
        if best is None:
            continue
        most = coherence(plan, best)
        for across in leaning(directions, upright, limits.most_lean):
            row = ground_behind(plan.outline, free, start, end, across, limits)
            if row is not None and (coherent := coherence(plan, row)) > most * CLEAR:
                most, best = coherent / CLEAR, row
        if square_share(plan, best, limits) < limits.least_square:
            continue
        free = shapely.difference(free, shapely.make_valid(Polygon(best.rim())))
        yield best


def square_share(plan: Plan, row: HouseRow, limits: RowRules) -> float:
    """Share of the outline around a row's ground that runs along its front or its walls."""
    filled = np.flatnonzero(row.last > row.first)
    s = CELL_M * np.concatenate([filled + 0.5, filled[::-1] + 0.5])
    rim = np.column_stack(row.place(s, np.concatenate([row.first[filled], row.last[filled][::-1]])))
    around = shapely.buffer(Polygon(rim), 0.5 * limits.jog)
    pieces = shapely.get_parts(shapely.intersection(plan.outline.boundary, around))
    step = np.vstack([np.zeros((1, 2)), *(np.diff(shapely.get_coordinates(line), axis=0) for line in pieces)])
    length = np.hypot(step[:, 0], step[:, 1])
    along = np.abs(step @ np.column_stack([row.along, row.across])).max(axis=1)
    square = along >= np.cos(np.radians(limits.most_turn)) * length
    return float(length[square].sum() / max(length.sum(), CELL_M))


def leaning(directions: Values, upright: Values, most_lean: float) -> list[Values]:
    """The directions (K, 2) that stand within `most_lean` (degrees) of upright, pointing the same way."""
    turned = directions * np.sign(directions @ upright)[:, None]
    cosine = turned @ upright
    inclined = (cosine > np.cos(np.radians(most_lean))) & (cosine < np.cos(np.radians(SAME_DEG)))
    return list(turned[inclined])


def coherence(plan: Plan, row: HouseRow) -> float:
    """Coherence (m²) of the change of heights along the row at all depths: walls that run along `row.across`
    make it large.
    """
    s, t = row.grid()
    height = plan.height[plan.cells(*row.place(s, t))]
    height[(t < row.first) | (t >= row.last)] = np.nan
    change = height[:, 4:] - height[:, :-4]
    finite = np.isfinite(change)
    count = finite.sum(axis=0)
    mean = np.where(finite, change, 0.0).sum(axis=0) / np.maximum(count, 1)
    return float((mean**2)[count > 4].sum() / max(int((count > 4).sum()), 1))


def ground_behind(
    outline: BaseGeometry,
    free: BaseGeometry,
    start: Values,
    end: Values,
    across: Values,
    limits: RowRules,
) -> HouseRow | None:
    """The ground behind a front, to where the outline ends or to the depth of a house; None where others have
    claimed it.

    Where it is far deeper than usual another row stands behind.
    """
    length = float(np.hypot(*(end - start)))
    along = (end - start) / length
    steps = int(length / CELL_M)
    origin = start + 0.5 * (length - steps * CELL_M) * along
    chords = chords_of(outline, origin, along, across, steps, limits.jog)
    first = np.unique(chords.step, return_index=True)[1]
    first = first[chords.first[first] < limits.jog + 0.5]
    if len(first) == 0:
        return None
    begin, last = np.zeros(steps), np.zeros(steps)
    begin[chords.step[first]], last[chords.step[first]] = chords.first[first], chords.last[first]
    usual = float(np.median((last - begin)[last > begin]))
    last = np.where(last - begin > limits.most_deeper * usual, begin + usual, last)
    free_chords = chords_of(free, origin, along, across, steps, limits.jog)
    low, high = (
        np.maximum(free_chords.first, begin[free_chords.step]),
        np.minimum(free_chords.last, last[free_chords.step]),
    )
    longest = np.zeros((2, steps))  # of what others left the longest piece
    order = np.argsort(high - low, kind="stable")
    longest[:, free_chords.step[order]] = low[order], high[order]
    claimed = (last > begin) & (longest[1] - longest[0] >= 0.5 * (last - begin))
    begin, last = np.where(claimed, longest, 0.0)
    if (
        claimed.sum() * CELL_M < limits.shortest_front
        or np.median((last - begin)[claimed]) < limits.narrowest
    ):
        return None
    behind = float(np.median((last - begin)[claimed]))
    last = np.minimum(last, begin + HOUSE_M)
    filled = np.flatnonzero(claimed)
    keep = slice(filled[0], filled[-1] + 1)
    return HouseRow(origin + filled[0] * CELL_M * along, along, across, begin[keep], last[keep], behind)


class Chords(NamedTuple):
    """Pieces of lines across a row, one in the middle of each step, that lie in a shape: the step and the
    first and last t (m) of each piece (M,), step by step from the front."""

    step: Integers
    first: Values
    last: Values


def chords_of(
    shape: BaseGeometry,
    origin: Values,
    along: Values,
    across: Values,
    steps: int,
    jog: float,
) -> Chords:
    """The chords of polygons, from a jog and a half metre before the front to the depth of two houses."""
    ends = edges_of(shapely.get_parts(shape))[:2]
    turn = np.linalg.inv(np.column_stack([along, across]))
    (s0, t0), (s1, t1) = (turn @ (places - origin).T for places in ends)
    place0, place1 = s0 / CELL_M - 0.5, s1 / CELL_M - 0.5
    # an edge crosses the lines from its one end up to, and without, its other
    low, high = (
        np.clip(np.ceil(extreme(place0, place1)), 0, steps).astype(np.int64)
        for extreme in (np.minimum, np.maximum)
    )
    edge = np.repeat(np.arange(len(low)), high - low)
    step = np.arange(len(edge)) - np.repeat(np.cumsum(high - low) - high, high - low)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = t0[edge] + (step - place0[edge]) / (place1 - place0)[edge] * (t1 - t0)[edge]
    order = np.lexsort([t, step])
    first, last = np.maximum(t[order[::2]], -jog - 0.5), np.minimum(t[order[1::2]], 2.0 * HOUSE_M)
    positive = last > first
    return Chords(step[order[::2]][positive], first[positive], last[positive])
