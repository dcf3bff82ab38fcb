"""Vegetation among the points that are neither ground, building nor noise, by ASPRS classes 3 to 5."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.detect.toolkit.cells import Cells
from eaves.geometry.planes import fit_planes, sums_of
from eaves.methods import Method, parameter
from eaves.model import (
    HIGH_VEGETATION,
    LOW_VEGETATION,
    MEDIUM_VEGETATION,
    UNCLASSIFIED,
    Labels,
    Mask,
    PointCloud,
    Points,
    Values,
)
from eaves.model.cloud import snap
from eaves.model.scene import TREE


class VegetationRules(Method):
    """The limits of vegetation: cells of which many pulses come back more than once, or that no plane fits.

    The limits of height are those usual with the ASPRS classes; the others were chosen by looking at one tile
    of `ign_urban`. Points a detector calls tree are vegetation in any case.
    """

    low: float = parameter(0.5, "Height up to which vegetation is low, class 3.", unit="m", ge=0.0)
    medium: float = parameter(
        2.0, "Height up to which it is medium, class 4; above, high, class 5.", unit="m", ge=0.0
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
        "RMS distance of a cell's points from their plane, upright: ten times the noise of a scan.",
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
    returns = cloud.number_of_returns
    several = np.zeros(len(free), bool) if returns is None else returns[free] > 1
    grown = grown_cells(cloud.xyz.take(free, axis=0), several, cloud.origin, rules)
    if part is not None:
        grown |= part[free] == TREE
    chosen = free[grown]
    steps = np.searchsorted([rules.low, rules.medium], height[chosen], side="left")
    classes[chosen] = np.array([LOW_VEGETATION, MEDIUM_VEGETATION, HIGH_VEGETATION], np.uint8)[steps]
    return classes


def grown_cells(xyz: Points, several: Mask, origin: tuple[float, float], rules: VegetationRules) -> Mask:
    """Mask (N,) of the points (N, 3) about an origin in cells whose points show vegetation; `several` (N,)
    marks those whose pulse had several returns."""
    corner = [*np.mod(origin, rules.cell), -np.floor(xyz[:, 2].min())]
    xyz = snap(xyz + corner)  # cells are fixed to the world
    cells = Cells.of(xyz, rules.cell, margin=0)
    shown = cells.total(several.astype(np.float64)) >= rules.echoes * np.maximum(cells.count, 1)
    sums = sums_of(xyz, cells.cell, cells.size)
    dense = np.flatnonzero((cells.count > 3) & ~shown)
    _, normal, rmse = fit_planes(sums[dense])
    freedom = cells.count[dense] / (cells.count[dense] - 3)  # a plane takes three points
    shown[dense] = rmse * np.sqrt(freedom) >= rules.roughness * np.maximum(normal[:, 2], 0.1)
    return np.asarray(shown[cells.cell], np.bool_)
