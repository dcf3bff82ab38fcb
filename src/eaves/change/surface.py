"""Each roof point of one epoch against the points of the other: is its surface still there?

A roof point with the plane of its neighbours says where the other epoch's points must lie. In a cylinder
around it they lie on that plane (the same roof), all below (it was not there yet, or is gone), all above
(raised, or hidden by a crown), or there are none (not seen).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from eaves.geometry.planes import local_planes
from eaves.model import Mask, Points, Values
from eaves.model.cloud import BUILDING, GROUND

UNSEEN, SAME, GROUND_BELOW, ROOF_BELOW, ROOF_ABOVE, OTHER_BELOW, HIDDEN = range(7)
"""State of a roof point in the other epoch: nothing; the same surface; the ground, another roof or
something else under it; a roof above it; only what is no roof above it."""

LEAST_NEIGHBOURS = 5
"""Fewer points decide nothing."""
NEIGHBOURS = 16
"""Number of nearest points that define a point's plane."""
STEEPEST = 2.5
"""Tangent of the steepest roof (68°)."""
BESIDE = 0.4
"""Points whose middle is farther from a place than this share of their radius lie beside it: those of half a
disc are, on the mean, by 0.42."""
STANDING = 0.2
"""Points of no roof make a surface where they are at least this share of those on and under it: at a corner
of a roof a quarter lies on it, and of a crown single leaves lie at the height of any roof."""
AT_ONCE = 20_000
"""Roof points that are faced together: with each go all points around it."""


def point_planes(xyz: Points) -> tuple[NDArray[np.float64], Values]:
    """Slopes (N, 2) of the planes around points (N, 3), and how rough they are there (m, one standard
    deviation); level and NaN where there is none that could be a roof."""
    if len(xyz) < NEIGHBOURS:
        return np.zeros((len(xyz), 2)), np.full(len(xyz), np.nan)
    around = local_planes(xyz, NEIGHBOURS, NEIGHBOURS)
    slope = -around.normals[:, :2] / np.maximum(around.normals[:, 2:], 1e-3)
    rough = np.sqrt(around.eigenvalues[:, 0] * NEIGHBOURS / (NEIGHBOURS - 3))
    steep = np.hypot(*slope.T) > STEEPEST
    return np.where(steep[:, None], 0.0, slope), np.where(steep, np.nan, rough)


