"""The edges of a row's roofs, on the street and behind: do their jogs follow the walls of houses?

Jogs alone say nothing: in real towns bays, porches and wings make as many as neighbours of unequal depth do.
Jogs at the distances of houses do.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import kernel
from eaves.methods import Method, parameter
from eaves.model import Mask, Points
from eaves.units.row_walls.rows import CELL_M, Plan, Row

OUTERMOST = 4
"""So many outermost points of each step are kept: less than so many points beyond an edge are not its own."""

INSIDE_M = (0.5, 3.0)
"""The density of points is that between these distances (m) behind the edge."""

BEYOND_M = 0.5
"""Where the block goes on this far (m) behind a row, the row ends without an edge."""

FEWEST_STEPS = 8
"""A shorter edge (in steps) tells nothing."""


class EdgeRules(Method):
    """What an edge of a row is."""

    most_jog: float = parameter(
        1.0, "Deeper by more is a wing or an annex, which says nothing of a wall.", unit="m", gt=0.0
    )
    level_cost: float = parameter(
        2.0,
        "Logarithm of how many places an edge may have: some seven, a decimetre or two apart within the jog.",
        ge=0.0,
    )
    jog_cost: float = parameter(
        3.0,
        "Logarithm of how many places along an edge a jog may have: a quarter of a metre each, one in 5 m.",
        ge=0.0,
    )
    stray_cost: float = parameter(
        3.0, "Logarithm of how much rarer points are beyond an edge than behind it: one in twenty.", ge=0.0
    )
    widest_usual: float = parameter(12.0, "Greatest usual width of a regular row.", unit="m", gt=0.0)


def edge_gains(row: Row, plan: Plan, points: Points, limits: EdgeRules) -> list[NDArray[np.float64]]:
    """For each edge of a row that has jogs, at most two, the log-likelihood (S + 1, K; first step, steps) of
    one straight edge over so many steps, over that of the best edges with jogs anywhere; from points (N, 3)
    of the main volume.

    Points lie at random behind an edge, so that ground of area A without any has the likelihood exp(−d A),
    d their density; the likeliest edge runs through the outermost point that is no stray.
    """
    s, t = row.coordinates(points[:, :2])
    step = np.floor(s / CELL_M).astype(np.int64)
    inside = (step >= 0) & (step < len(row.first))
    s, t, step = s[inside], t[inside], step[inside]
    middle = CELL_M * np.arange(0.5, len(row.first), dtype=np.float64)
    found = []
    for border, way in ((row.first, -1.0), (row.last, 1.0)):
        goes_on = plan.main[plan.cells(*row.place(middle, border + way * BEYOND_M))]
        free = (row.last > row.first) & ~goes_on
        out = way * (t - border[step])
        near = free[step] & (out < limits.most_jog) & (out > -INSIDE_M[1])
        if free.sum() < FEWEST_STEPS or not near.any():
            continue
        behind = int((near & (out < -INSIDE_M[0])).sum())
        density = behind / (free.sum() * CELL_M * (INSIDE_M[1] - INSIDE_M[0]))
        level = levelled(s[near], way * t[near])
        lowest = -limits.most_jog - INSIDE_M[0]
        outermost = outermost_points(
            step[near], np.clip(level, lowest, limits.most_jog), len(row.first), lowest
        )
        likely = edges_kernel(outermost, free, density * CELL_M, limits.stray_cost) - limits.level_cost
        best = jogs_kernel(likely, limits.jog_cost)
        if best[-1] <= likely[0, -1]:
            continue
        steps = np.arange(min(len(best), int(2.0 * limits.widest_usual / CELL_M) + 1))
        ends = np.minimum(np.arange(len(best))[:, None] + steps, len(best) - 1)
        found.append(likely[:, : len(steps)] - (best[ends] - best[:, None]))
    return found


def levelled(s: NDArray[np.float64], t: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far out points (N,) lie from the straight line along their outermost ones, fitted by the median of
    slopes [theil1950] over metres of the row.
    """
    metre = s.astype(np.int64)
    outer = np.full(int(metre.max()) + 1, -np.inf)
    np.maximum.at(outer, metre, t)
    there = np.flatnonzero(np.isfinite(outer))
    one, two = np.triu_indices(len(there), 1)
    rise, run = outer[there[two]] - outer[there[one]], there[two] - there[one]
    slope = float(np.median((rise / run)[run >= min(3, run.max())])) if len(run) else 0.0
    return np.asarray(t - slope * s - np.median(outer[there] - slope * (there + 0.5)))


def outermost_points(
    step: NDArray[np.int64], out: NDArray[np.float64], steps: int, lowest: float
) -> NDArray[np.float64]:
    """The `OUTERMOST` greatest values (S, 4) of each step, the greatest first, `lowest` where too few are."""
    order = np.lexsort((-out, step))
    first = np.searchsorted(step[order], np.arange(steps + 1))
    outermost = np.full((steps, OUTERMOST), lowest)
    for k in range(OUTERMOST):
        some = np.diff(first) > k
        outermost[some, k] = out[order][first[:-1][some] + k]
    return outermost


@kernel
def edges_kernel(
    outermost: NDArray[np.float64], free: Mask, rate: float, stray_cost: float
) -> NDArray[np.float64]:
    """Log-likelihood (S + 1, S + 1; first step, steps) of the likeliest edge over so many steps; `rate` is
    the number of points on a step and metre.
    """
    steps, kept = outermost.shape
    likely = np.full((steps + 1, steps + 1), -np.inf)
    most = np.zeros(kept)
    for start in range(steps):
        width = 0
        for end in range(start, steps):
            if free[end]:
                if width == 0:
                    most[:] = -np.inf
                width += 1
                for value in outermost[end]:
                    for k in range(kept):
                        if value > most[k]:
                            for m in range(kept - 1, k, -1):
                                most[m] = most[m - 1]
                            most[k] = value
                            break
            best = 0.0 if width == 0 else -np.inf
            if width > 0:
                for k in range(kept):
                    best = max(best, -rate * width * most[k] - stray_cost * k)
            likely[start, end + 1 - start] = best
    return likely


@kernel
def jogs_kernel(likely: NDArray[np.float64], jog_cost: float) -> NDArray[np.float64]:
    """For each step (S + 1,) the log-likelihood of the best edges up to it, with jogs anywhere."""
    count = len(likely)
    best = np.full(count, -np.inf)
    best[0] = 0.0
    for end in range(1, count):
        for start in range(end):
            jog = jog_cost if start > 0 else 0.0
            best[end] = max(best[end], best[start] + likely[start, end - start] - jog)
    return best
