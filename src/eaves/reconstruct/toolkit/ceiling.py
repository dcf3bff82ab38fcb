"""How high a roof may rise over what was seen of it: the rule of the default method, and the judge of all."""

from __future__ import annotations

import numpy as np

from eaves.figures.attributes import NEAR_M, surface_heights
from eaves.geometry.face_table import FaceTable
from eaves.geometry.neighbours import measure_spacing
from eaves.kernels import kernel
from eaves.model import ROOF_SURFACE, Labels, Points, Solid, Values
from eaves.solids.extrude import height_at

LEAST_RISE, SIGMAS = 0.15, 3.0
"""No corner lies higher over the highest point than by so much (m), or by so many sigmas of its plane."""

NEAR, SPACINGS = 1.0, 2.0
"""A place shows nothing where no point is as near (m), or within so many spacings: a few cells without a
point are chance."""

MEETING = 0.05
"""Planes that differ by no more (m) in a corner meet there: it was rounded, and moved with its line."""


def reach_of(spacing: float) -> float:
    """The distance (m) within which a point shows a place."""
    return max(NEAR, SPACINGS * spacing)


def highest_of(roof: Points, labels: Labels, planes: Values, most: float) -> Values:
    """The height (P,) over which no corner of a plane may lie: that of the highest point (N, 3) of any plane,
    and what its own scatter hides, at most `most` (m)."""
    return np.asarray(spread_kernel(roof, labels, planes, float(most))[0])


@kernel
def spread_kernel(roof: Points, labels: Labels, planes: Values, most: float) -> tuple[Values, float]:
    """`highest_of` the planes (P, 3), and the median distance (m) of roof points (N, 3) from the planes that
    their `labels` (N,) name; infinite where none do."""
    squares, sizes = np.zeros(len(planes)), np.zeros(len(planes))
    away, count = np.empty(len(roof)), 0
    top, any_top = -np.inf, -np.inf
    for point in range(len(roof)):
        x, y, z = roof[point]
        any_top = max(any_top, z)
        if labels[point] < 0:
            continue
        a, b, c = planes[labels[point]]
        residual = z - a * x - b * y - c
        squares[labels[point]] += residual * residual
        sizes[labels[point]] += 1.0
        away[count] = abs(residual) / np.sqrt(1.0 + a * a + b * b)
        count, top = count + 1, max(top, z)
    sigma = np.sqrt(squares / np.maximum(sizes, 1.0))
    highest = (top if count else any_top) + np.minimum(np.maximum(SIGMAS * sigma, LEAST_RISE), most)
    return highest, np.median(away[:count]) if count else np.inf


def rise_over(
    nodes: Values, roof: Points, labels: Labels, planes: Values, highest: Values, spacing: float
) -> Values:
    """How far (V, P; m) each plane lies too high at the nodes (V, 2): over its `highest` (P,), and where it
    has points near also over the second of the planes that have some, which it may meet there."""
    known = np.flatnonzero(labels >= 0)
    known = known[np.argsort(roof[known, 0], kind="stable")]
    return np.asarray(rise_kernel(nodes, planes, highest, roof[known], labels[known], reach_of(spacing)))


@kernel
def rise_kernel(
    nodes: Values, planes: Values, highest: Values, roof: Points, labels: Labels, reach: float
) -> Values:
    """`rise_over` of nodes (V, 2), by the points (K, 3) that support planes, ascending by x, and their
    `labels` (K,)."""
    rise, near = np.zeros((len(nodes), len(planes))), np.full(len(planes), -1)
    for node in range(len(nodes)):
        place, is_over = nodes[node], False
        for plane in range(len(planes)):
            rise[node, plane] = max(height_at(planes[plane], place) - highest[plane], 0.0)
            is_over |= rise[node, plane] > 0.0
        best, second = -np.inf, -np.inf
        for one in range(np.searchsorted(roof[:, 0], place[0] - reach) if is_over else len(roof), len(roof)):
            east, north = roof[one, 0] - place[0], roof[one, 1] - place[1]
            if east > reach:
                break
            if near[labels[one]] != node and east * east + north * north <= reach * reach:
                near[labels[one]] = node
                height = height_at(planes[labels[one]], place)
                best, second = max(best, height), max(second, min(best, height))
        for plane in range(len(planes) if is_over else 0):
            if near[plane] == node:
                over = height_at(planes[plane], place) - second - MEETING
                rise[node, plane] = min(rise[node, plane], max(over, 0.0))
    return rise


def height_over_points(solids: tuple[Solid, ...], points: Points) -> float:
    """How far (m) the highest corner that is too high lies over all points (N, 3) of a building, else 0.

    The rule is that of `rise_over`, whatever method made the solids: a face has the points within `NEAR_M` of
    it, and a corner may always be as high as the highest point.
    """
    roof, top = FaceTable.of_solids(solids, ROOF_SURFACE), points[:, 2].max(initial=-np.inf)
    if not len(points) or roof.corners[:, 2].max() <= top + LEAST_RISE:
        return 0.0
    height, cosine, face = surface_heights(solids, points[:, :2])
    labels = np.where(np.abs(points[:, 2] - height) * cosine <= NEAR_M, face, -1)
    planes = np.where(np.isnan(roof.planes), (0.0, 0.0, -np.inf), roof.planes)
    highest = np.maximum(highest_of(points, labels, planes, np.inf), top + LEAST_RISE)
    rise = rise_over(roof.corners[:, :2], points, labels, planes, highest, measure_spacing(points))
    is_over = rise[np.arange(len(rise)), roof.face_of_corner] > 0.0
    return float((roof.corners[is_over, 2] - top).max(initial=0.0))
