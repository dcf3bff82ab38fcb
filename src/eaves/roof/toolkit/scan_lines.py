"""Points close along scan lines and far apart between them: thinned, so that neighbours lie all around."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from eaves.geometry.planes import LINE_RATIO, LocalPlanes, local_planes
from eaves.model import Points, RoofPlane

NEIGHBOURS, MOST_NEIGHBOURS = 10, 20
"""Neighbours of a point that show whether its surroundings are a line."""

COARSER = 1.5
"""Times as wide as before are the cells of the next thinning."""

NEAREST = 4
"""Kept points whose planes a point between them may belong to."""


def on_lines(local: LocalPlanes) -> bool:
    """Whether most points see neighbours on one line alone: none of them has a normal."""
    return bool(np.mean(local.eigenvalues[:, 1] < LINE_RATIO * local.eigenvalues[:, 2]) > 0.5)


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
        if not on_lines(local_planes(points[kept], NEIGHBOURS, MOST_NEIGHBOURS)):
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
    mine = np.where(away[rows, best] <= tolerance, of[rows, best], -1)
    members = [
        np.sort(np.concatenate([kept[plane.members], rest[mine == number]]))
        for number, plane in enumerate(planes)
    ]
    return [replace(plane, members=one) for plane, one in zip(planes, members, strict=True)]
