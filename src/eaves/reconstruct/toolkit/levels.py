"""The coarser levels of detail from the plan of the finest: LoD 2.0, 1.3 and 1.2."""

from __future__ import annotations

import numpy as np

from eaves.geometry.planes import group_percentiles, quantile
from eaves.model import Integers, Points, Solid, Values
from eaves.reconstruct.toolkit.evidence import (
    PRISM_PERCENTILE,
)
from eaves.solids.coverage import Coverage
from eaves.solids.extrude import LOWEST_ROOF, extrude_plan, without_numbers

MOST_WORK = 50_000_000
"""Heights times cells that are looked at when levels are grouped; of more, evenly chosen heights speak."""


def group_levels(plan: Coverage, cell: Integers, heights: Values, jump: float) -> Integers:
    """A group (C,) for each cell: neighbours whose heights differ by less than `jump` (m) are one level.

    Neighbours join in the order of their height difference, and a group's height is that of all its
    points, so a row of small steps does not run together into one level. `cell` and `heights`
    (K,) are those of the roof points.
    """
    every = max(1, len(heights) * plan.count // MOST_WORK)
    if every > 1:
        order = np.lexsort((heights, cell))[::every]
        cell, heights = cell[order], heights[order]
    group = np.arange(plan.count)
    halves = np.flatnonzero((plan.cell >= 0) & (plan.cell[plan.twin] > plan.cell))
    keys = np.unique(plan.cell[halves] * plan.count + plan.cell[plan.twin[halves]])
    pairs = np.column_stack([keys // plan.count, keys % plan.count])
    height = level_heights(group[cell], heights, plan.count)
    while len(pairs):
        first, second = group[pairs[:, 0]], group[pairs[:, 1]]
        step = np.abs(height[first] - height[second])
        step = np.where(first == second, np.inf, np.where(np.isnan(step), 0.0, step))
        nearest = int(np.argmin(step))
        if not step[nearest] < jump:
            break
        group[group == second[nearest]] = first[nearest]
        members = group[cell] == first[nearest]
        height[first[nearest]] = (
            quantile(heights[members], PRISM_PERCENTILE / 100.0) if members.any() else np.nan
        )
    return np.unique(group, return_inverse=True)[1].ravel().astype(np.int64)


def flat_plan(
    plan: Coverage, group: Integers, cell: Integers, heights: Values, ground: float
) -> tuple[Coverage, Values]:
    """The plan with the cells of a group (C,) made one, and a horizontal plane (G, 3) for each of its cells.

    `cell` and `heights` (K,) are those of the roof points.
    """
    merged, names = plan.merged(group)
    height = level_heights(plan.regions(group)[0][cell], heights, merged.count)
    typical = quantile(heights, PRISM_PERCENTILE / 100.0) if len(heights) else ground
    height = np.maximum(np.where(np.isnan(height), typical, height), ground + LOWEST_ROOF)
    return merged, np.column_stack([np.zeros((len(names), 2)), height])


def level_heights(cell: Integers, heights: Values, count: int) -> Values:
    """The roof height (C,) of each cell: the 70th percentile of its points' heights; NaN without points."""
    return group_percentiles(heights, cell, count, PRISM_PERCENTILE)


def coarse_solids(
    plan: Coverage,
    roof: Points,
    ground: float,
    jump: float,
    smallest: float,
) -> dict[str, tuple[Solid, ...]]:
    """The sound solids at LoD 1.2 and 1.3 over a plan; `smallest` (m²) is the least face."""
    point, cell = plan.cells_of(roof)
    heights = roof[point, 2]
    single, levels = np.zeros(plan.count, np.int64), group_levels(plan, cell, heights, jump)
    solids: dict[str, tuple[Solid, ...]] = {}
    for lod, group in (("1.2", single), ("1.3", levels)):
        if group is levels and np.array_equal(plan.regions(levels)[0], plan.regions(single)[0]):
            if "1.2" in solids:
                solids[lod] = solids["1.2"]
            continue
        level, planes = flat_plan(plan, group, cell, heights, ground)
        raised = extrude_plan(level, np.arange(level.count), planes, ground, smallest)
        if raised.solids:
            solids[lod] = without_numbers(raised.solids)
    return solids