def plan_tree(xyz: Points) -> cKDTree:
    """The tree of points (N, 3) in plan, not balanced: to build it costs more than to ask it once."""
    return cKDTree(xyz[:, :2], balanced_tree=False, compact_nodes=False)


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs (P,) of some of `count` roof points with points of the other epoch near in plan: the number of
    the roof point, the way from it (P, 2) and how far the other lies over its plane (m)."""

    count: int
    point: NDArray[np.int64]
    other: NDArray[np.int64]
    way: NDArray[np.float64]
    over: Values

    @classmethod
    def within(
        cls, xyz: Points, slope: NDArray[np.float64], others: Points, tree: cKDTree, radius: float
    ) -> Pairs:
        """Those within `radius` (m) of roof points (N, 3) that lie on planes with slopes (N, 2); the `tree`
        is that of the others."""
        found = plan_tree(xyz).sparse_distance_matrix(tree, radius, output_type="ndarray")
        point, other = found["i"], found["j"]
        way = others[other] - xyz[point]
        over = way[:, 2] - (slope[point] * way[:, :2]).sum(axis=1)
        return cls(len(xyz), point, other, way[:, :2], over)

    def number(self, mask: Mask) -> NDArray[np.int64]:
        """Number (N,) of pairs of a mask (P,) that each roof point has."""
        return np.bincount(self.point[mask], minlength=self.count)

    def highest(self, mask: Mask, sign: float = 1.0) -> Values:
        """Height (N,) of the highest of some over each roof point (sign −1: depth of the lowest); none:
        −inf."""
        found = np.full(self.count, -np.inf)
        np.maximum.at(found, self.point[mask], sign * self.over[mask])
        return found

    def mean(self, mask: Mask, values: Values) -> Values:
        """The mean (N,) of values (P,) over some pairs of each roof point; 0 for none."""
        total = np.bincount(self.point[mask], values[mask], self.count)
        return np.asarray(total / np.maximum(self.number(mask), 1))

    def beside(self, mask: Mask, radius: float) -> Mask:
        """Mask (N,) of the roof points to one side of which some of the points around them lie."""
        return np.hypot(*(self.mean(mask, way) for way in self.way.T)) > BESIDE * radius


def face_points(
    xyz: Points,
    slope: NDArray[np.float64],
    others: Points,
    classes: NDArray[np.uint8],
    radius: float,
    tolerance: float,
) -> tuple[NDArray[np.uint8], Values]:
    """The state (N,) that points of another epoch (M, 3) with classes show within `radius` (m) of roof points
    (N, 3), and how far what they show lies over these (m)."""
    state, distance = np.full(len(xyz), UNSEEN, np.uint8), np.full(len(xyz), np.nan)
    tree = plan_tree(others)
    for first in range(0, len(xyz) if len(others) else 0, AT_ONCE):
        some = slice(first, first + AT_ONCE)
        pairs = Pairs.within(xyz[some], slope[some], others, tree, radius)
        limit = tolerance * np.sqrt(1.0 + (slope[some] ** 2).sum(axis=1))
        state[some], distance[some] = states_of(pairs, classes[pairs.other], radius, limit)
    return state, distance


def states_of(
    pairs: Pairs, kind: NDArray[np.uint8], radius: float, limit: Values
) -> tuple[NDArray[np.uint8], Values]:
    """States and distances (N,) of roof points, from their pairs and the classes (P,) of the others; what
    lies within a `limit` (N,) of the plane is on it."""
    on = np.abs(pairs.over) <= limit[pairs.point]
    below, above = ~on & (pairs.over < 0), ~on & (pairs.over > 0)
    standing = pairs.number(on)
    same = pairs.number(on & (kind == BUILDING)) > 0
    same |= (standing > 0) & (standing >= STANDING * (standing + pairs.number(below)))
    ground = below & (kind == GROUND)
    grounded = pairs.number(ground) > 0
    top, roof_above = pairs.highest(below), -pairs.highest(above & (kind == BUILDING), -1.0)
    under = np.isfinite(top) & (pairs.highest(below & (kind == BUILDING)) == top) & (-top <= roof_above)
    roof = np.where(under, top, roof_above)
    # the other roof must lie around the point: what lies to one side of it is seen past it
    level = np.abs(pairs.over - roof[pairs.point]) <= 4 * limit[pairs.point]
    roofed, ground_top = np.isfinite(roof), pairs.highest(ground)
    nothing = np.full(pairs.count, np.nan)
    cases = (
        (pairs.number(np.ones(len(kind), bool)) == 0, UNSEEN, nothing),
        (same, SAME, np.zeros(pairs.count)),
        (
            roofed & ~pairs.beside(level, radius),
            np.where(under, ROOF_BELOW, ROOF_ABOVE),
            pairs.mean(level, pairs.over),
        ),
        (grounded & ~pairs.beside(ground, radius), GROUND_BELOW, ground_top),
        (roofed, HIDDEN, nothing),
        (grounded, UNSEEN, ground_top),
        (np.isfinite(top), OTHER_BELOW, top),
    )
    which, states, distances = zip(*cases, strict=True)
    return np.select(which, states, HIDDEN).astype(np.uint8), np.select(which, distances, np.nan)


def nearest_distances(
    xyz: Points, slope: NDArray[np.float64], others: Points, radius: float, most: float
) -> Values:
    """Distance (N,) of the other epoch's surface over roof points: of the nearest in plan of those no
    farther than `most` (m) from the plane; NaN where there is none."""
    distance = np.full(len(xyz), np.nan)
    pairs = Pairs.within(xyz, slope, others, plan_tree(others), radius)
    order = np.lexsort((np.hypot(*pairs.way.T), pairs.point))
    order = order[np.abs(pairs.over[order]) <= most]
    point, first = np.unique(pairs.point[order], return_index=True)
    distance[point] = pairs.over[order[first]]
    return distance
