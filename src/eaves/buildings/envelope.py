"""The figures that an energy model asks for: floors, and the surfaces that lie in the open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from eaves.buildings.party_wall_areas import Walls, shared_areas
from eaves.reconstruct.toolkit.roof_figures import QUARTERS, quarter_of

PARTY_WALLS = "party_wall_area_m2"


def wall_figures(own: Walls, others: Sequence[Walls]) -> dict[str, float]:
    """Areas (m²) of walls that `others` stand against, and of those in the open by quarter of the compass."""
    shared = shared_areas(own, others)
    free = np.maximum(own.areas() - shared, 0.0)
    turn = np.degrees(np.arctan2(own.outward[:, 0], own.outward[:, 1])) % 360.0
    sides = dict.fromkeys(QUARTERS, 0.0)
    for azimuth, area in zip(turn, free, strict=True):
        sides[quarter_of(float(azimuth))] += float(area)
    found = {f"free_wall_{side}_m2": area for side, area in sides.items()}
    areas = {PARTY_WALLS: float(shared.sum()), "free_wall_area_m2": float(free.sum()), **found}
    return {name: round(area, 2) for name, area in areas.items()}


def envelope_figures(
    walls: Mapping[str, float], attributes: Mapping[str, Any], area_m2: float, map_storeys: Any = None
) -> dict[str, Any]:
    """The walls with floor area, envelope (free walls, roof, ground; m²) and its share of the volume (1/m).

    The storeys are those of the map where it has them, else those estimated from the height of the eaves.
    """
    storeys = map_storeys if isinstance(map_storeys, int) and map_storeys > 0 else None
    storeys = storeys or attributes.get("storeysAboveGround")
    roof, volume = attributes.get("roof_area_m2"), attributes.get("volume_m3")
    found: dict[str, Any] = {**walls}
    if storeys:
        found |= {"floor_storeys": int(storeys), "floor_area_m2": round(area_m2 * int(storeys), 1)}
    if roof is not None:
        envelope = walls["free_wall_area_m2"] + roof + area_m2
        found["envelope_m2"] = round(envelope, 1)
        if volume:
            found["envelope_per_volume"] = round(envelope / volume, 3)
    return found
