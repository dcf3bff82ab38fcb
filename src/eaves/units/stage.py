"""The units stage: contract of a method that divides a block, and the verb."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from shapely import Polygon

from eaves.methods import Emit, Method, ignore
from eaves.model import Points, Values


@dataclass(frozen=True, eq=False)
class Division:
    """A block's outline in units: `parts` fill it; `certainty` (one for each) is the probability of the least
    sure wall between a part and its neighbours, 1 where it has none.
    """

    parts: tuple[Polygon, ...]
    certainty: tuple[float, ...]


class UnitMethod(Method):
    """Divides the outline of one detected block into the buildings that stand in it wall to wall.

    `divide` sees the block's roof points (N, 3), their heights over the terrain (N,) and the outline, all in
    the same local metres.
    """

    stage: ClassVar[str] = "units"

    def divide(
        self, points: Points, height: Values, outline: Polygon, spacing: float, emit: Emit = ignore
    ) -> Division:
        """The division; see the class."""
        raise NotImplementedError


def divide_block(
    points: Points, height: Values, outline: Polygon, spacing: float, method: UnitMethod | None = None
) -> Division:
    """The units of a block, from its roof points (N, 3) and their heights over the terrain (N,; m)."""
    from eaves.methods import make_method

    divider = method or make_method("units")
    assert isinstance(divider, UnitMethod)
    known = np.isfinite(height)
    if not known.any():
        return Division((outline,), (1.0,))
    return divider.divide(points, np.where(known, height, np.nanmedian(height)), outline, spacing)
