"""Which plane each cell of a plan gets: the fit of its points, the length of borders, a price per plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eaves.geometry.percentiles import group_percentiles
from eaves.kernels import kernel
from eaves.model import Labels, Points, Values
from eaves.reconstruct.toolkit.alpha_expansion import LARGEST, HeightSteps, alpha_expansion
from eaves.reconstruct.toolkit.coverage import Coverage
from eaves.reconstruct.toolkit.evidence import LOWEST_ROOF
from eaves.reconstruct.toolkit.half_edges import OUTSIDE, Integers

RUNAWAY = 1e3
"""Cost (m²) of a metre beyond the heights a plane's points support: more than any residual."""

GAUSS_PLACES = (0.2113, 0.7887)
"""Where along a border its jump is measured: the two places of Gauss and Legendre's rule."""


@dataclass(frozen=True)
class LabelCosts:
    """What a label costs; the parameters of the method, under the same names."""

    residual_limit: float
    gross_limit: float
    border: float
    plane: float
    overshoot: float
    reach_beyond: float
    farthest: float
    support_trim: float
    free_misfit: float
    least_rise: float
    unknown: float
    meeting_share: float
    full_jump: float


@dataclass(frozen=True, eq=False)
class PlaneReach:
    """The roof points (N, 3), the planes (P, 3: a, b, c) they support, and where these may be: in the
    rectangles `box` (P, 4), between `floor` and `ceiling` (P,; m), and nowhere over `highest` (P,; m).

    The last plane is the level that stands for no plane at all and may be anywhere.
    """

    roof: Points
    planes: NDArray[np.float64]
    spacing: float
    box: NDArray[np.float64]
    floor: Values
    ceiling: Values
    highest: Values


def plane_reach(
    roof: Points,
    labels: Labels,
    planes: NDArray[np.float64],
    spacing: float,
    ground: float,
    costs: LabelCosts,
) -> PlaneReach:
    """Where planes (P, 3) may be: near the rectangles around their own points and near the heights of these.

    `labels` (N,) say which of them each roof point (N, 3) supports.
    """
    count = len(planes)
    mine = labels >= 0
    group, places = labels[mine], roof[mine]
    order = np.lexsort((places[:, 2], group))
    first = np.searchsorted(group[order], np.arange(count))
    some = np.bincount(group, minlength=count) > 0
    box = np.full((count, 4), np.inf)
    box[:, 2:] = -np.inf
    if some.any():
        box[some, :2] = np.minimum.reduceat(places[order, :2], first[some])
        box[some, 2:] = np.maximum.reduceat(places[order, :2], first[some])
    box += costs.farthest * np.array([-1.0, -1.0, 1.0, 1.0])
    box[-1] = -np.inf, -np.inf, np.inf, np.inf
    ends = costs.support_trim, 100.0 - costs.support_trim
    low, high = (group_percentiles(places[order, 2], group[order], count, percent) for percent in ends)
    margin = costs.overshoot + costs.reach_beyond * np.hypot(planes[:, 0], planes[:, 1])
    floor = np.where(np.isnan(low), -np.inf, low) - margin
    ceiling = np.where(np.isnan(high), np.inf, high) + margin
    highest = highest_allowed(roof, planes, spacing, costs.least_rise)
    return PlaneReach(
        roof,
        planes,
        spacing,
        box,
        np.maximum(floor, ground + LOWEST_ROOF),
        np.minimum(ceiling, highest),
        highest,
    )


def label_cells(
    coverage: Coverage, reach: PlaneReach, costs: LabelCosts, located: tuple[Integers, Integers]
) -> Integers:
    """The plane (C,) of every cell; `located` are the roof points and the cells they lie in."""
    planes = reach.planes
    data = cell_costs(coverage, reach, costs, located)
    halves = np.flatnonzero((coverage.cell >= 0) & (coverage.cell[coverage.twin] > coverage.cell))
    edges = np.column_stack([coverage.cell[halves], coverage.cell[coverage.twin[halves]]])
    start, end = coverage.nodes[coverage.start[halves]], coverage.nodes[coverage.end[halves]]
    places = np.stack([start + share * (end - start) for share in GAUSS_PLACES], axis=1)
    steps = HeightSteps(places, planes, costs.meeting_share, costs.full_jump)
    border = costs.border * coverage.length[halves]
    return alpha_expansion(data, edges, border, np.full(len(planes), costs.plane), steps)


