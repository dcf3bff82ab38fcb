"""Tanks and silos: the circle through a boundary, drawn where it costs less than the polygon."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.model import Points, Values
from eaves.outline.stage import MIN_POINTS
from eaves.outline.toolkit.edges import edge_shift_kernel
from eaves.outline.toolkit.polyline import Prices

CORNERS = 4
"""A circle costs as much as the corners of the plainest polygon, a rectangle."""


def circle_through(ring: NDArray[np.float64]) -> NDArray[np.float64]:
    """Centre and radius (3,) of the circle of least squares through points (M, 2)."""
    middle = ring.mean(axis=0)
    x, y = (ring - middle).T
    a, b, c = np.linalg.lstsq(np.column_stack([x, y, np.ones(len(ring))]), x * x + y * y, rcond=None)[0]
    return np.array([middle[0] + a / 2, middle[1] + b / 2, np.sqrt(c + (a * a + b * b) / 4)])


def is_cheaper(
    circle: NDArray[np.float64],
    corners: NDArray[np.float64],
    ring: NDArray[np.float64],
    weight: Values,
    sigma: float,
    prices: Prices,
) -> bool:
    """True if points (M, 2) cost less on the circle (3,) than on the polygon with `corners` (C, 2), on which
    each has its `weight` (M,): a circle of which a part is hidden is not believed."""
    side = np.roll(corners, -1, axis=0) - corners
    angle = np.arctan2(side[:, 1], side[:, 0])
    sine = np.maximum(np.abs(np.sin(angle - np.roll(angle, 1))), 1e-6)
    off = shapely.distance(shapely.linearrings(corners), shapely.points(ring))
    around = np.hypot(*(ring - circle[:2]).T) - circle[2]
    straight, curved = (np.minimum(0.5 * (away / sigma) ** 2, prices.stray) for away in (off, around))
    price = prices.corner * (CORNERS - (1.0 / sine).sum())
    return bool(curved.sum() + price < weight @ straight)


def moved_out(
    circle: NDArray[np.float64], points: Points, strip: tuple[float, float], blur: float, beside: float
) -> float:
    """The radius (m) at which points (N, 3) end: the circle is unrolled to one straight edge. `strip` is how
    far (m) outside and inside of it points are looked at.
    """
    away = points[:, :2] - circle[:2]
    along = np.mod(np.arctan2(away[:, 1], away[:, 0]), 2.0 * np.pi) * circle[2]
    unrolled = np.column_stack([along, -np.hypot(away[:, 0], away[:, 1]), points[:, 2]])
    length = np.array([2.0 * np.pi * circle[2]])
    normal, start = np.array([[0.0, 1.0]]), np.array([[0.0, -circle[2]]])
    shift = edge_shift_kernel(
        unrolled, normal, -circle[2:], start, length, *strip, 0.0, blur, beside, MIN_POINTS
    )
    return float(circle[2] - (shift[0] if np.isfinite(shift[0]) else 0.0))


def polygon_of(circle: NDArray[np.float64], fewest: int, sagitta: float) -> NDArray[np.float64]:
    """The corners (C, 2) of the regular polygon of the circle's area, with `fewest` sides or as many as keep
    within the `sagitta` (m), counter-clockwise."""
    wanted = np.pi / np.arccos(1.0 - min(sagitta / circle[2], 1.0))
    sides = max(fewest, int(np.ceil(wanted)))
    angle = 2.0 * np.pi * np.arange(sides) / sides
    reach = circle[2] * np.sqrt(2.0 * np.pi / sides / np.sin(2.0 * np.pi / sides))
    return np.asarray(circle[:2] + reach * np.column_stack([np.cos(angle), np.sin(angle)]))
