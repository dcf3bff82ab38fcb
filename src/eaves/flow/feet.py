"""Heights whose unit nobody states and no echoes tell, and which roofs and eaves say are in feet."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from eaves.figures.rows import BuildingRow

PITCHED_DEG, STEEP_DEG = 10.0, 50.0
"""Slopes from which a face is pitched, and from which it is steeper than most roofs are anywhere: in feet
over a plane in metres one of 20° has 50°, and one of 35° has 66°."""
STEEP, HIGH_M = 0.25, 8.0
"""Share of the pitched area that is so steep, and median height (m) of eaves: both at once are feet. Surveys
in metres have shares of 0 to .1 or lower eaves; two of Kentucky, heights left in feet, .28 and .72, 10 m."""
FEWEST = 3
"""Pitched faces that are evidence."""


def feet_remark(rows: Iterable[BuildingRow]) -> str | None:
    """The line on heights that are likely in feet, None where nothing speaks for it.

    Parameters
    ----------
    rows : iterable of BuildingRow
        All buildings.

    Returns
    -------
    str or None
        What was measured, in metres as heights were taken, and the remedy.
    """
    faces, eaves = [], []
    for row in rows:
        faces += [(values["slope_deg"], values["projected_m2"]) for _, values in row.faces]
        level, ground = row.values.get("h_eaves"), row.values.get("h_ground")
        if level is not None and ground is not None:
            eaves.append(level - ground)
    slope, area = np.array(faces, float).reshape(-1, 2).T
    pitched = slope > PITCHED_DEG
    if pitched.sum() < FEWEST or not eaves:
        return None
    share = float(area[slope > STEEP_DEG].sum() / area[pitched].sum())
    high = float(np.median(eaves))
    if share < STEEP or high < HIGH_M:
        return None
    return (
        f"heights: nobody states their unit, they were taken as metres, and are likely feet: {share:.0%} of "
        f"the pitched roofs are steeper than {STEEP_DEG:g}°, eaves are {high:.1f} m high (median); if they "
        "are feet, pass a system that says so, as --crs 26918+6360, of the plane and of heights in feet"
    )
