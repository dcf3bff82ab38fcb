"""The contract of a reconstructor whose plan is cut by candidate lines."""

from __future__ import annotations

from eaves.methods import parameter
from eaves.reconstruct.stage import Reconstructor


class LineReconstructor(Reconstructor):
    """A reconstructor whose plan is cut by candidate lines.

    Examples
    --------
    >>> import eaves
    >>> eaves.Arrangement().strip_width
    1.2
    """

    strip_width: float = parameter(
        1.2, "Width, in spacings, of the strip in which border places make one line.", gt=0.0
    )
    rectangle_points: int = parameter(6, "Fewest points of a plane whose rectangle is worth drawing.", ge=1)
    rectangle_trim: float = parameter(
        2.0,
        "Percentage of a plane's points, on each side, that its rectangle leaves out.",
        unit="percent",
        ge=0.0,
        lt=50.0,
    )
    clutter_points: int = parameter(6, "Fewest points that make a level of what no plane explains.", ge=1)
    clutter_area: float = parameter(
        1.0, "Least area that makes a level of what no plane explains.", unit="m2", ge=0.0
    )
    clutter_reach: float = parameter(
        2.0, "Points without a plane that are this many spacings apart stand together.", gt=0.0
    )
    clutter_step: float = parameter(
        0.5, "They stand together only when their heights differ by less.", unit="m", gt=0.0
    )
