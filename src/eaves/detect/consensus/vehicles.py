"""Which regions are road vehicles: narrow, long, low, and level on top."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eaves.methods import Method, parameter
from eaves.model import Labels, Mask, Points, Values

LEAST_VARIANCE_M2 = 1e-6
"""Of the coordinates across a region: narrower ones have no slope (m², a tolerance)."""


class VehicleRules(Method):
    """What road vehicles are like."""

    vehicle_width: float = parameter(
        2.45,
        "Vehicles are narrower: the legal limit is 2.55 m, and points stop short of edges.",
        unit="m",
        ge=0.0,
    )
    vehicle_length: float = parameter(1.9, "They are at least so many times longer than wide.", ge=0.0)
    vehicle_height: float = parameter(4.2, "Their tops are lower.", unit="m", ge=0.0)
    vehicle_level: float = parameter(
        0.6,
        "Half the range of heights on top of a vehicle; what leaves it is something else.",
        unit="m",
        gt=0.0,
    )
    vehicle_flat: float = parameter(
        0.75, "Share of a vehicle at that level; a shed with a pitched roof has less.", ge=0.0, le=1.0
    )
    vehicle_tilt: float = parameter(
        10.0, "A vehicle's top leans less to the side.", unit="degree", ge=0.0, lt=90.0
    )
    vehicle_uneven: float = parameter(
        0.07,
        "Half of its points lie closer to one plane; a pitched roof is told by either.",
        unit="m",
        ge=0.0,
    )
    vehicle_points: int = parameter(20, "Fewer points on top tell nothing of a pitched roof.", ge=0)


@dataclass(frozen=True, eq=False)
class Tops:
    """What the tops of the regions 0…K are like, (K + 1,) each."""

    low: Values
    """Middle height (m) over the terrain; inf where a region has no points, and so for `width`."""
    width: Values
    """Width (m) of the rectangle with the same second moments as the points near the middle height."""
    vehicle: Mask
    """Whether it is as long, narrow, low and level as a van or a lorry."""


def measure_tops(xyz: Points, height: Values, number: Labels, count: int, limits: VehicleRules) -> Tops:
    """The tops of the regions 0…`count` - 1 of points (N, 3), of which `number` (N,) tells the region.

    Length and width are those of the rectangle with the same second moments as the points at the level of the
    region's middle height: what hangs over it, or stands beside it, does not count.
    """
    inside = np.flatnonzero(number > 0)
    low = middle_of_groups(height[inside], number[inside], count)
    level = inside[np.abs(height[inside] - low[number[inside]]) < limits.vehicle_level]
    which = number[level]
    size = np.bincount(which, minlength=count)

    def centred(values: Values) -> Values:
        mean = np.bincount(which, weights=values, minlength=count) / np.maximum(size, 1)
        return np.asarray(values - mean[which], np.float64)

    def product(one: Values, two: Values) -> Values:
        return np.bincount(which, weights=one * two, minlength=count) / np.maximum(size, 1)

    x, y, rise = centred(xyz[level, 0]), centred(xyz[level, 1]), centred(height[level])
    xx, xy, yy = product(x, x), product(x, y), product(y, y)
    middle, spread = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    length = np.sqrt(12 * (middle + spread))
    width = np.sqrt(12 * np.maximum(middle - spread, 0.0))
    narrow = (
        (width < limits.vehicle_width)
        & (length > limits.vehicle_length * width)
        & (low < limits.vehicle_height)
    )
    flat = size >= limits.vehicle_flat * np.bincount(number[inside], minlength=count)
    flat[0] = False

    along = 0.5 * np.arctan2(2 * xy, xx - yy)
    u = x * np.cos(along)[which] + y * np.sin(along)[which]
    v = y * np.cos(along)[which] - x * np.sin(along)[which]
    climb = product(rise, u) / np.maximum(product(u, u), LEAST_VARIANCE_M2)
    tilt = product(rise, v) / np.maximum(product(v, v), LEAST_VARIANCE_M2)
    rest = middle_of_groups(np.abs(rise - climb[which] * u - tilt[which] * v), which, count)
    pitched = (np.abs(tilt) > np.tan(np.radians(limits.vehicle_tilt))) | (rest > limits.vehicle_uneven)
    vehicle = narrow & flat & ~(pitched & (size >= limits.vehicle_points))
    some = size > 0
    return Tops(np.where(some, low, np.inf), np.where(some, width, np.inf), vehicle)


def middle_of_groups(values: Values, which: Labels, count: int) -> Values:
    """Median (count,) of the values (N,) of each group (N,) 0…count-1; zero where a group is empty."""
    order = np.lexsort((values, which))
    size = np.bincount(which, minlength=count)
    start = np.cumsum(size) - size
    middle = np.zeros(count)
    some = size > 0
    middle[some] = values[order][(start + size // 2)[some]]
    return middle
