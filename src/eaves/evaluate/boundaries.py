"""The rims of labelled regions, and how far apart the rims of a result and a reference lie."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from eaves.model import Values

FARTHEST = 3.0
"""Rim points farther than this (m) from the reference's rim are not the same rim [isprs_evaluation]."""

CANDIDATES = 8
"""Sides whose middles are nearest to a point; the nearest side is among them, as all are of one length."""

Sides = tuple[NDArray[np.float64], NDArray[np.bool_]]
"""Middles (N, 2) of cell sides, m from the upper left corner (x right, y down); which are upright (N,)."""


def rim_of(inside: NDArray[np.bool_], cell: float) -> Sides:
    """The cell sides between inside and outside of a mask (H, W); the raster's frame is outside."""
    framed = np.pad(inside, 1)
    row, column = np.nonzero(framed[1:-1, 1:] != framed[1:-1, :-1])
    upright = np.stack([column, row + 0.5], axis=1)
    row, column = np.nonzero(framed[1:, 1:-1] != framed[:-1, 1:-1])
    level = np.stack([column + 0.5, row], axis=1)
    middles = np.concatenate([upright, level]) * cell
    return middles, np.repeat([True, False], [len(upright), len(level)])


def rim_distances(result: Sides, reference: Sides, cell: float) -> Values:
    """Distances (m) of the middles of a result's sides from the reference's rim, those over 3 m left out."""
    middles, (targets, upright) = result[0], reference
    if len(middles) == 0 or len(targets) == 0:
        return np.zeros(0)
    near = min(CANDIDATES, len(targets))
    _, which = cKDTree(targets).query(middles, k=near)
    which = np.asarray(which).reshape(len(middles), near)
    away = np.abs(middles[:, None] - targets[which])
    beside = np.where(upright[which], away[..., 0], away[..., 1])
    beyond = np.maximum(np.where(upright[which], away[..., 1], away[..., 0]) - cell / 2, 0.0)
    distance = np.hypot(beside, beyond).min(axis=1)
    return np.asarray(distance[distance <= FARTHEST])
