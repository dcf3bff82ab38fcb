"""Smooth regions (Xiao, Wang, Xi, Zhang 2014): the largest smooth surface is ground."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from eaves.geometry.planes import LocalPlanes, local_planes
from eaves.geometry.tin import Tin
from eaves.ground.stage import GroundMethod
from eaves.methods import Emit, ignore, parameter
from eaves.model import Mask, PointCloud, Points, Values

AREA_CELL_SPACINGS = 2.0
"""The area of a region is counted in cells this many spacings wide."""


class SmoothRegion(GroundMethod):
    """Ground by growing regions of like normals; the largest region is ground.

    The mask (N,) of the ground points.

    Every point gets the normal of the plane through its neighbours, from the smallest eigenvector of
    their covariance [xiao2014, eq. 1]. Walls, whose normals are horizontal, leave first; then trees, where
    many echoes are second or later ones (eq. 2). Normals are computed again on what remains, so that roofs
    and ground are no longer spoilt by what touches them. Neighbours of like normals form one region, and
    the region of the largest area is ground. Small regions are noise: outliers and crowns.

    ::

        C = 1/k Σ (p_i − p̄)(p_i − p̄)ᵀ                    (eq. 1)
        f_mr = Σ_{i>1} p_i / Σ p_i over the neighbours      (eq. 2)

    Fidelity
    --------
    Followed: the order of the steps, both features, one region growing for ground and noise. The paper
    prints no number; the angles, the share and k are ours. Growth joins two neighbours when their
    normals differ by less than `smooth_angle` and the line between them lies flat in both planes, so that
    a step of parallel planes (a flat roof beside the street) does not join. The paper keeps one region
    only; rivers, walls and courtyards cut real ground into several, so a region also is ground when it
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

    neighbours: int = parameter(24, "Points in a neighbourhood.", symbol="k", ge=4)
    wall_angle: float = parameter(
        25.0, "A normal this close to the horizontal is a wall's.", unit="degree", ge=0.0, le=90.0
    )
    tree_share: float = parameter(
        0.6, "Share of later echoes from which a neighbourhood is a tree.", symbol="f_mr", ge=0.0, le=1.0
    )
    smooth_angle: float = parameter(
        12.0,
        "Largest angle between the normals of neighbours on one surface.",
        unit="degree",
        gt=0.0,
        le=90.0,
    )
    noise_area: float = parameter(
        5.0, "Regions smaller than this are noise and never ground.", unit="m²", ge=0.0
    )
    level: float = parameter(
        1.0,
        "A further region is ground when it lies this close to the ground extended over it.",
        unit="m",
        published=0.0,
        ge=0.0,
    )

    @property
    def buffer(self) -> float:
        return 60.0

    def ground_mask(self, cloud: PointCloud, emit: Emit = ignore) -> Mask:
        ground = np.zeros(len(cloud), bool)
        if len(cloud) <= self.neighbours:
            return ground
        walls = self.find_walls(cloud.xyz)
        emit("walls", walls)
        trees = self.find_trees(cloud, walls)
        emit("trees", trees)
        left = np.flatnonzero(~(walls | trees))
        if len(left) <= self.neighbours:
            return ground
        xyz = cloud.xyz[left]
        planes = local_planes(xyz, self.neighbours, self.neighbours)  # again, without walls and trees
        region = self.grow_regions(xyz, planes)
        emit("regions", region)
        area = region_areas(xyz, region, AREA_CELL_SPACINGS * planes.spacing)
        chosen = np.zeros(len(area), bool)
        chosen[np.argmax(area)] = True
        if self.level > 0.0:
            self.add_level_regions(xyz, region, area, chosen)
        ground[left] = chosen[region]
        return ground

    def find_walls(self, xyz: Points) -> Mask:
        """Points (N,) whose normal is nearly horizontal."""
        normal_z = np.abs(local_planes(xyz, self.neighbours, self.neighbours).normals[:, 2])
        return np.asarray(normal_z < np.sin(np.radians(self.wall_angle)))

    def find_trees(self, cloud: PointCloud, walls: Mask) -> Mask:
        """Points (N,) among many later echoes; none where the scanner told no echoes apart."""
        trees = np.zeros(len(cloud), bool)
        if not cloud.has_returns or cloud.return_number is None:
            return trees
        left = np.flatnonzero(~walls)
        if len(left) <= self.neighbours:
            return trees
        around = local_planes(cloud.xyz[left], self.neighbours, self.neighbours).neighbours
        later = (cloud.return_number[left] > 1).astype(np.float64)
        trees[left] = later[around].mean(axis=1) > self.tree_share  # [xiao2014], eq. 2
        return trees

    def grow_regions(self, xyz: Points, planes: LocalPlanes) -> NDArray[np.int64]:
        """Region (N,), counted from 0: connected points of like normals with no step between them."""
        likeness = np.cos(np.radians(self.smooth_angle))
        rise = np.sin(np.radians(self.smooth_angle))
        count, around = len(xyz), planes.neighbours[:, 1:]
        rows, columns = [], []
        for k in range(around.shape[1]):
            other = around[:, k]
            link = xyz[other] - xyz
            length = np.sqrt((link**2).sum(axis=1))
            alike = (planes.normals * planes.normals[other]).sum(axis=1) > likeness
            off = np.maximum(
                np.abs((link * planes.normals).sum(axis=1)),
                np.abs((link * planes.normals[other]).sum(axis=1)),
            )
            joined = np.flatnonzero(alike & (off <= np.maximum(rise * length, 3.0 * planes.noise)))
            rows.append(joined)
            columns.append(other[joined])
        row, column = np.concatenate(rows), np.concatenate(columns)
        graph = coo_matrix((np.ones(len(row), bool), (row, column)), shape=(count, count))
        return np.asarray(connected_components(graph, directed=False)[1], np.int64)

    def add_level_regions(self, xyz: Points, region: NDArray[np.int64], area: Values, chosen: Mask) -> None:
        """Mark in `chosen` (K,) the regions that continue the ground, the largest first, until none does."""
        order = [k for k in np.argsort(-area, kind="stable") if area[k] >= self.noise_area]
        members = {k: np.flatnonzero(region == k) for k in order}
        grown = True
        while grown:
            grown = False
            ground = np.flatnonzero(chosen[region])
            tin, nearest = Tin(xyz[ground]), cKDTree(xyz[ground, :2])
            for k in order:
                if chosen[k]:
                    continue
                base = tin.interpolated(xyz[ground, 2], xyz[members[k]])
                outside = np.isnan(base)
                base[outside] = xyz[ground[nearest.query(xyz[members[k]][outside, :2])[1]], 2]
                above = float(np.median(xyz[members[k], 2] - base))
                if abs(above) <= self.level:
                    chosen[k] = grown = True


def region_areas(xyz: Points, region: NDArray[np.int64], side: float) -> Values:
    """Area (K,) in m² of each region of points (N, 3): its occupied cells of the given side (m)."""
    cell = np.floor(xyz[:, :2] / side).astype(np.int64)
    cell -= cell.min(axis=0)
    key = (region * (int(cell[:, 0].max()) + 1) + cell[:, 0]) * (int(cell[:, 1].max()) + 1) + cell[:, 1]
    _, first = np.unique(key, return_index=True)
    cells = np.bincount(region[first], minlength=int(region.max()) + 1)
    return np.asarray(cells * (side * side), np.float64)
