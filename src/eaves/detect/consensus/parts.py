"""Parts of buildings: points of roof, wall, or a road vehicle: narrow, long, low, and level on top."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.detect.consensus.evidence import Evidence
from eaves.detect.stage import MOST, ROOM_M
from eaves.methods import Method, parameter
from eaves.model import Labels, Mask, Points, Values
from eaves.model.scene import ROOF, WALL
from eaves.raster.groups import shrunk_by_square


def part_of_points(
    xyz: Points,
    number: Labels,
    evidence: Evidence,
    region: Labels,
    max_residual: float,
    below_plane: float,
) -> NDArray[np.uint8]:
    """Codes (N,) for the points (N, 3) of regions `number` (N,), 0 for the others.

    Walls show only at the rim of a region; whatever lies inside it (chimneys, machinery, the floor of a
    light well) counts as roof. There a point `below_plane` (m) under its cell's plane is on the wall, and in
    a cell without a plane one twice as far under the highest.
    """
    part = np.where(number > 0, ROOF, 0).astype(np.uint8)
    inner = shrunk_by_square(region > 0, 5)
    flat = evidence.residual < max_residual
    lowest = np.where(flat, evidence.level - below_plane, evidence.top - 2.0 * below_plane)
    lowest = np.where(inner, -np.inf, lowest).ravel()
    some = np.flatnonzero(number > 0)
    part[some[xyz[some, 2] < lowest[evidence.cells.cell[some]]]] = WALL
    return part


class VehicleRules(Method):
    """The measures of road vehicles."""

    vehicle_width: float = parameter(
        ROOM_M,
        "Largest width of a vehicle, less than any room's: the legal limit is 2.55 m, and points stop "
        "short of edges.",
        unit="m",
        ge=0.0,
    )
    vehicle_length: float = parameter(1.9, "Least ratio of a vehicle's length to its width.", ge=0.0)
    vehicle_height: float = parameter(4.2, "Largest height of a vehicle's top.", unit="m", ge=0.0)
    vehicle_level: float = parameter(
        0.6,
        "Half the range of heights on top of a vehicle; what leaves it is something else.",
        unit="m",
        gt=0.0,
    )
    vehicle_flat: float = parameter(
        MOST,
        "Share at that level of what rises over half of it, and share of this in all: where walls are soft "
        "the middle of a narrow top alone is level.",
        ge=0.0,
        le=1.0,
    )


def find_vehicles(xyz: Points, height: Values, number: Labels, count: int, limits: VehicleRules) -> Mask:
    """Mask of the regions 0…`count` - 1 of points (N, 3), of which `number` (N,) tells the region, that are
    as long, narrow, low and level as a van or a lorry.

    Length and width are those of the rectangle with the same second moments as the points at the level of the
    region's middle height: what hangs over it, or stands beside it, does not count.
    """
    inside = np.flatnonzero(number > 0)
    low = middle_of_groups(height[inside], number[inside], count)
    middle_height = low[number[inside]]
    above = height[inside] - middle_height
    level = inside[np.abs(above) < limits.vehicle_level]
    raised = (above < limits.vehicle_level) & (above > -middle_height / 2)
    which = number[level]
    size = np.bincount(which, minlength=count)

    def mean(values: Values) -> Values:
        return np.asarray(np.bincount(which, values, count) / np.maximum(size, 1), np.float64)

    x, y = (xyz[level, axis] - mean(xyz[level, axis])[which] for axis in (0, 1))
    xx, xy, yy = mean(x * x), mean(x * y), mean(y * y)
    middle, spread = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    length = np.sqrt(12 * (middle + spread))
    width = np.sqrt(12 * np.maximum(middle - spread, 0.0))
    narrow = (width < limits.vehicle_width) & (length > limits.vehicle_length * width)
    body = np.bincount(number[inside[raised]], minlength=count)
    every = np.bincount(number[inside], minlength=count)
    flat = (size >= limits.vehicle_flat * body) & (body >= limits.vehicle_flat * every)
    return np.asarray(narrow & flat & (low < limits.vehicle_height) & (size > 0), np.bool_)


def middle_of_groups(values: Values, which: Labels, count: int) -> Values:
    """Median (count,) of the values (N,) of each group (N,) 0…count-1; zero where a group is empty."""
    order = np.lexsort((values, which))
    size = np.bincount(which, minlength=count)
    start = np.cumsum(size) - size
    middle = np.zeros(count)
    some = size > 0
    middle[some] = values[order][(start + size // 2)[some]]
    return middle
