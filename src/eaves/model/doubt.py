"""A place where the scan cannot decide, and why."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Doubt:
    """A place that deserves a look, and why.

    Parameters
    ----------
    x, y : float
        Its middle: metres about the origin of what carries the doubt.
    area_m2 : float
        Its size (m²).
    reason : str
        What the scan does not decide, in words.
    stage : str
        The stage that met it.

    Examples
    --------
    >>> from eaves.model import Doubt
    >>> Doubt(1.0, 2.0, 30.0, "half of the rim continues the terrain", "detect").translated(10.0, 0.0).x
    11.0
    """

    x: float
    y: float
    area_m2: float
    reason: str
    stage: str

    def translated(self, east: float, north: float) -> Doubt:
        """The same doubt about an origin that lies so far (m) to the west and south.

        Parameters
        ----------
        east, north : metres that are added to the place.

        Returns
        -------
        Doubt
            With the place moved and all else the same.
        """
        return replace(self, x=self.x + east, y=self.y + north)
