"""Odds that a block is several buildings at all: houses of wings, halls and churches show walls, too."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from eaves.model import Values
from eaves.units.row_walls.chain import NEAR
from eaves.units.row_walls.division import RowUnits
from eaves.units.row_walls.rows import HOUSE_M

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
    and the log-odds (S + 1,) of a wall at each step of each row.

    A single wall proves nothing: every wing has one. That walls repeat, how strong the second is, how dense
    the scan, and whether the row is as shallow as houses are, decide.
    """
    traits = traits_of_block(rows, odds, points, area)
    return float(traits @ np.array(list(WEIGHTS.values())))


def traits_of_block(
    rows: Sequence[RowUnits], odds: Sequence[Values], points: int, area: float
) -> NDArray[np.float64]:
    """The columns (5,) that `WEIGHTS` weigh: 1, the logarithms of the units to expect, of the density
    (points/m²) and of how much deeper the row of most units is, the log-odds of the second wall.
    """
    strength = sorted(
        float(own[max(wall - NEAR, 0) : wall + NEAR + 1].max())
        for units, own in zip(rows, odds, strict=True)
        for wall in units.walls.tolist()
    )
    longest = max(rows, key=lambda units: len(units.walls)).row
    depth = (longest.last - longest.first)[longest.last > longest.first]
    second = strength[-2] if len(strength) > 1 else LEAST_ODDS
    return np.array(
        [
            1.0,
            np.log(min(1.0 + sum(float(units.certainty.sum()) for units in rows), MOST_UNITS)),
            np.log(max(points, 1) / area),
            max(float(np.log(np.median(depth) / HOUSE_M)), 0.0),
            np.clip(second, LEAST_ODDS, MOST_ODDS),
        ]
    )
