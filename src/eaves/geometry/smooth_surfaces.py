"""Walls, trees and smooth regions of a cloud, by the normals and the echoes around its points [xiao2014]."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from eaves.geometry.components import connected_groups_kernel
from eaves.geometry.planes import LocalPlanes, local_planes
from eaves.model import Integers, Labels, Mask, PointCloud, Points, Values
from eaves.model.scene import TREE, WALL

NEIGHBOURS = 24
"""Points of a neighbourhood: at 4 points/m², the paper's, a disc of 1.4 m."""
WALL_ANGLE_DEG = 70.0
"""Normals that far from the vertical are walls: no roof is built steeper, but for mansards."""
SMOOTH_ANGLE_DEG = 9.0
"""Largest angle between the normals of neighbours on one surface: roofs and streets pass, crowns break up."""
NOISE_AREA_M2 = 5.0
"""Smaller smooth regions are noise: a bird, a crown, a chimney."""
TREE_SHARE = 0.5
"""Share of later echoes around a point that makes it a tree's: most of them. Rims and gardens on roofs have
fewer."""


def find_walls_and_trees(
    cloud: PointCloud,
    neighbours: int = NEIGHBOURS,
    wall_angle: float = WALL_ANGLE_DEG,
    tree_share: float = TREE_SHARE,
) -> NDArray[np.uint8]:
    """WALL, TREE or 0 for each of the points (N,): walls leave first, then trees among what is left."""
    part = np.zeros(len(cloud), np.uint8)
    if len(cloud) <= neighbours:
        return part
    upright = np.abs(local_planes(cloud.xyz, neighbours, neighbours).normals[:, 2])
    part[upright < np.cos(np.radians(wall_angle))] = WALL
    unassigned = np.flatnonzero(part == 0)
    if not cloud.has_returns or cloud.return_number is None or len(unassigned) <= neighbours:
        return part
    around = local_planes(cloud.xyz[unassigned], neighbours, neighbours).neighbours
    later = (cloud.return_number[unassigned] > 1).astype(np.float64)
    part[unassigned[later[around].mean(axis=1) > tree_share]] = TREE  # eq. 2
    return part


def grow_regions(xyz: Points, planes: LocalPlanes, smooth_angle: float, flat_links: bool = True) -> Integers:
    """Region (N,), counted from 0: connected points of like normals (degrees), with `flat_links` with no step
    between them."""
    likeness, rise = np.cos(np.radians(smooth_angle)), np.sin(np.radians(smooth_angle))

    def joined(neighbour: Integers) -> Mask:
        link = xyz[neighbour] - xyz
        length = np.sqrt((link**2).sum(axis=1))
        alike = (planes.normals * planes.normals[neighbour]).sum(axis=1) > likeness
        off = np.maximum(
            np.abs((link * planes.normals).sum(axis=1)),
            np.abs((link * planes.normals[neighbour]).sum(axis=1)),
        )
        flat = off <= np.maximum(rise * length, 3.0 * planes.noise)
        return np.asarray(alike & flat if flat_links else alike)

    return connected_points(planes, joined).astype(np.int64)


def euclidean_components(xyz: Points, planes: LocalPlanes, join: float) -> Labels:
    """Numbers (N,) from 0 of the connected components: neighbours nearer than `join` (m) are one."""

    def joined(neighbour: Integers) -> Mask:
        return np.asarray(((xyz[neighbour] - xyz) ** 2).sum(axis=1) <= join * join)

    return connected_points(planes, joined)


def connected_points(planes: LocalPlanes, joined: Callable[[Integers], Mask]) -> Labels:
    """Components (N,) of the graph of neighbours whose link `joined` (others (N,) → mask (N,)) keeps."""
    count, around = len(planes.neighbours), planes.neighbours[:, 1:]
    rows, columns = [], []
    for k in range(around.shape[1]):
        row = np.flatnonzero(joined(around[:, k]))
        rows.append(row)
        columns.append(around[row, k])
    group = connected_groups_kernel(np.concatenate(rows), np.concatenate(columns), count)
    return np.asarray(group, np.int32)


def region_areas(xyz: Points, region: Integers, side: float) -> Values:
    """Area (K,) in m² of each region of points (N, 3): its occupied cells of the given side (m)."""
    cell = np.floor(xyz[:, :2] / side).astype(np.int64)
    cell -= cell.min(axis=0)
    key = (region * (int(cell[:, 0].max()) + 1) + cell[:, 0]) * (int(cell[:, 1].max()) + 1) + cell[:, 1]
    _, first = np.unique(key, return_index=True)
    cells = np.bincount(region[first], minlength=int(region.max()) + 1)
    return np.asarray(cells * (side * side), np.float64)
