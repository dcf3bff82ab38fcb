"""The default unit method: rows along fronts, each divided along the walls its points show."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from eaves.methods import Emit, ignore, parameter
from eaves.model import Points, Values
from eaves.units.row_walls.chain import chances_of, likely_walls
from eaves.units.row_walls.division import RowUnits, divide_outline, label_unit_cells
from eaves.units.row_walls.evidence import roof_noise, wall_odds, wall_signs
from eaves.units.row_walls.merging import MergeRules, merged_units
from eaves.units.row_walls.rows import CELL_M, HOUSE_M, SAME_DEG, HouseRow, Plan, RowRules, rows_of
from eaves.units.row_walls.several import SURE, odds_of_several
from eaves.units.stage import Division, UnitMethod


class RowWalls(MergeRules, RowRules, UnitMethod):
    """The buildings that stand wall to wall in one detected block.

    Behind each of the long fronts of a block, longest first, lies the ground of a row; walls run along
    the direction in which heights change most alike at all depths. At every quarter of a metre along a
    row planes are fitted to the points on both sides, in lines half a metre apart, and compared: steps,
    valleys, and against them ridges, give the odds of a party wall there by logistic regression. A division
    of the row is as likely as the product of the odds of its walls and of the widths of its units. Houses of
    one width make weak signs at equal distances likely: each width counts as much as the row's signs are
    likely under it, so it comes from the scan alone. A wall stands where enough of all divisions have one:
    the sums over them change little where the points do, the best of them may be any of many. Rows that meet
    without a wall are one; walls are carried on through annexes.

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
    scanned at 10/m². Of fourteen signs these three tell the walls of a town left out best. Whether a block is
    several buildings at all was learned on these towns at 10 and 3/m² and on drawn houses with wings, halls
    and rows.

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
        self, points: Points, height: Values, outline: Polygon, spacing: float, emit: Emit = ignore
    ) -> Division:
        """The division; see the class."""
        whole = Division((outline,), (1.0,))
        plan = Plan.of(outline, points)
        rows = list(rows_of(plan, directions_of(outline, self.shortest_front), self))
        if not rows:
            return whole
        noise = roof_noise(points)
        odds = [wall_odds(wall_signs(row, points, noise)) for row in rows]
        found = [self.walls_of(row, own) for row, own in zip(rows, odds, strict=True)]
        emit("rows", rows)
        if odds_of_several(found, odds, len(points), outline.area) < SURE:  # a house of wings stays one
            return whole
        label = np.zeros(plan.main.shape, np.int32)
        label_unit_cells(plan, label, found, 1)
        label, walls = merged_units(plan, label, found, points, noise, self)
        if label.max() < 2:
            return whole
        parts, number = divide_outline(outline, plan, label, found, self.carried_on)
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


def directions_of(outline: Polygon, shortest: float) -> NDArray[np.float64]:
    """Unit vectors (K, 2) along the edges of an outline, those with most length first, each once and with at
    least the `shortest` length (m).
    """
    rings = outline.exterior, *outline.interiors
    step = np.vstack([np.diff(np.asarray(ring.coords)[:, :2], axis=0) for ring in rings])
    length = np.hypot(step[:, 0], step[:, 1])
    angle = np.arctan2(step[:, 1], step[:, 0])
    found: list[float] = []
    same = np.radians(SAME_DEG)
    while len(length):
        apart = np.mod(angle[:, None] - angle[None, :] + np.pi / 2, np.pi) - np.pi / 2
        weight = (np.abs(apart) < same) @ length
        best = int(np.argmax(weight))
        if weight[best] < shortest:
            break
        along_it = np.abs(apart[best]) < same
        found.append(float(angle[best] - np.average(apart[best][along_it], weights=length[along_it])))
        length, angle = length[~along_it], angle[~along_it]
    return np.column_stack([np.cos(found), np.sin(found)])
