"""The default unit method: rows along fronts, each divided along the walls its points show."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from shapely import Polygon

from eaves.kernels import kernel
from eaves.methods import Emit, ignore, parameter
from eaves.model import Integers, Points, Values
from eaves.units.row_walls.division import (
    MergeRules,
    RowUnits,
    divide_outline,
    label_unit_cells,
    merged_units,
)
from eaves.units.row_walls.evidence import Roofs
from eaves.units.row_walls.rows import CELL_M, HOUSE_M, SAME_DEG, HouseRow, Plan, RowRules, rows_of
from eaves.units.stage import Division, UnitMethod


class RowWalls(MergeRules, RowRules, UnitMethod):
    """The buildings that stand wall to wall in one detected block.

    Behind each of the long fronts of a block, longest first, lies the ground of a row, as deep as a house;
    walls run along the direction in which heights change most alike at all depths. At every quarter of a
    metre along a row planes are fitted to the points on both sides, in lines half a metre apart, and
    compared: steps, valleys, what rises over both roofs or changes in reflectance more than what is around
    it, and against them ridges, give the odds of a party wall there by logistic regression. A scan without
    intensities lacks that term alone. A division of the row is as likely as the product of the odds of its
    walls and of the widths of its units. Houses of one width make weak signs at equal distances likely: each
    width counts as much as the row's signs are likely under it, so it comes from the scan alone. A wall
    stands where enough of all divisions have one: the sums over them change little where the points do, the
    best of them may be any of many. Walls are carried on through annexes; what they leave narrower than a
    metre goes to the other side.

    Formula
    -------
    P(wall at s) = Σ_u Σ_divisions with s  Π_walls o · Π_units f_u(w) / Σ_u Σ_divisions ...,
    f_u(w) = q g(w) + (1 − q) r N(ln w; ln u, λ),

    o the odds at a place, w the width of a unit, g falling off below the narrowest, u the
    usual width of the row, λ the likeness, q the share of odd widths, r the range of widths. Without
    a usual width f = g.

    Fidelity
    --------
    Own method; the sums over divisions are those of [rabiner1989] for states of explicit duration. The
    weights of the signs, and how sure walls are, were learned on six towns
    (`benchmarks/accuracy/unit_weights.py`): a real town's models of 853 buildings and five drawn at random,
    scanned at 10/m². Of fourteen signs three tell the walls of a town left out best; the weights of rises
    and of reflectance, which drawn towns lack, come from the maps of two real ones
    (`benchmarks/accuracy/walls.py`). Whether a block is several buildings at all was learned on these
    six at 10 and 3/m² and on drawn houses with wings, halls and rows.

    Fails where
    -----------
    Neighbours with one roof and nothing on it are one unit, also where their depths differ. So are two houses
    that stand together alone, even if their roofs differ: a house and its wing look the same. Houses back to
    back under one roof, and rows that turn by less than a right angle at each house, are seen as one depth.
    Halls with saw teeth, scanned at 10/m², are divided into their teeth. Under about 3 points/m² steps below
    0.2 m are lost.

    Complexity
    ----------
    O(N) in points for each front; O(S²) in the quarter metres S of a front for each usual width.

    References
    ----------
    [rabiner1989].
    """

    name: ClassVar[str] = "row_walls"
    idea: ClassVar[str] = "Rows along fronts, each divided where its points show walls, by one sum."
    paper: ClassVar[str] = "rabiner1989"
    wants: ClassVar[tuple[str, ...]] = ("intensity",)

    likeness: float = parameter(
        0.07,
        "Spread of the logarithm of widths in a regular row; half of that below the narrowest.",
        symbol="λ",
        gt=0.0,
    )
    odd_share: float = parameter(
        0.3, "Share of units of another width in a regular row.", symbol="q", gt=0.0, lt=1.0
    )
    width_range: float = parameter(1.7, "Range of the logarithm of widths of units.", symbol="r", gt=0.0)
    regular_gain: float = parameter(
        2.0, "Log-odds of a row with no usual width against any one width.", ge=0.0
    )
    least_sure: float = parameter(
        0.3,
        "Share of all divisions with a wall from which it stands: rows of towns are matched best so.",
        gt=0.0,
        lt=1.0,
    )
    carried_on: float = parameter(
        HOUSE_M, "Largest distance by which a wall is extended through annexes and sheds.", unit="m", gt=0.0
    )

    def divide(
        self,
        points: Points,
        height: Values,
        outline: Polygon,
        spacing: float,
        emit: Emit = ignore,
        *,
        intensity: Values | None = None,
    ) -> Division:
        """The division; see the class."""
        undivided = Division((outline,), (1.0,))
        plan = Plan.of(outline, points)
        rows = list(rows_of(plan, directions_of(outline, self.shortest_front), self))
        if not rows:
            return undivided
        roofs = Roofs.of(points, intensity)
        odds, shapes = zip(*(roofs.wall_odds(row) for row in rows), strict=True)
        emit("rows", rows)
        by_shape = list(map(self.walls_of, rows, shapes))
        if odds_of_several(by_shape, shapes, len(points), outline.area) < SURE:  # a house of wings stays one
            return undivided
        units = list(map(self.walls_of, rows, odds))
        label = np.zeros(plan.main.shape, np.int32)
        label_unit_cells(plan, label, units, 1)
        label, walls = merged_units(plan, label, units, roofs, self)
        if label.max() < 2:
            return undivided
        parts, number = divide_outline(outline, plan, label, units, self.carried_on)
        place = {unit: k for k, unit in enumerate(number)}
        return Division.of(
            parts,
            [
                (place[a], place[b], sure)
                for (a, b), sure in sorted(walls.items())
                if a in place and b in place
            ],
        )

    def walls_of(self, row: HouseRow, log_odds: Values) -> RowUnits:
        """The inner walls of one row, from the log-odds (S + 1,) of a wall at each step."""
        width = np.maximum(np.arange(len(log_odds)), 1) * CELL_M
        broad = np.exp(-0.5 * (np.minimum(np.log(width / self.narrowest), 0.0) / (2.0 * self.likeness)) ** 2)
        widths = np.array(
            [broad, *(self.regular_width(width, usual, broad) for usual in self.usual_widths(row))]
        )
        prior = np.ones(len(widths))
        prior[0] = np.exp(self.regular_gain)
        chance = chances_of(np.exp(log_odds), widths, prior)
        return RowUnits(row, *likely_walls(chance, self.least_sure))

    def usual_widths(self, row: HouseRow) -> list[float]:
        """The widths (m) that most units of a regular row may have; three at least stand in it."""
        widest = min(3.0 * self.narrowest, row.length / 3.0)
        if widest < self.narrowest:
            return []
        ratio = 1.0 + 0.5 * self.likeness
        return [
            self.narrowest * ratio**k for k in range(int(np.log(widest / self.narrowest) / np.log(ratio)) + 1)
        ]

    def regular_width(self, width: Values, usual: float, broad: Values) -> Values:
        """Likelihood ratio of a unit's `width` (K,; m) in a row of houses with a usual width to that in
        others.
        """
        peak = (
            np.exp(-0.5 * (np.log(width / usual) / self.likeness) ** 2) / self.likeness / np.sqrt(2 * np.pi)
        )
        return np.asarray(self.odd_share * broad + (1.0 - self.odd_share) * peak * self.width_range)


def directions_of(outline: Polygon, shortest: float) -> Values:
    """Unit vectors (K, 2) along the edges of an outline, those with most length first, each once and with at
    least the `shortest` length (m).
    """
    rings = outline.exterior, *outline.interiors
    step = np.vstack([np.diff(np.asarray(ring.coords)[:, :2], axis=0) for ring in rings])
    length = np.hypot(step[:, 0], step[:, 1])
    angle = np.arctan2(step[:, 1], step[:, 0])
    directions: list[float] = []
    same = np.radians(SAME_DEG)
    while len(length):
        apart = np.mod(angle[:, None] - angle[None, :] + np.pi / 2, np.pi) - np.pi / 2
        weight = (np.abs(apart) < same) @ length
        best = int(np.argmax(weight))
        if weight[best] < shortest:
            break
        along_it = np.abs(apart[best]) < same
        directions.append(float(angle[best] - np.average(apart[best][along_it], weights=length[along_it])))
        length, angle = length[~along_it], angle[~along_it]
    return np.column_stack([np.cos(directions), np.sin(directions)])


WEIGHTS = {"one": -5.16, "units": 4.01, "density": 0.38, "depth": -5.96, "second": 0.52}
"""Of the traits in the log-odds that a block is several buildings; learned by
`python -m benchmarks.accuracy.unit_weights` on towns and on drawn houses, halls and rows.
"""

MOST_UNITS = 8
"""More units prove no more: a factory of a hundred bays would outweigh its depth."""

SURE = 0.5
"""Log-odds with which a block is divided: where one building is nearly as likely, that is simpler."""

LEAST_ODDS, MOST_ODDS = -2.0, 4.0
"""Log-odds of the second wall count within these; a block with one wall has the least.
"""


def odds_of_several(rows: Sequence[RowUnits], odds: Sequence[Values], points: int, area: float) -> float:
    """Log-odds that a block of `area` (m²) with that many points is several buildings, from its divided rows
    and the log-odds (S + 1,) of a wall at each step of each row, both by the signs of shape alone.

    A single wall proves nothing: every wing has one. That walls repeat, how strong the second is, how dense
    the scan, and whether the row is as shallow as houses are, decide.
    """
    traits = traits_of_block(rows, odds, points, area)
    return float(traits @ np.array(list(WEIGHTS.values())))


def traits_of_block(rows: Sequence[RowUnits], odds: Sequence[Values], points: int, area: float) -> Values:
    """The columns (5,) that `WEIGHTS` weigh: 1, the logarithms of the units to expect, of the density
    (points/m²) and of how much deeper the row of most units is, the log-odds of the second wall.
    """
    strength = sorted(
        float(row_odds[max(wall - NEAR, 0) : wall + NEAR + 1].max())
        for units, row_odds in zip(rows, odds, strict=True)
        for wall in units.walls.tolist()
    )
    longest = max(rows, key=lambda units: len(units.walls)).row
    second = strength[-2] if len(strength) > 1 else LEAST_ODDS
    return np.array(
        [
            1.0,
            np.log(min(1.0 + sum(float(units.certainty.sum()) for units in rows), MOST_UNITS)),
            np.log(max(points, 1) / area),
            max(float(np.log(longest.behind / HOUSE_M)), 0.0),
            np.clip(second, LEAST_ODDS, MOST_ODDS),
        ]
    )


NEAR = 2
"""Steps within which walls of two divisions agree."""

LARGE = 2.0**400
"""Sums over this are divided by it: by a power of two, so that no digit changes, and small enough that the
product of two of them is a number."""

LEAST = float(np.finfo(np.float64).tiny)
"""Sum where no division is possible, so that shares are finite."""


def chances_of(odds: Values, width_odds: Values, prior: Values) -> Values:
    """The share (S + 1,) of all divisions that have a wall at each step, each as likely as its product.

    `odds` (S + 1,) are the odds of a wall at each step; a unit multiplies them by its `width_odds`
    (U, S + 1), of which one row holds for all units, each row as likely as its `prior` (U,): forward-backward
    sums over all divisions [rabiner1989], § V-A: of long rows they are beyond all numbers, and are scaled.
    """
    forward, backward, scale_before, scale_after = sums_kernel(odds, width_odds)
    last = scale_before[:, -1]
    scale = LARGE ** (scale_before + scale_after - last.max()).astype(np.float64)
    total = prior @ (forward[:, -1] * LARGE ** (last - last.max()).astype(np.float64))
    chance = prior @ (forward * backward * scale) / max(float(total), LEAST)
    chance[[0, -1]] = 0.0
    return np.asarray(chance)


def likely_walls(chance: Values, least: float) -> tuple[Integers, Values]:
    """The steps (W,) near which divisions agree on a wall, and the share of them (W,), at least `least`.

    A wall stands at the mean of the places that divisions give it.
    """
    remainder, walls = chance.copy(), []
    steps = np.arange(len(chance))
    while len(remainder) > 2 * NEAR:
        sums = np.convolve(remainder, np.ones(2 * NEAR + 1), "same")
        middle = int(np.argmax(sums))
        if sums[middle] < least:
            break
        around = np.abs(steps - middle) <= NEAR
        walls.append(
            (round(float(steps[around] @ remainder[around] / sums[middle])), min(float(sums[middle]), 1.0))
        )
        remainder[np.abs(steps - middle) <= 2 * NEAR] = 0.0
    walls.sort()
    return np.array([wall for wall, _ in walls], np.int64), np.array([sure for _, sure in walls])


@kernel
def sums_kernel(odds: Values, width_odds: Values) -> tuple[Values, Values, Integers, Integers]:
    """For each row of widths (U, S + 1) and each step the sum over all divisions up to it with a wall there,
    and that over all after it, its own odds left out; the first and the last step are walls of odds 1. Then
    how often each was divided by `LARGE`.
    """
    rows, count = width_odds.shape
    forward, backward = np.zeros((rows, count)), np.zeros((rows, count))
    forward[:, 0] = backward[:, count - 1] = 1.0
    scale_before, scale_after = np.zeros((rows, count), np.int64), np.zeros((rows, count), np.int64)
    for row in range(rows):
        sums = forward[row].copy()
        for end in range(1, count):
            for start in range(end):
                sums[end] += sums[start] * width_odds[row, end - start]
            sums[end] *= odds[end] if end < count - 1 else 1.0
            scale_before[row, end] = scale_before[row, end - 1]
            if sums[end] > LARGE:
                sums /= LARGE
                scale_before[row, end] += 1
            forward[row, end] = sums[end]
        sums = backward[row].copy()
        for start in range(count - 2, -1, -1):
            for end in range(start + 1, count):
                factor = odds[end] if end < count - 1 else 1.0
                sums[start] += width_odds[row, end - start] * factor * sums[end]
            scale_after[row, start] = scale_after[row, start + 1]
            if sums[start] > LARGE:
                sums /= LARGE
                scale_after[row, start] += 1
            backward[row, start] = sums[start]
    return forward, backward, scale_before, scale_after
