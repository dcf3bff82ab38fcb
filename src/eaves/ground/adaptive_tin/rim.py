"""How the terrain goes on beyond the data: a TIN that ends in walls and crowns climbs them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from eaves.model import Bounds, Points
from eaves.model.cloud import GRID_STEP


@dataclass(frozen=True)
class Rim:
    """How the terrain is foretold beyond the data; each is the method's parameter of that name."""

    rim_beyond: float
    """Rim points stand this far (m) outside the bounds of the data: so near that the terrain can be
    foretold."""
    rim_apart: float
    """Rim points are at most this far (m) apart."""
    rim_nearest: int
    """A rim point lies on the plane through so many of the nearest sure ground points."""
    rim_stiffness: float
    """A plane through points scattered less than this (m) is drawn level."""
    rim_farthest: float
    """The plane goes on no farther than this (m) from the nearest ground point, then it is level."""


def rim_points(sure: Points, bounds: Bounds, rules: Rim) -> Points:
    """Points (K, 3) around `bounds`, at the heights that the sure ground points (N, 3) foretell.

    Without them the hull of a TIN runs through roofs and crowns that the rim of the data cuts. Its facets
    there are slivers as steep as walls, and points climb them. Each height is that of a plane through the
    nearest ground points, fitted with a little stiffness, for their place may not tell a slope.
    """
    if len(sure) == 0:
        return np.zeros((0, 3))
    xy = ring(bounds.buffered(rules.rim_beyond), rules.rim_apart)
    number = min(rules.rim_nearest, len(sure))
    distance, nearest = map(np.asarray, cKDTree(sure[:, :2]).query(xy, k=np.arange(1, number + 1)))
    near = sure[nearest]
    middle = near.mean(axis=1)
    offset = near - middle[:, None]
    spread = np.einsum("ijk,ijl->ikl", offset[..., :2], offset[..., :2])
    spread += number * rules.rim_stiffness**2 * np.eye(2)
    rise = np.einsum("ijk,ij->ik", offset[..., :2], offset[..., 2])
    slope = np.linalg.solve(spread, rise[..., None])[..., 0]
    step = xy - near[:, 0, :2]
    step *= np.minimum(1.0, rules.rim_farthest / np.maximum(distance[:, :1], GRID_STEP))
    height = middle[:, 2] + ((near[:, 0, :2] + step - middle[:, :2]) * slope).sum(axis=1)
    return np.asarray(np.c_[xy, np.round(height / GRID_STEP) * GRID_STEP])


def ring(bounds: Bounds, apart: float) -> Points:
    """Points (K, 2) along the rim of `bounds`, corners among them, at most `apart` (m) apart."""
    columns = np.linspace(bounds.west, bounds.east, 1 + int(np.ceil((bounds.east - bounds.west) / apart)))
    rows = np.linspace(bounds.south, bounds.north, 1 + int(np.ceil((bounds.north - bounds.south) / apart)))
    south, north = (np.c_[columns, np.full(len(columns), y)] for y in (bounds.south, bounds.north))
    west, east = (np.c_[np.full(len(rows) - 2, x), rows[1:-1]] for x in (bounds.west, bounds.east))
    return np.asarray(np.round(np.concatenate([south, north, west, east]) / GRID_STEP) * GRID_STEP)
