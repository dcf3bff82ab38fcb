"""Heights in feet that nobody states: said of a plane in metres, and of no roofs in metres."""

from __future__ import annotations

import numpy as np
import pytest
from shapely import Polygon

from eaves.figures.rows import BuildingRow
from eaves.flow.advice import feet_remark

FOOT = 0.3048


def rows_of(slope: float, eaves: float, foot: float) -> list[BuildingRow]:
    """Four faces of a slope (degrees) on eaves (m) over ground at 0, heights in a unit taken as metres."""
    steep = float(np.degrees(np.arctan(np.tan(np.radians(slope)) / foot)))
    faces = [(Polygon(), {"slope_deg": steep, "projected_m2": 40.0})] * 2
    values = {"h_eaves": eaves / foot, "h_ground": 0.0}
    return [BuildingRow(Polygon(), values, {}, faces, True, None, {})] * 2


@pytest.mark.parametrize("slope", [22.0, 30.0, 45.0])
@pytest.mark.parametrize("eaves", [3.0, 6.0])
def test_feet_are_said_with_their_numbers__metres_are_not(slope: float, eaves: float) -> None:
    told = feet_remark(rows_of(slope, eaves, FOOT))
    assert told is not None and "feet" in told and f"{eaves / FOOT:.1f} m" in told
    assert feet_remark(rows_of(slope, eaves, 1.0)) is None


def test_flat_roofs_and_no_buildings_say_nothing() -> None:
    assert feet_remark(rows_of(0.0, 6.0, FOOT)) is None
    assert feet_remark([]) is None
