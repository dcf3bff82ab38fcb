"""Extrapolation of the terrain beyond the edge of the data: a TIN that ends in walls climbs them."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from eaves.methods import Method, parameter
from eaves.model import Bounds, Points
from eaves.model.cloud import GRID_STEP


class Rim(Method):
    """Extrapolation of the terrain beyond the edge of the data."""

    rim_apart: float = parameter(
        10.0,
        "Distance between points that predict the terrain; the first stand half as far outside the data.",
        unit="m",
        gt=0,
    )
    rim_nearest: int = parameter(
        32, "Number of nearest sure ground points that define the plane of each.", ge=1
    )


def rim_points(sure: Points, bounds: Bounds, rules: Rim) -> Points:
    """Points (K, 3) around `bounds`, at the heights that the sure ground points (N, 3) predict.

    Without them the hull of a TIN runs through roofs and crowns that the rim of the data cuts. Its facets
    there are slivers as steep as walls, and points climb them. Each height is that of a plane through the
    nearest ground points, fitted with a little stiffness (a metre), for their place may not tell a slope; it
    goes on for twice `rim_apart`, and level from there.
    """
    if len(sure) == 0:
        return np.zeros((0, 3))
    xy = rim_ring(bounds.buffered(rules.rim_apart / 2), rules.rim_apart)
    number = min(rules.rim_nearest, len(sure))
    distance, nearest = map(
        np.asarray,
        cKDTree(sure[:, :2], compact_nodes=False, balanced_tree=False).query(xy, k=np.arange(1, number + 1)),
    )
    near = sure[nearest]
    middle = near.mean(axis=1)
    offset = near - middle[:, None]
    spread = np.einsum("ijk,ijl->ikl", offset[..., :2], offset[..., :2])
    spread += number * np.eye(2)
    rise = np.einsum("ijk,ij->ik", offset[..., :2], offset[..., 2])
    slope = np.linalg.solve(spread, rise[..., None])[..., 0]
    step = xy - near[:, 0, :2]
    step *= np.minimum(1.0, 2 * rules.rim_apart / np.maximum(distance[:, :1], GRID_STEP))
    height = middle[:, 2] + ((near[:, 0, :2] + step - middle[:, :2]) * slope).sum(axis=1)
    return np.asarray(np.c_[xy, np.round(height / GRID_STEP) * GRID_STEP])


def rim_ring(bounds: Bounds, apart: float) -> Points:
    """Points (K, 2) along the rim of `bounds`, corners among them, at most `apart` (m) apart."""
    columns = np.linspace(bounds.west, bounds.east, 1 + int(np.ceil((bounds.east - bounds.west) / apart)))
    rows = np.linspace(bounds.south, bounds.north, 1 + int(np.ceil((bounds.north - bounds.south) / apart)))
    south, north = (np.c_[columns, np.full(len(columns), y)] for y in (bounds.south, bounds.north))
    west, east = (np.c_[np.full(len(rows) - 2, x), rows[1:-1]] for x in (bounds.west, bounds.east))
    return np.asarray(np.round(np.concatenate([south, north, west, east]) / GRID_STEP) * GRID_STEP)
