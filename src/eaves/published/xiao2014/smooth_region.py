"""Smooth regions (Xiao, Wang, Xi, Zhang 2014): the largest smooth surface is ground."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from eaves.geometry.planes import (
    NEIGHBOURS,
    NOISE_AREA_M2,
    SMOOTH_ANGLE_DEG,
    TREE_SHARE,
    WALL_ANGLE_DEG,
    find_walls_and_trees,
    grow_regions,
    local_planes,
    region_areas,
)
from eaves.geometry.tin import Tin
from eaves.ground.stage import GroundMethod
from eaves.methods import Emit, ignore, parameter
from eaves.model import Bounds, Mask, PointCloud, Points, Values
from eaves.model.scene import NOISE, TREE, WALL


class SmoothRegion(GroundMethod):
    """Ground by growing regions of like normals; the largest region is ground.

    The mask (N,) of the ground points.

    Every point gets the normal of the plane through its neighbours, from the smallest eigenvector of their
    covariance [xiao2014, eq. 1]. Walls, whose normals are horizontal, are removed first; then trees, where
    many echoes are second or later ones (eq. 2). Normals are computed again on what remains, so that roofs
    and ground are no longer spoilt by what touches them. Neighbours of like normals form one region, and the
    region of the largest area is ground. Small regions are noise: outliers and crowns.

    Formula
    -------
    ::

        C = 1/k Σ (p_i − p̄)(p_i − p̄)ᵀ                    (eq. 1)
        f_mr = Σ_{i>1} p_i / Σ p_i over the neighbours      (eq. 2)

    Fidelity
    --------
    Followed: the order of the steps, both features, one region growing for ground and noise. The paper prints
    no number; the angles, the share, the cell of areas and k are ours. Growth joins two neighbours when their
    normals differ by less than `smooth_angle` and the line between them lies flat in both planes, so that a
    step of parallel planes (a flat roof beside the street) does not join. Walls, trees and small regions are
    found once, here, and handed on to the detector of the same paper (`NormalEcho`). The paper keeps one
    region only; rivers, walls and courtyards cut real ground into several, so a region also is ground when it
    lies within `level` of the surface of the ground found so far, extended over it; 0 keeps to the paper.
    Points set aside as walls and trees stay out, as in the paper.

    Fails where
    -----------
    Terrain is rough or stepped, the largest smooth surface is a hall or water, ground under trees is
    hit by late echoes only, or a ramp joins a roof with the street.

    Complexity
    ----------
    Two searches of k neighbours, O(N k log N): about 8 CPU seconds per million points.

    References
    ----------
    [xiao2014]
    """

    name: ClassVar[str] = "smooth_region"
    idea: ClassVar[str] = "Without walls and trees, the largest surface of like normals is ground."
    paper: ClassVar[str] = "xiao2014"

    neighbours: int = parameter(NEIGHBOURS, "Points in a neighbourhood.", symbol="k", ge=4)
    wall_angle: float = parameter(
        WALL_ANGLE_DEG,
        "Normals that far from the vertical are walls.",
        unit="degree",
        off=90.0,
        step="walls by normals",
        gt=0.0,
        le=90.0,
    )
    tree_share: float = parameter(
        TREE_SHARE,
        "Share of later echoes from which a neighbourhood is a tree.",
        symbol="f_mr",
        off=1.0,
        step="trees by echoes",
        ge=0.0,
        le=1.0,
    )
    smooth_angle: float = parameter(
        SMOOTH_ANGLE_DEG,
        "Largest angle between the normals of neighbours on one surface.",
        unit="degree",
        gt=0.0,
        le=90.0,
    )
    flat_links: bool = parameter(
        True,
        "Neighbours of one surface also lie in each other's plane: a step of like normals parts them.",
        off=False,
        step="a step parts a surface",
    )
    noise_area: float = parameter(
        NOISE_AREA_M2,
        "Regions smaller than this are noise: never ground, never a building.",
        unit="m²",
        off=0.0,
        step="small regions are noise",
        ge=0.0,
    )
    area_cell: float = parameter(
        2.0, "Side of the cells in which the area of a region is counted, in spacings.", gt=0.0
    )
    level: float = parameter(
        1.0,
        "A further region is ground when it lies this close to the ground extended over it.",
        unit="m",
        off=0.0,
        ge=0.0,
    )

    @property
    def buffer(self) -> float:
        return 60.0

    def ground_mask(self, cloud: PointCloud, emit: Emit = ignore) -> Mask:
        return self.separate(cloud, np.zeros(len(cloud), bool), emit)[0]

    def separate(
        self, cloud: PointCloud, over: Mask, emit: Emit = ignore, core: Bounds | None = None
    ) -> tuple[Mask, NDArray[np.uint8] | None]:
        ground = np.zeros(len(cloud), bool)
        if len(cloud) <= self.neighbours:
            return ground, None
        part = find_walls_and_trees(cloud, self.neighbours, self.wall_angle, self.tree_share)
        emit("walls", cloud.xyz[part == WALL])
        emit("trees", cloud.xyz[part == TREE])
        smooth = np.flatnonzero(part == 0)
        if len(smooth) <= self.neighbours:
            return ground, part
        xyz = cloud.xyz[smooth]
        planes = local_planes(xyz, self.neighbours, self.neighbours)  # again, without walls and trees
        region = grow_regions(xyz, planes, self.smooth_angle, self.flat_links)
        every = np.zeros(len(cloud), np.int64)
        every[smooth] = region + 1
        emit("regions", every)
        area = region_areas(xyz, region, self.area_cell * planes.spacing)
        chosen = np.zeros(len(area), bool)
        chosen[np.argmax(area)] = True
        if self.level > 0.0:
            self.add_level_regions(xyz, region, area, chosen)
        ground[smooth] = chosen[region]
        part[smooth[(area < self.noise_area)[region] & ~ground[smooth]]] = NOISE
        emit("small regions", cloud.xyz[part == NOISE])
        return ground & ~over, part

    def add_level_regions(self, xyz: Points, region: NDArray[np.int64], area: Values, chosen: Mask) -> None:
        """Mark in `chosen` (K,) the regions that continue the ground, round by round, until none does."""
        large = area >= self.noise_area
        while True:
            ground = np.flatnonzero(chosen[region])
            candidates = np.flatnonzero((large & ~chosen)[region])
            if len(candidates) == 0:
                return
            tin, nearest = Tin(xyz[ground]), cKDTree(xyz[ground, :2])
            base = tin.interpolate(xyz[ground, 2], xyz[candidates])
            outside = np.flatnonzero(np.isnan(base))
            base[outside] = xyz[ground[nearest.query(xyz[candidates[outside], :2])[1]], 2]
            above = xyz[candidates, 2] - base
            order = np.lexsort((above, region[candidates]))
            number, count = np.unique(region[candidates], return_counts=True)
            start = np.cumsum(count) - count
            low, high = above[order][start + (count - 1) // 2], above[order][start + count // 2]
            fits = np.abs(0.5 * (low + high)) <= self.level
            if not fits.any():
                return
            chosen[number[fits]] = True
