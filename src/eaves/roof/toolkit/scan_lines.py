"""Points close along scan lines and far apart between them: thinned, so that neighbours lie all around."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from eaves.geometry.neighbours import measure_spacing
from eaves.geometry.planes import LocalPlanes
from eaves.model import Points, RoofPlane

MOST_NEIGHBOURS = 20
"""Neighbours of a point that its normal comes from, at most: where lines are this many times as far apart as
the points along them, all neighbours lie on one line."""

COARSER = 1.5
"""Times as wide as before are the cells of the next thinning."""

NEAREST = 4
"""Kept points whose planes a point between them may belong to."""


def on_lines(points: Points, nearest: NDArray[np.int64], spacing: float) -> bool:
    """True if most points (N, 3) lie so near their `nearest` (N,), for their `spacing` (m) in plan, that
    neighbours are of one scan line: lines L times as far apart as points along them put these 1 / √L of the
    spacing apart. Points at random are half a spacing apart.
    """
    along = float(np.median(np.linalg.norm(points[nearest, :2] - points[:, :2], axis=1)))
    widest = along * MOST_NEIGHBOURS**0.5
    return bool(widest < spacing and widest < measure_spacing(points))


def thin_lines(points: Points, local: LocalPlanes, fewest: int) -> NDArray[np.int64]:
    """Numbers (K,), ascending, of the points (N, 3) that stay when each cell in plan keeps one, in cells just
    wide enough that most points see others beside their line; all where fewer than `fewest` would stay.
    """
    side = 2.0 * local.spacing
    while True:
        cells = np.floor(points[:, :2] / side).astype(np.int64)
        kept = np.sort(np.unique(cells, axis=0, return_index=True)[1])
        if len(kept) < fewest:
            return np.arange(len(points))
        nearest = cKDTree(points[kept, :2]).query(points[kept, :2], k=[2])[1][:, 0]
        if not on_lines(points[kept], nearest, np.inf):
            return kept
        side *= COARSER


def with_points_between(
    planes: list[RoofPlane], points: Points, kept: NDArray[np.int64], tolerance: float
) -> list[RoofPlane]:
    """The planes of the `kept` (K,) of points (N, 3) with the other points: each goes to the nearest of the
    planes of the kept points around it, where it lies within the `tolerance` (m) of that.
    """
    if not planes:
        return []
    label = np.full(len(kept), -1)
    for number, plane in enumerate(planes):
        label[plane.members] = number
    coefficients = np.array([plane.coefficients for plane in planes])
    normal = np.column_stack([-coefficients[:, :2], np.ones(len(planes))])
    rest = np.setdiff1d(np.arange(len(points)), kept)
    near = cKDTree(points[kept, :2]).query(points[rest, :2], k=[*range(1, min(NEAREST, len(kept)) + 1)])[1]
    of = label[near]
    over = np.einsum("nki,ni->nk", normal[of], points[rest]) - coefficients[of, 2]
    away = np.where(of >= 0, np.abs(over) / np.linalg.norm(normal[of], axis=2), np.inf)
    best = np.argmin(away, axis=1)
    rows = np.arange(len(rest))
    own = np.where(away[rows, best] <= tolerance, of[rows, best], -1)
    members = [
        np.sort(np.concatenate([kept[plane.members], rest[own == number]]))
        for number, plane in enumerate(planes)
    ]
    return [replace(plane, members=one) for plane, one in zip(planes, members, strict=True)]
