"""The ground on drawn squares of 200 m, each with one thing that looks like another: courts, podiums, halls.

`python -m benchmarks.accuracy.ground_kinds`. Each is scanned at .5 and 4 points/m², turned by an angle of its
own and six times anew. SMRF with one set of five numbers stands beside.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy.smrf import ground_by_smrf
from benchmarks.table import keep
from eaves.ground import classify_ground
from eaves.model import Mask, PointCloud, Values

SIDE_M, NOISE_M = 200.0, 0.03
DENSITIES, SEEDS = (0.5, 4.0), range(401, 407)
Drawn = tuple[Values, Mask]
"""Heights (N,) and what is ground."""


def box(x: Values, y: Values, west: float, south: float, east: float, north: float) -> Mask:
    """The places (N,) in a rectangle."""
    return np.asarray((x >= west) & (x < east) & (y >= south) & (y < north))


def court(x: Values, y: Values, gate: bool = False) -> Drawn:
    """A court of 60 m, 4 m over the street, wings of 14 m on three sides; on the fourth a wall or a wing."""
    palace, inner = box(x, y, 56, 56, 144, 144), box(x, y, 70, 70, 130, 130)
    front = box(x, y, 70, 56, 130, 70)
    roof = palace & ~inner & (np.full(len(x), gate) | ~front)
    return np.where(roof, 18.0, np.where(inner, 4.0, 0.0)), ~roof


def closed_court(x: Values, y: Values) -> Drawn:
    """The same with a wing on all sides."""
    return court(x, y, gate=True)


def trains(x: Values, y: Values) -> Drawn:
    """Fourteen trains side by side, 2 m apart."""
    roof = (x >= 60) & (x < 130) & ((x - 60) % 5 < 3) & (y > 10) & (y < 190)
    return 0.005 * y + np.where(roof, 4.2, 0.0), ~roof


def sunken_square(x: Values, y: Values) -> Drawn:
    """A square 5 m under the street, houses around it."""
    houses = box(x, y, 40, 30, 160, 150) & ~box(x, y, 68, 68, 132, 117)
    return np.where(houses, 12.0, np.where(box(x, y, 70, 70, 130, 115), -5.0, 0.0)), ~houses


def hall_in_a_slope(x: Values, y: Values) -> Drawn:
    """A hall whose roof is flush with the slope uphill: what heights alone hardly tell from a terrace."""
    roof = box(x, y, 70, 60, 130, 130)
    return np.where(roof, 0.12 * 130 + 0.3, 0.12 * x), ~roof


def penthouses(x: Values, y: Values) -> Drawn:
    """A hall of 100 by 90 m with nine floors on its roof."""
    hall = box(x, y, 50, 50, 150, 140)
    upper = hall & ((x - 60) % 30 < 20) & ((y - 58) % 27 < 18) & (x >= 60) & (y >= 58)
    return np.where(hall, 8.0, 0.0) + np.where(upper, 5.0, 0.0), ~hall


def high_bay(x: Values, y: Values) -> Drawn:
    """A low hall that leans on a high one."""
    low, high = box(x, y, 50, 50, 150, 110), box(x, y, 50, 110, 150, 150)
    return np.where(high, 20.0, np.where(low, 7.0, 0.0)), ~(low | high)


def terraces(x: Values, y: Values) -> Drawn:
    """Terraces of 4 m, four of them with houses, all cut by the rim of the data."""
    level = 4.0 * np.clip(np.floor((x - 40) / 30), 0, 4)
    houses = (
        ((x - 40) % 30 >= 8) & ((x - 40) % 30 < 20) & (x >= 40) & (x < 160) & (y % 38 >= 15) & (y % 38 < 33)
    )
    return level + np.where(houses, 9.0, 0.0), ~houses


def fort(x: Values, y: Values) -> Drawn:
    """A fort 10 m high with nine houses, and a ramp of 12 m."""
    high = np.maximum(abs(x - 100), abs(y - 100)) < 55
    ramp = (abs(x - 100) < 6) & (y > 5) & (y < 45)
    houses = high & ((x - 55) % 32 < 22) & ((y - 55) % 32 < 22) & (x >= 55) & (y >= 55)
    z = np.where(high, 10.0, np.where(ramp, (y - 5) / 4, 0.0))
    return np.where(houses, 22.0, z), ~houses


def roof_in_the_corner(x: Values, y: Values) -> Drawn:
    """A roof of 35 by 40 m in the corner of the data."""
    roof = box(x, y, 0, 0, 35, 40)
    return np.where(roof, 9.0, 0.0), ~roof


KINDS: tuple[Callable[[Values, Values], Drawn], ...] = (
    court,
    closed_court,
    trains,
    sunken_square,
    hall_in_a_slope,
    penthouses,
    high_bay,
    terraces,
    fort,
    roof_in_the_corner,
)


def scan(kind: Callable[[Values, Values], Drawn], density: float, seed: int) -> tuple[PointCloud, Mask]:
    """A drawn square, scanned at random places and turned; what of it is ground."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0.0, SIDE_M, (round(density * SIDE_M**2), 2))
    z, truth = kind(*xy.T)
    angle = rng.uniform(0.0, np.pi)
    turn: NDArray[np.float64] = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    place = (xy - SIDE_M / 2) @ turn + 1000.0
    return PointCloud.from_world(np.c_[place, z + 50.0 + rng.normal(0.0, NOISE_M, len(z))]), truth


def main() -> None:
    """Print and keep the table."""
    rows: list[dict[str, object]] = []
    for kind in KINDS:
        for density in DENSITIES:
            scans = [scan(kind, density, seed) for seed in SEEDS]
            found = [(classify_ground(cloud).ground, ground_by_smrf(cloud.xyz)) for cloud, _ in scans]
            shares: dict[str, object] = {}
            for number, name in enumerate(("", "SMRF: ")):
                pairs = [(masks[number], truth) for masks, (_, truth) in zip(found, scans, strict=True)]
                lost = [100.0 * float(np.mean(truth & ~ground)) for ground, truth in pairs]
                taken = [100.0 * float(np.mean(~truth & ground)) for ground, truth in pairs]
                shares |= {
                    f"{name}ground lost %": float(np.mean(lost)),
                    f"{name}objects taken %": float(np.mean(taken)),
                    f"{name}worst total %": float(np.max(np.add(lost, taken))),
                }
            rows.append({"kind": kind.__name__.replace("_", " "), "points/m²": density, **shares})
    note = f"Shares of all points, means of {len(SEEDS)} scans, each turned by an angle of its own."
    keep(
        "ground-kinds",
        "Ground: what looks like another thing",
        rows,
        "python -m benchmarks.accuracy.ground_kinds",
        note,
    )


if __name__ == "__main__":
    main()
