"""The units stage: contract of a method that divides a block, and the stage function."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from shapely import Polygon

from eaves.methods import Emit, Method, MethodChoice, check_returned, ignore, naming, resolve_method
from eaves.model import Points, Values
from eaves.model.checks import as_points, check_lengths, check_positive
from eaves.model.cloud import canonical_order


@dataclass(frozen=True, eq=False)
class Division:
    """A block's outline in units: `parts` fill it; `certainty` (one for each) is the probability of the least
    sure wall between a part and its neighbours, 1 where it has none.
    """

    parts: tuple[Polygon, ...]
    certainty: tuple[float, ...]
    walls: tuple[tuple[int, int, float], ...] = ()
    """Two parts, by their places in `parts`, and the probability that a wall stands between them."""

    @classmethod
    def of(cls, parts: Sequence[Polygon], walls: Iterable[tuple[int, int, float]]) -> Division:
        """The division with parts and walls."""
        listed = tuple(walls)
        least = [min((sure for a, b, sure in listed if k in (a, b)), default=1.0) for k in range(len(parts))]
        return cls(tuple(parts), tuple(least), listed)


class UnitMethod(Method):
    """Divides the outline of one detected block into the buildings that stand in it wall to wall.

    `divide` takes the block's roof points (N, 3), their heights above the terrain (N,) and the outline, all
    in the same local metres; one that `wants` it also the points' `intensity` (N,), where the scan has it.

    Examples
    --------
    >>> from eaves import RowWalls, UnitMethod
    >>> issubclass(RowWalls, UnitMethod)
    True
    """

    stage: ClassVar[str] = "units"

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
        raise NotImplementedError


def divide_block(
    points: Points,
    height: Values,
    outline: Polygon,
    spacing: float,
    method: MethodChoice = None,
    intensity: Values | None = None,
) -> Division:
    """The units of a detected block.

    Parameters
    ----------
    points : ndarray (N, 3) of float64
        The block's roof points in local metres, in any order; points with NaN coordinates are left out.
    height : ndarray (N,) of float64
        Their heights above the terrain (m), NaN where it is not known.
    outline : shapely.Polygon
        The block, in the same local metres.
    spacing : float
        Mean distance (m, > 0) of the points in plan.
    method : UnitMethod, str, mapping or None
        The method, its name, or its parameters; None is `RowWalls()`.
    intensity : ndarray (N,) of float64 or None
        Intensities of the points, for a method that `wants` them; None where they are not known.

    Returns
    -------
    Division
        Parts that fill the outline; the outline alone where nothing divides it.

    Raises
    ------
    TypeError
        When `points` is no float64 array, or `method` no method of the stage.
    ValueError
        When an array has another shape, `spacing` is not above 0, or no method or parameter has that name.

    Examples
    --------
    >>> import numpy as np
    >>> from shapely import box
    >>> from eaves.units import divide_block
    >>> x, y = np.meshgrid(np.arange(0.1, 18, 0.3), np.arange(0.1, 9, 0.3))
    >>> z = np.where(x < 6, 7.0, np.where(x < 12, 8.0, 7.4))
    >>> points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    >>> len(divide_block(points, points[:, 2], box(0, 0, 18, 9), 0.3).parts)
    3
    """
    points = as_points(points)
    check_lengths(len(points), {"height": height, "intensity": intensity})
    check_positive(spacing, "spacing")
    divider = resolve_method("units", method)
    assert isinstance(divider, UnitMethod)
    more: dict[str, Any] = {}
    good = np.flatnonzero(np.isfinite(points).all(axis=1))
    good = good[canonical_order(points[good])]
    points, height = points[good], height[good]
    if intensity is not None and "intensity" in divider.wants:
        more["intensity"] = intensity[good]
    finite = np.isfinite(height)
    if not finite.any():
        return Division((outline,), (1.0,))
    with naming(divider):
        found = divider.divide(
            points, np.where(finite, height, np.nanmedian(height)), outline, spacing, **more
        )
    check_returned(divider, isinstance(found, Division), "a Division", found)
    held = all(isinstance(part, Polygon) for part in found.parts)
    check_returned(divider, held, "a Division of Polygons", found.parts)
    held = 0 < len(found.parts) == len(found.certainty)
    check_returned(divider, held, "a Division of at least a part, with a certainty of each", found.certainty)
    return found
