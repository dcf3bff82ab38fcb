"""Which plane each cell of a plan gets: the fit of its points, the length of borders, a price per plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from eaves.kernels import kernel
from eaves.methods import parameter
from eaves.model import Labels, Points, Values
from eaves.reconstruct.toolkit.coverage import Coverage
from eaves.reconstruct.toolkit.evidence import LOWEST_ROOF
from eaves.reconstruct.toolkit.half_edges import OUTSIDE, Integers
from eaves.reconstruct.toolkit.labelling import LARGEST, Borders, label_nodes

RUNAWAY = 1e3
"""Cost (m²) of a metre under the lowest roof: more than any residual."""

GAUSS_PLACES = (0.2113, 0.7887)
"""Where along a border its jump is measured: the two places of Gauss and Legendre's rule."""


class LabelCosts(BaseModel):
    """What a label costs: parameters of a method that labels cells."""

    residual_limit: float = parameter(
        0.35, "Distance from a plane at which a point's residual stops growing.", unit="m", symbol="τ", gt=0.0
    )
    gross_limit: float = parameter(
        2.0, "Distance at which a point's gross residual, added, stops growing.", unit="m", symbol="g", gt=0.0
    )
    border_cost: float = parameter(
        0.3,
        "Price of a metre of border with a jump, as square metres of residual.",
        unit="m",
        symbol="β",
        ge=0.0,
    )
    meeting_share: float = parameter(
        0.2,
        "Share of the price of a border that is due where the two planes meet: ridges and valleys are cheap.",
        ge=0.0,
        le=1.0,
    )
    full_jump: float = parameter(
        0.5, "Height of a jump from which on a border costs its full price.", unit="m", gt=0.0
    )
    plane_points: float = parameter(
        4.0,
        "Price of a plane in use, in points: three numbers and the corners around it are worth stating when "
        "they explain so many.",
        symbol="γ",
        ge=0.0,
    )
    farthest: float = parameter(
        5.0,
        "How near a cell must be to the rectangle around a plane's points to get that plane.",
        unit="m",
        ge=0.0,
    )


@dataclass(frozen=True, eq=False)
class PlaneReach:
    """The roof points (N, 3), the planes (P, 3: a, b, c) they support, and where these may be: in the
    rectangles `box` (P, 4), not under `lowest` (m).

    The last plane is the level that stands for no plane at all and may be anywhere.
    """

    roof: Points
    planes: NDArray[np.float64]
    spacing: float
    box: NDArray[np.float64]
    lowest: float


def plane_reach(
    roof: Points,
    labels: Labels,
    planes: NDArray[np.float64],
    spacing: float,
    ground: float,
    costs: LabelCosts,
) -> PlaneReach:
    """Where planes (P, 3) may be: near the rectangles around their own points, and over the base.

    `labels` (N,) say which of them each roof point (N, 3) supports.
    """
    box = np.full((len(planes), 4), np.inf)
    np.minimum.at(box[:, :2], labels[labels >= 0], roof[labels >= 0, :2])
    np.minimum.at(box[:, 2:], labels[labels >= 0], -roof[labels >= 0, :2])
    box = (box - costs.farthest) * np.array([1.0, 1.0, -1.0, -1.0])
    box[-1] = -np.inf, -np.inf, np.inf, np.inf
    return PlaneReach(roof, planes, spacing, box, ground + LOWEST_ROOF)


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
    borders = Borders(
        edges,
        costs.border_cost * coverage.length[halves],
        places,
        planes,
        costs.meeting_share,
        costs.full_jump,
    )
    return label_nodes(data, borders, costs.plane_points * reach.spacing**2)


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
        reach.lowest,
        costs.residual_limit,
        costs.gross_limit,
        reach.spacing**2,
    )
    data[:, -1] += 1e-6  # of equals a plane goes before the level that stands for none
    return np.asarray(np.minimum(data, LARGEST))


@kernel
def cell_costs_kernel(
    places: Points,
    first: Integers,
    corners: NDArray[np.float64],
    start: Integers,
    planes: NDArray[np.float64],
    steepness: Values,
    box: NDArray[np.float64],
    lowest: float,
    residual_limit: float,
    gross_limit: float,
    point_area: float,
) -> NDArray[np.float64]:
    """The residual (C, P; m²) of every plane's points in every cell, and of heights under the lowest.

    Points `first[c]` to `first[c + 1]` of `places` (K, 3) are in cell c, the `corners` (M, 2) likewise from
    `start`. `steepness` (P,) is √(1 + a² + b²), `box` (P, 4) where a plane may be, not under the
    `lowest` (m).
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
                beyond = max(beyond, lowest - over)
            cost = 0.0
            for point in range(first[cell], first[cell + 1]):
                residual = abs(places[point, 2] - places[point, 0] * a - places[point, 1] * b - c)
                residual = residual / steepness[plane]
                share = residual / residual_limit
                cost += (min(share * share, 1.0) + min(residual / gross_limit, 1.0)) * point_area
            data[cell, plane] = cost + RUNAWAY * beyond
    return data
