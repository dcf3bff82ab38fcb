"""Adaptive TIN (Axelsson 2000): the default ground filter."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from eaves.geometry.neighbours import measure_spacing
from eaves.geometry.tin import Tin
from eaves.ground.base import GroundMethod
from eaves.ground.densification import Limits, densify, heights_above, measure_roughness
from eaves.ground.seeds import lowest_of_cells, lowest_surface, seeds_by_opening
from eaves.methods import Emit, ignore, parameter
from eaves.model import Mask, PointCloud


class AdaptiveTin(GroundMethod):
    """Ground by progressive densification of a TIN."""

    name: ClassVar[str] = "adaptive_tin"
    idea: ClassVar[str] = "A TIN of sure ground points takes in the points that fit it, until none joins."
    paper: ClassVar[str] = "axelsson2000"

    seed_cell: float | None = parameter(None, "Largest object.", unit="m", published=80.0, gt=0)
    widest_object: float = parameter(36.0, "Widest.", unit="m", gt=0)
    object_slope: float = parameter(0.12, "s0", gt=0)
    slope_share: float = parameter(0.3, "k1", ge=0)
    level_share: float = parameter(0.2, "")
    angle: float = parameter(14.0, "angle", unit="degree", gt=0)
    angle_gain: float = parameter(3.0, "ks", unit="degree", ge=0)
    distance: float | None = parameter(None, "dm", unit="m")
    distance_share: float = parameter(0.65, "dm = share*spacing")
    distance_most: float = parameter(0.9, "cap")
    tolerance: float | None = parameter(None, "t0", unit="m")
    tolerance_gain: float = parameter(10.0, "")
    tolerance_least: float = parameter(0.1, "")
    tolerance_most: float = parameter(0.4, "")
    slant_share: float = parameter(0.6, "k=share*spacing")
    slant_most: float = parameter(0.9, "")
    slope_cap: float = parameter(3.0, "")
    mirror_rise: float = parameter(0.3, "")
    mirror_slope: float = parameter(0.5, "")
    mirror_reach: float = parameter(1.5, "cells")
    steep: float = parameter(0.7, "")
    fine: float = parameter(0.5, "")
    cell_least: float = parameter(0.7, "")
    noise: float = parameter(0.02, "")
    rounds: int = parameter(8, "")

    @property
    def reach(self) -> float:
        return 60.0

    def ground_mask(self, cloud: PointCloud, emit: Emit = ignore) -> Mask:
        xyz = cloud.xyz
        if len(xyz) < 3:
            return np.ones(len(xyz), bool)
        spacing = measure_spacing(xyz)
        cell = max(self.cell_least, spacing)
        if self.seed_cell is None:
            seeds = seeds_by_opening(
                lowest_surface(xyz, cell, self.widest_object),
                self.widest_object,
                self.object_slope,
                self.slope_share,
                self.level_share,
            )
        else:
            seeds = lowest_of_cells(xyz, self.seed_cell)
        emit("seeds", xyz[seeds])
        tin = Tin(xyz, seeds)
        rough = measure_roughness(tin, xyz, 3.0 * cell)
        limits = Limits(
            distance=min(self.distance_most, self.distance_share * spacing),
            angle=np.radians(self.angle),
            angle_gain=np.radians(self.angle_gain),
            mirror_rise=self.mirror_rise,
            mirror_slope=self.mirror_slope,
            mirror_reach=self.mirror_reach * cell,
            steep=self.steep,
            noise=self.noise,
        )
        candidates = lowest_of_cells(xyz, max(self.fine, 0.5 * spacing))
        waiting = np.ones(len(xyz), bool)
        waiting[seeds] = False
        densify(tin, xyz, candidates[waiting[candidates]], limits, self.rounds)
        t0 = min(self.tolerance_most, max(self.tolerance_least, self.tolerance_gain * rough))
        above, slope = heights_above(tin, xyz)
        slant = min(self.slant_most, self.slant_share * spacing)
        return np.asarray(np.abs(above) < t0 + slant * np.minimum(slope, self.slope_cap))
