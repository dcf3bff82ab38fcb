"""From evidence to odds: the weights of the consensus, and what each of them is about."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eaves.detect.evidence import Evidence
from eaves.detect.segments import Segments
from eaves.model import Labels, Mask, Points, Values

SHARPNESS = 1.5
"""The regression was shrunk towards even odds; this undoes it."""


@dataclass(frozen=True)
class Weights:
    """Log odds of a surface for each unit of the terms of `judge_segments`."""

    constant: float
    area: float
    rough: float
    width: float
    height: float
    through: float
    several: float


WITH_ECHOES = Weights(2.1, area=0.8, rough=-3.6, width=0.46, height=1.9, through=-3.1, several=-4.75)
WITHOUT_ECHOES = Weights(2.0, area=0.86, rough=-3.6, width=0.58, height=1.1, through=-5.3, several=0.0)


@dataclass(frozen=True)
class ScoreWeights:
    """Log odds that a region is a building for each unit of the terms of `score_regions`."""

    constant: float
    odds: float
    area: float
    """Per doubling of the area of the smallest shed."""


SCORE = ScoreWeights(0.54, odds=0.49, area=0.97)
"""Logistic regression over 953 regions, 21 of them false, of 21 simulated towns (seeds 7100 to 7120, 1.5 to
30 points/m²); `benchmarks.accuracy.detection_scores` judges it on others."""

SHED_M2, DOOR_M, SHED_HEIGHT_M, ROUGH_M = 6.0, 2.5, 2.5, 0.05
"""Where the terms are zero: the smallest shed, its width and height, a residual no roof's noise explains."""
STOREY_M = 3.0
"""Bushes and hedges stay below a storey; above it height tells nothing of a cell."""
LOW_CELL = 1.2
"""Log odds that a rough cell loses for each metre under a storey."""
VEHICLE_WIDTH_M = 2.45
"""Road vehicles and containers are narrower (the legal limit is 2.55 m, and points stop short of edges)."""
VEHICLE_HEIGHT_M = 4.2
VEHICLE_LEVEL_M = 0.6
"""Half the range of heights on top of a vehicle; what leaves it is something else."""
VEHICLE_FLAT = 0.75
"""So much of a vehicle is at that level; a shed with a pitched roof has less."""
VEHICLE_LENGTH = 1.9
"""Vehicles are at least so many times longer than wide."""


def judge_segments(segments: Segments, echoes: bool) -> Values:
    """Log odds (K,) that each surface is a roof."""
    weight = WITH_ECHOES if echoes else WITHOUT_ECHOES
    odds = (
        weight.constant
        + weight.area * np.clip(np.log2(np.maximum(segments.area, 0.1) / SHED_M2), -2.0, 4.0)
        + weight.rough * np.clip(np.log(np.maximum(segments.residual, 1e-4) / ROUGH_M), 0.0, 1.0)
        + weight.width * np.clip(segments.width - DOOR_M, -2.0, 2.0)
        + weight.height * np.clip(segments.height - SHED_HEIGHT_M, -1.0, 1.5)
        + weight.through * segments.through
        + weight.several * segments.several
    )
    return np.asarray(SHARPNESS * odds, np.float64)


def judge_cells(evidence: Evidence, max_residual: float, echoes: bool) -> Values:
    """Log odds (H, W) of cells in no surface: chimneys and eaves split few pulses, crowns many; bushes are
    low."""
    if echoes:
        low = np.clip(evidence.height - STOREY_M, -1.5, 0.0)
        return np.asarray(2.0 - 5.0 * evidence.several - evidence.through + LOW_CELL * low, np.float64)
    rough = np.clip(np.log(np.minimum(evidence.residual, 10.0) / max_residual), -1.5, 2.0)
    return np.asarray(-0.8 - 0.3 * rough - evidence.through, np.float64)


def score_regions(region: Labels, odds: Values, side: float) -> Values:
    """How sure each region 1…K of (H, W) is, 0 to 1, from its cells' mean odds and its area.

    `side` (m) is that of a cell. Of the regions with a score of 0.9, nine in ten are buildings.
    """
    count = int(region.max(initial=0))
    size = np.bincount(region.ravel(), minlength=count + 1)[1:]
    total = np.bincount(region.ravel(), weights=np.clip(odds, -8.0, 8.0).ravel(), minlength=count + 1)[1:]
    large = np.clip(np.log2(np.maximum(size, 1) * side * side / SHED_M2), 0.0, 4.0)
    weight = SCORE
    sure = weight.constant + weight.odds * total / np.maximum(size, 1) + weight.area * large
    return np.asarray(1.0 / (1.0 + np.exp(-sure)), np.float64)


def looks_like_vehicle(xyz: Points, height: Values, number: Labels) -> Mask:
    """Which of the regions 0…K is as long, as narrow and as low as a van, a lorry or a container, (K + 1,).

    Length and width are those of the rectangle with the same second moments as the points at the level of the
    region's middle height: what hangs over it, or stands beside it, does not count.
    """
    count = int(number.max(initial=0)) + 1
    inside = np.flatnonzero(number > 0)
    low = middle_of_groups(height[inside], number[inside], count)
    level = inside[np.abs(height[inside] - low[number[inside]]) < VEHICLE_LEVEL_M]
    which = number[level]
    size = np.maximum(np.bincount(which, minlength=count), 1)
    x, y = (xyz[level, axis] for axis in (0, 1))
    mean_x = np.bincount(which, weights=x, minlength=count) / size
    mean_y = np.bincount(which, weights=y, minlength=count) / size
    x, y = x - mean_x[which], y - mean_y[which]
    xx, xy, yy = (np.bincount(which, weights=term, minlength=count) / size for term in (x * x, x * y, y * y))
    middle, spread = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    length = np.sqrt(12 * (middle + spread))
    width = np.sqrt(12 * np.maximum(middle - spread, 0.0))
    narrow = (width < VEHICLE_WIDTH_M) & (length > VEHICLE_LENGTH * width) & (low < VEHICLE_HEIGHT_M)
    flat = size >= VEHICLE_FLAT * np.bincount(number[inside], minlength=count)
    flat[0] = False
    return np.asarray(narrow & flat, np.bool_)


def middle_of_groups(values: Values, which: Labels, count: int) -> Values:
    """Median (count,) of the values (N,) of each group (N,) 0…count-1; zero where a group is empty."""
    order = np.lexsort((values, which))
    size = np.bincount(which, minlength=count)
    start = np.cumsum(size) - size
    middle = np.zeros(count)
    some = size > 0
    middle[some] = values[order][(start + size // 2)[some]]
    return middle
