"""Which of the points that are neither ground, building nor noise are vegetation, by ASPRS classes 3 to 5."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.methods import Method, parameter
from eaves.model import Labels, PointCloud, Values
from eaves.model.cloud import (
    GRID_STEP,
    HIGH_VEGETATION,
    LOW_VEGETATION,
    MEDIUM_VEGETATION,
    UNCLASSIFIED,
)
from eaves.model.scene import TREE


class VegetationRules(Method):
    """The limits of vegetation: cells of which many pulses come back more than once, or that no plane fits.

    The limits of height are those usual with the ASPRS classes; the others were chosen by looking at one tile
    of `ign_urban`. Points a detector calls tree are vegetation in any case.
    """

    low: float = parameter(0.5, "Up to this height vegetation is low, class 3.", unit="m", ge=0.0)
    medium: float = parameter(
        2.0, "Up to this height it is medium, class 4; above, high, class 5.", unit="m", ge=0.0
    )
    cell: float = parameter(
        2.0,
        "Side of the cells, fixed to the world: a tenth of a crown, and several points in most scans.",
        unit="m",
        gt=0.0,
    )
    echoes: float = parameter(
        0.3,
        "Share of a cell's points whose pulses have several returns: facades and cars stay below it.",
        ge=0.0,
    )
    roughness: float = parameter(
        0.3,
        "RMS distance of a cell's points from their plane: ten times the noise of a scan.",
        unit="m",
        ge=0.0,
    )


def vegetation_classes(
    cloud: PointCloud,
    label: Labels,
    part: NDArray[np.uint8] | None,
    height: Values,
    rules: VegetationRules,
) -> NDArray[np.uint8]:
    """Class 3, 4 or 5 of the points (N,) that are vegetation, 0 of all others."""
    classes = np.zeros(len(cloud), np.uint8)
    assert cloud.classification is not None
    free = np.flatnonzero((cloud.classification == UNCLASSIFIED) & (label == 0) & (height >= 0.0))
    if len(free) == 0:
        return classes
    grown = grown_cells(cloud.take(free), rules)
    if part is not None:
        grown |= part[free] == TREE
    chosen = free[grown]
    steps = np.searchsorted([rules.low, rules.medium], height[chosen], side="left")
    classes[chosen] = np.array([LOW_VEGETATION, MEDIUM_VEGETATION, HIGH_VEGETATION], np.uint8)[steps]
    return classes


def grown_cells(cloud: PointCloud, rules: VegetationRules) -> NDArray[np.bool_]:
    """Which points (N,) lie in cells whose points show vegetation."""
    side = round(rules.cell / GRID_STEP)
    quanta = np.round(cloud.xyz[:, :2] / GRID_STEP).astype(np.int64)
    quanta += np.round(np.array(cloud.origin) / GRID_STEP).astype(np.int64)
    place = quanta // side
    away: Values = np.asarray((quanta - place * side) * GRID_STEP - 0.5 * rules.cell, np.float64)
    place -= place.min(axis=0)
    cell = np.ravel_multi_index(tuple(place.T), place.max(axis=0) + 1)
    points = np.bincount(cell)
    returns = cloud.number_of_returns
    several = np.zeros(len(points)) if returns is None else np.bincount(cell, returns > 1)
    shown = several >= rules.echoes * np.maximum(points, 1)
    shown |= plane_residual(cell, points, away, cloud.xyz[:, 2]) >= rules.roughness
    return np.asarray(shown[cell], np.bool_)


def plane_residual(
    cell: NDArray[np.int64], points: NDArray[np.int64], away: Values, z: Values
) -> NDArray[np.float64]:
    """RMS distance (m, upright) of each cell's points from their plane, 0 where they are too few for one.

    `points` are their numbers by cell, (K,), `away` their places (N, 2) about the middle of their cell.
    """
    count = len(points)
    most = np.maximum(points, 1)
    columns = [away[:, 0], away[:, 1], z]
    means = [np.bincount(cell, one, minlength=count) / most for one in columns]
    x, y, z = (one - mean[cell] for one, mean in zip(columns, means, strict=True))

    def total(values: Values) -> Values:
        return np.asarray(np.bincount(cell, values, minlength=count), np.float64)

    xx, xy, yy, xz, yz, zz = (total(one) for one in (x * x, x * y, y * y, x * z, y * z, z * z))
    size = xx * yy - xy * xy
    solvable = size > 1e-3 * np.maximum(xx, yy) ** 2
    size = np.where(solvable, size, 1.0)
    slope_x, slope_y = (xz * yy - yz * xy) / size, (yz * xx - xz * xy) / size
    left = np.maximum(zz - slope_x * xz - slope_y * yz, 0.0)
    enough = solvable & (points > 3)
    return np.where(enough, np.sqrt(left / np.maximum(points - 3, 1)), 0.0)
