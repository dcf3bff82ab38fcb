"""Adaptive TIN (Axelsson 2000): the default ground filter."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from eaves.geometry.neighbours import measure_spacing
from eaves.geometry.tin import Tin
from eaves.ground.base import GroundMethod
from eaves.methods import Emit, ignore, parameter
from eaves.model import Mask, PointCloud, Raster
from eaves.raster.grid import heights_of, lowest_points, whole_cells
from eaves.raster.interpolate import fill_linear
from eaves.raster.morphology import opened


class AdaptiveTin(GroundMethod):
    """Ground by progressive densification of a TIN."""

    name: ClassVar[str] = "adaptive_tin"
    idea: ClassVar[str] = (
        "A TIN of sure ground points takes in the points close enough to it, until none joins."
    )
    paper: ClassVar[str] = "axelsson2000"

    seed_cell: float | None = parameter(None, "Largest object.", unit="m", published=None, gt=0)

    @property
    def reach(self) -> float:
        return 60.0

    def ground_mask(self, cloud: PointCloud, emit: Emit = ignore) -> Mask:
        xyz = cloud.xyz
        if len(xyz) < 3:
            return np.ones(len(xyz), bool)
        spacing = measure_spacing(xyz)
        cell = max(1.0, spacing)
        bounds = whole_cells(cloud.bounds, cell)
        number = lowest_points(xyz, bounds, cell)
        low = fill_linear(Raster(heights_of(number, xyz[:, 2]), bounds.west, bounds.north, cell))
        surface = low.values
        objects = np.zeros(low.shape, bool)
        for radius in range(1, round(18 / cell) + 1):
            after = opened(surface, radius)
            objects |= surface - after > 0.18 * radius * cell
            surface = after
        seeds = number[(number >= 0) & ~objects]
        tin = Tin(xyz, seeds)
        base = tin.interpolated(xyz[:, 2], xyz)
        ground: Mask = np.abs(xyz[:, 2] - np.where(np.isnan(base), np.inf, base)) < 0.3
        ground[seeds] = True
        return ground
