"""Rows of like houses in delft, measured by moments: source 5's own measure of precision.

Run `EAVES_DATA=... python -m benchmarks.accuracy.moments_rows`.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from benchmarks.accuracy.roof import delft_roofs
from benchmarks.table import keep
from eaves.model import Points, RoofPlane
from eaves.published.maas_vosselman.moments.building import ParametricBuilding, fit_building
from eaves.published.maas_vosselman.moments.parametric_roof import ACROSS, LEFT_SLOPE, RIGHT_SLOPE, TOP
from eaves.roof import segment_roof

COMMAND = "python -m benchmarks.accuracy.moments_rows"

ROWS = {
    "sheds": (20, 22, 55, 56, 77, 87),
    "terrace of five": (8, 42, 49, 52, 79),
    "terrace of three": (5, 63, 78),
    "semi-detached": (18, 26, 30, 41, 50),
    "corner terrace": (51, 53, 60),
}
"""Rows of like houses in delft, by the number of the footprint in footprints.gpkg."""

STEEP = np.radians(15.0)
"""Slope from which a plane is a side of a gable."""

FREE = 0.5
"""A side of the roof is free when it ends this near (m) to where the footprint ends."""


@dataclass(frozen=True, eq=False)
class RowHouse:
    """A house: its points (N, 3), local metres, plan, members of the main roof, fit."""

    number: int
    points: Points
    plan: shapely.Polygon
    roof: NDArray[np.int64]
    house: ParametricBuilding

    def measures(self) -> list[float]:
        """Width, eaves, ridge (m), slope (degrees)."""
        return measures_of(self.house)

    def free_sides(self) -> dict[bool, list[float]]:
        """Run from ridge to eaves, and height of the eaves (m), of the sides that end where the plan does.

        The key says whether the side faces a fixed half of the compass, the same for all houses of a row.
        """
        fit, (_, _, south, north) = self.house.fit, self.house.edges
        p = fit.parameters
        across = fit.axes(shapely.get_coordinates(self.plan))[1]
        faces_east = np.cos(p[0] + np.pi / 4.0) > 0.0
        found = {}
        if abs(across.max() - north) <= FREE:
            run = north - p[ACROSS]
            found[bool(faces_east)] = [run, p[TOP] - p[LEFT_SLOPE] * run]
        if abs(across.min() - south) <= FREE:
            run = p[ACROSS] - south
            found[not faces_east] = [run, p[TOP] - p[RIGHT_SLOPE] * run]
        return found

    def halves(self) -> NDArray[np.float64]:
        """Differences of the four measures between two fits, each to every other point of the roof."""
        own = self.points[self.roof]
        fits = [fit_building(own[start::2]) for start in (0, 1)]
        both = [measures_of(fit) if isinstance(fit, ParametricBuilding) else [np.nan] * 4 for fit in fits]
        return np.asarray(both[0]) - np.asarray(both[1])


def measures_of(house: ParametricBuilding) -> list[float]:
    """Width, eaves, ridge (m), slope (degrees)."""
    return [house.width, house.eaves, house.ridge, float(np.degrees(house.slope))]


def row_houses(data: Path) -> Iterator[tuple[str, list[RowHouse]]]:
    """Every row with its houses, from the points of class 6 inside each footprint."""
    roofs = list(delft_roofs(data))
    for name, numbers in ROWS.items():
        houses = []
        for number in numbers:
            plan, own = roofs[number]
            origin = np.floor(own.mean(axis=0)) * [1.0, 1.0, 0.0]
            own = own - origin
            pair = main_pair(segment_roof(own, 0.3))
            roof = np.sort(np.concatenate([plane.members for plane in pair]))
            house = fit_building(own[roof])
            if isinstance(house, ParametricBuilding):
                local = shapely.transform(plan, lambda xy, shift=origin[:2]: xy - shift)
                houses.append(RowHouse(number, own, local, roof, house))
        yield name, houses


def main_pair(planes: list[RoofPlane]) -> tuple[RoofPlane, ...]:
    """The two planes with most points that face each other; ValueError when none do."""

    def face(pair: tuple[RoofPlane, ...]) -> bool:
        one, other = (plane.normal[:2] / max(float(np.hypot(*plane.normal[:2])), 1e-9) for plane in pair)
        return min(plane.slope for plane in pair) > STEEP and float(one @ other) < -0.97

    pairs = [pair for pair in combinations(planes, 2) if face(pair)]
    return max(pairs, key=lambda pair: sum(len(plane.members) for plane in pair))


def deviation_rows(data: Path) -> Iterator[dict[str, object]]:
    """Deviation within each row."""
    for name, houses in row_houses(data):
        spread = np.std([house.measures() for house in houses], axis=0, ddof=1)
        halves = np.array([house.halves() for house in houses])
        # the difference of two halves has the variance of four wholes
        own = np.sqrt(np.nanmean(halves**2, axis=0)) / 2.0
        sides = [house.free_sides() for house in houses]
        shared = max((True, False), key=lambda key: sum(key in side for side in sides))
        runs = np.array([side[shared] for side in sides if shared in side])
        free = np.std(runs, axis=0, ddof=1) if len(runs) > 1 else np.full(2, np.nan)
        yield {
            "row": name,
            "footprints": ", ".join(str(house.number) for house in houses),
            "width m": float(spread[0]),
            "eaves m": float(spread[1]),
            "ridge m": float(spread[2]),
            "slope °": float(spread[3]),
            "free sides": len(runs),
            "run, ridge to free eaves m": float(free[0]),
            "free eaves m": float(free[1]),
            "measurement alone: width m": float(own[0]),
            "measurement alone: slope °": float(own[3]),
        }


def main() -> None:
    """Print and keep the table."""
    keep(
        "moments-rows",
        "Rows of like houses",
        list(deviation_rows(Path(os.environ["EAVES_DATA"]))),
        COMMAND,
        "To reach: 0.10 m and 1°. Source 5: 0.1–0.2 m. Each house is the two largest planes that face each "
        "other among the points of class 6 within its footprint, and what stands above. *Free* is a side "
        f"that ends within {FREE} m of where the footprint ends; elsewhere an annex ends it, at its own "
        "place in every house. *Measurement alone*: what two fits to every other point differ by, halved.",
    )


if __name__ == "__main__":
    main()