def cell_costs(
    coverage: Coverage, reach: PlaneReach, costs: LabelCosts, located: tuple[Integers, Integers]
) -> NDArray[np.float64]:
    """The cost (C, P; m²) of every plane for every cell, arguments as for `label_cells`.

    Only planes near a cell may have it: those the rectangle around whose points is near the cell's.
    """
    point, cell = located
    order = np.argsort(cell, kind="stable")
    inner = np.flatnonzero(coverage.cell != OUTSIDE)
    inner = inner[np.argsort(coverage.cell[inner], kind="stable")]
    data: NDArray[np.float64] = cell_costs_kernel(
        reach.roof[point[order]],
        np.searchsorted(cell[order], np.arange(coverage.count + 1)),
        coverage.nodes[coverage.start[inner]],
        np.searchsorted(coverage.cell[inner], np.arange(coverage.count + 1)),
        reach.planes,
        np.array([np.sqrt(1.0 + a**2 + b**2) for a, b, _ in reach.planes.tolist()]),
        reach.box,
        reach.floor,
        reach.ceiling,
        costs.residual_limit,
        costs.gross_limit,
        costs.free_misfit,
        reach.spacing**2,
    )
    data[:, -1] += costs.unknown * coverage.area + 1e-6
    return np.asarray(np.minimum(data, LARGEST))


def hold_down(coverage: Coverage, chosen: Integers, reach: PlaneReach, costs: LabelCosts) -> Integers:
    """The plane (C,) of every cell, `chosen` but for those that rise above what `highest_allowed` allows;
    they get the plane of least cost.
    """
    halves = np.flatnonzero(coverage.cell >= 0)
    cell, corner = coverage.cell[halves], coverage.nodes[coverage.start[halves]]
    a, b, c = reach.planes[chosen[cell]].T
    over = cell[corner[:, 0] * a + corner[:, 1] * b + c > reach.highest[chosen[cell]]]
    if len(over) == 0:
        return chosen
    over = np.unique(over)
    answer = chosen.copy()
    answer[over] = cell_costs(coverage, reach, costs, coverage.cells_of(reach.roof))[over].argmin(axis=1)
    return answer


def highest_allowed(roof: Points, planes: NDArray[np.float64], spacing: float, least: float) -> Values:
    """The height (P,; m) no plane may rise above: a little over the highest of all roof points (N, 3).

    That is `least` (m), and more where the slope is steep and points are sparse: a ridge rises so far between
    two points.
    """
    rise = 0.25 * spacing * np.hypot(planes[:, 0], planes[:, 1])
    return np.asarray(roof[:, 2].max() + np.maximum(rise, least))


@kernel
def cell_costs_kernel(
    places: Points,
    first: Integers,
    corners: NDArray[np.float64],
    start: Integers,
    planes: NDArray[np.float64],
    steepness: Values,
    box: NDArray[np.float64],
    floor: Values,
    ceiling: Values,
    residual_limit: float,
    gross_limit: float,
    free_misfit: float,
    point_area: float,
) -> NDArray[np.float64]:
    """The residual (C, P; m²) of every plane's points in every cell, and of heights its own do not support.

    Points `first[c]` to `first[c + 1]` of `places` (K, 3) are in cell c, the `corners` (M, 2) likewise from
    `start`. `steepness` (P,) is √(1 + a² + b²), `box` (P, 4) where a plane may be, `floor` and `ceiling`
    (P,; m) the heights it may have.
    """
    data = np.full((len(first) - 1, len(planes)), LARGEST)
    for cell in range(len(first) - 1):
        west, south, east, north = np.inf, np.inf, -np.inf, -np.inf
        for corner in range(start[cell], start[cell + 1]):
            west, east = min(west, corners[corner, 0]), max(east, corners[corner, 0])
            south, north = min(south, corners[corner, 1]), max(north, corners[corner, 1])
        for plane in range(len(planes)):
            if west > box[plane, 2] or south > box[plane, 3] or east < box[plane, 0] or north < box[plane, 1]:
                continue
            a, b, c = planes[plane]
            beyond = 0.0
            for corner in range(start[cell], start[cell + 1]):
                over = corners[corner, 0] * a + corners[corner, 1] * b + c
                beyond = max(beyond, floor[plane] - over, over - ceiling[plane])
            cost = 0.0
            for point in range(first[cell], first[cell + 1]):
                residual = abs(places[point, 2] - places[point, 0] * a - places[point, 1] * b - c)
                residual = max(residual / steepness[plane] - free_misfit, 0.0)
                share = residual / residual_limit
                cost += (min(share * share, 1.0) + min(residual / gross_limit, 1.0)) * point_area
            data[cell, plane] = cost + RUNAWAY * beyond
    return data
