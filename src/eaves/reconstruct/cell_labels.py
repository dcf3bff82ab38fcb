"""Which plane each cell of a plan gets: the fit of its points, the length of borders, a price per plane."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.geometry.coverage import OUTSIDE, Coverage, Integers
from eaves.geometry.labelling import LARGEST, Jumps, label_nodes
from eaves.model import Labels, Mask, Points, Values
from eaves.reconstruct.evidence import LOWEST_ROOF

RUNAWAY = 1e3
"""Cost (m²) of a metre beyond the heights a plane's points support: more than any misfit."""

UNKNOWN_PRICE = 0.3
"""Cost (m²) of a square metre under the level that stands for no plane at all."""
LEAST_SHARE = 0.3
"""Share of the price of a border that is due where the two planes meet: ridges and valleys are cheap."""

FULL_JUMP = 0.5
"""Height (m) of a jump from which on a border costs its full price."""

GAUSS_PLACES = (0.2113, 0.7887)
"""Where along a border its jump is measured: the two places of Gauss and Legendre's rule."""
FREE_MISFIT = 0.03
"""Distance (m) of a point from its plane that costs nothing: noise, which no other plane explains better."""

FARTHEST = 5.0
"""A plane may cover cells this near (m) to the rectangle around its points, which bounds the work."""


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
    data: NDArray[np.float64] = np.full((coverage.count, len(planes)), LARGEST)
    for number, near in enumerate(cells_near(coverage, roof, labels, len(planes))):
        mine = near[cell]
        a, b, c = planes[number].tolist()
        places = roof[point[mine]]
        misfit = np.abs(places[:, 2] - places[:, 0] * a - places[:, 1] * b - c) / np.sqrt(1.0 + a**2 + b**2)
        misfit = np.maximum(misfit - FREE_MISFIT, 0.0)
        cost = np.minimum((misfit / prices.misfit_limit) ** 2, 1.0)
        cost = (cost + np.minimum(misfit / prices.gross_limit, 1.0)) * spacing**2
        data[near, number] = np.bincount(cell[mine], cost, coverage.count)[near]
        heights = roof[labels == number, 2]
        data[near, number] += RUNAWAY * beyond_support(
            coverage, near, heights, planes[number], ground, prices
        )
    data[:, -1] += UNKNOWN_PRICE * coverage.area + 1e-6
    np.minimum(data, LARGEST, out=data)
    halves = np.flatnonzero((coverage.cell >= 0) & (coverage.cell[coverage.twin] > coverage.cell))
    edges = np.column_stack([coverage.cell[halves], coverage.cell[coverage.twin[halves]]])
    start, end = coverage.nodes[coverage.start[halves]], coverage.nodes[coverage.end[halves]]
    places = np.stack([start + share * (end - start) for share in GAUSS_PLACES], axis=1)
    jumps = Jumps(places, planes, LEAST_SHARE, FULL_JUMP)
    border = prices.border * coverage.length[halves]
    return label_nodes(data, edges, border, np.full(len(planes), prices.plane), jumps)


def cells_near(coverage: Coverage, roof: Points, labels: Labels, count: int) -> Iterator[Mask]:
    """For each of `count` planes the cells (C,) that may have it: those near the rectangle of its points.

    The last plane stands for nothing known and may be anywhere.
    """
    inner = coverage.cell != OUTSIDE
    low, high = np.full((coverage.count, 2), np.inf), np.full((coverage.count, 2), -np.inf)
    np.minimum.at(low, coverage.cell[inner], coverage.nodes[coverage.start[inner]])
    np.maximum.at(high, coverage.cell[inner], coverage.nodes[coverage.start[inner]])
    for number in range(count - 1):
        places = roof[labels == number, :2]
        if len(places) == 0:
            yield np.zeros(coverage.count, bool)
            continue
        west_south, east_north = places.min(axis=0) - FARTHEST, places.max(axis=0) + FARTHEST
        yield np.asarray(((low <= east_north) & (high >= west_south)).all(axis=1))
    yield np.ones(coverage.count, bool)


def beyond_support(
    coverage: Coverage,
    near: Mask,
    heights: Values,
    plane: NDArray[np.float64],
    ground: float,
    prices: Prices,
) -> Values:
    """How far (K,; m) a plane (3,) leaves the heights of its own points, or sinks to the ground, over each
    of the cells `near` (C,).
    """
    low, high = np.percentile(heights, [1.0, 99.0]) if len(heights) else (-np.inf, np.inf)
    margin = prices.overshoot + prices.reach_beyond * float(np.hypot(plane[0], plane[1]))
    halves = np.flatnonzero(np.append(near, False)[coverage.cell])
    halves = halves[np.argsort(coverage.cell[halves], kind="stable")]
    if len(halves) == 0:
        return np.zeros(0)
    over = coverage.nodes[coverage.start[halves]] @ plane[:2] + plane[2]
    floor = max(low - margin, ground + LOWEST_ROOF)
    beyond = np.maximum(np.maximum(floor - over, over - high - margin), 0.0)
    first = np.searchsorted(coverage.cell[halves], np.flatnonzero(near))
    return np.asarray(np.maximum.reduceat(beyond, first))
