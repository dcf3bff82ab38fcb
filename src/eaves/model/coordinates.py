"""The coordinate reference system of the data, reduced to what computing needs."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CoordinateSystem:
    """A projected system: its WKT and code where known, and the length of its units in metres."""

    wkt: str | None = None
    horizontal_unit_m: float = 1.0
    vertical_unit_m: float = 1.0
    code: str | None = None
    """`EPSG:28992` or `EPSG:28992+5709`; None when the system has no registered code."""

    @property
    def unit_m(self) -> tuple[float, float, float]:
        """Metres per unit along x, y, z."""
        return self.horizontal_unit_m, self.horizontal_unit_m, self.vertical_unit_m


LOCAL_METRES = CoordinateSystem()
"""A plane system in metres with no known place on Earth."""
