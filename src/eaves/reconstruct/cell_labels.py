"""Which plane each cell of a plan gets: the fit of its points, the length of borders, a price per plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.geometry.coverage import OUTSIDE, Coverage, Integers
from eaves.geometry.labelling import label_nodes
from eaves.model import Labels, Points
from eaves.reconstruct.evidence import LOWEST_ROOF

RUNAWAY = 1e3
"""Cost (m²) of a metre beyond the heights a plane's points support: more than any misfit."""

UNKNOWN_PRICE = 0.3
"""Cost (m²) of a square metre under the level that stands for no plane at all."""


@dataclass(frozen=True)
class Prices:
    """What a label costs; the parameters of the method, under the same names."""

    misfit_limit: float
    gross_limit: float
    border: float
    plane: float
    overshoot: float
    reach_beyond: float


def points_in_cells(coverage: Coverage, points: Points) -> tuple[Integers, Integers]:
    """Pairs of point and cell (K,), (K,): which cell each of the points (N, 3) lies in; on a border, in
    several.
    """
    tree = shapely.STRtree(coverage.polygons())
    point, cell = tree.query(shapely.points(points[:, :2]), predicate="intersects")
    order = np.lexsort((cell, point))
    return point[order].astype(np.int64), cell[order].astype(np.int64)


def label_cells(
    coverage: Coverage,
    roof: Points,
    labels: Labels,
    planes: NDArray[np.float64],
    spacing: float,
    ground: float,
    prices: Prices,
) -> Integers:
    """The plane (C,) of every cell.

    `labels` (N,) say which of the `planes` (P, 3: a, b, c) each roof point (N, 3) supports; the last
    plane is the level that stands for no plane at all.
    """
    point, cell = points_in_cells(coverage, roof)
    rise = roof[:, :2] @ planes[:, :2].T + planes[:, 2]
    misfit = np.abs(roof[:, 2:] - rise) / np.sqrt(1.0 + (planes[:, :2] ** 2).sum(axis=1))
    cost = np.minimum((misfit / prices.misfit_limit) ** 2, 1.0)
    cost = (cost + np.minimum(misfit / prices.gross_limit, 1.0)) * spacing**2
    data: NDArray[np.float64] = np.column_stack(
        [np.bincount(cell, cost[point, plane], coverage.count) for plane in range(len(planes))]
    )
    data += RUNAWAY * beyond_support(coverage, roof, labels, planes, ground, prices)
    data[:, -1] += UNKNOWN_PRICE * coverage.area + 1e-6
    halves = np.flatnonzero((coverage.cell >= 0) & (coverage.cell[coverage.twin] > coverage.cell))
    edges = np.column_stack([coverage.cell[halves], coverage.cell[coverage.twin[halves]]])
    return label_nodes(
        data, edges, prices.border * coverage.length[halves], np.full(len(planes), prices.plane)
    )


def beyond_support(
    coverage: Coverage,
    roof: Points,
    labels: Labels,
    planes: NDArray[np.float64],
    ground: float,
    prices: Prices,
) -> NDArray[np.float64]:
    """How far (C, P; m) each plane leaves the heights of its own points, or sinks to the ground, over each
    cell.
    """
    low, high = np.full(len(planes), -np.inf), np.full(len(planes), np.inf)
    for number in range(len(planes) - 1):
        heights = roof[labels == number, 2]
        if len(heights):
            low[number], high[number] = np.percentile(heights, [1.0, 99.0])
    margin = prices.overshoot + prices.reach_beyond * np.hypot(planes[:, 0], planes[:, 1])
    inner = coverage.cell != OUTSIDE
    over = coverage.nodes[coverage.start[inner]] @ planes[:, :2].T + planes[:, 2]
    floor = np.maximum(low - margin, ground + LOWEST_ROOF)
    beyond = np.maximum(np.maximum(floor - over, over - high - margin), 0.0)
    worst = np.zeros((coverage.count, len(planes)))
    np.maximum.at(worst, coverage.cell[inner], beyond)
    return worst
