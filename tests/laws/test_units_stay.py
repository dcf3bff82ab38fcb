"""What changes nothing of a block leaves its units: noise, another frame, another start of its ring."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from shapely import Polygon, affinity, box

from eaves.units import divide_block

Changed = tuple[NDArray[np.float64], Polygon, Callable[[Polygon], Polygon]]
"""Points and outline after a change, and what takes outlines back."""
MIDDLE = (20.0, 12.0)


def two_rows() -> tuple[NDArray[np.float64], Polygon]:
    """Points (N, 3) and the outline of two rows of gables that meet in a corner, their eaves not level."""
    rng = np.random.default_rng(7)
    parts, points = [box(0, 0, 42, 9), box(0, 9, 9, 33)], []
    for part, turned in zip(parts, (False, True), strict=True):
        west, south, east, north = part.bounds
        x, y = (
            rng.uniform(west, east, 12 * round(part.area)),
            rng.uniform(south, north, 12 * round(part.area)),
        )
        s, t = (y, x) if turned else (x, y)
        z = (
            6.0
            + np.array([0.0, 0.5, -0.3, 0.4, 0.0, 0.6, -0.2])[(s // 6).astype(int)]
            + 0.8 * np.minimum(t, 9 - t)
        )
        points.append(np.column_stack([x, y, z + rng.normal(0, 0.02, len(x))]))
    return np.concatenate(points), shapely.union_all(parts)


def shaken(points: NDArray[np.float64], outline: Polygon, rng: np.random.Generator) -> Changed:
    return points + rng.normal(0, 0.005, points.shape), outline, lambda part: part


def redrawn(points: NDArray[np.float64], outline: Polygon, rng: np.random.Generator) -> Changed:
    ring = np.asarray(outline.exterior.coords)[:-1]
    ring = np.roll(ring + rng.normal(0, 0.02, ring.shape), int(rng.integers(len(ring))), axis=0)
    return points, Polygon(ring), lambda part: part


def mirrored(points: NDArray[np.float64], outline: Polygon, rng: np.random.Generator) -> Changed:
    def mirror(shape: Polygon) -> Polygon:
        return affinity.scale(shape, -1, 1, origin=MIDDLE)

    return points * [-1, 1, 1] + [2 * MIDDLE[0], 0, 0], mirror(outline), mirror


def turned(points: NDArray[np.float64], outline: Polygon, rng: np.random.Generator) -> Changed:
    angle = float(rng.uniform(0, 360))
    xy = shapely.get_coordinates(affinity.rotate(shapely.MultiPoint(points[:, :2]), angle, MIDDLE))
    whole = affinity.rotate(outline, angle, MIDDLE)
    return np.column_stack([xy, points[:, 2]]), whole, lambda part: affinity.rotate(part, -angle, MIDDLE)


@pytest.mark.parametrize("change", [shaken, redrawn, mirrored, turned])
def test_units_stay(change: Callable[..., Changed]) -> None:
    points, outline = two_rows()
    before = divide_block(points, points[:, 2], outline, 0.3).parts
    assert len(before) > 6
    met = found = 0
    for seed in range(8):
        moved, other, back = change(points, outline, np.random.default_rng(seed))
        after = [back(part) for part in divide_block(moved, moved[:, 2], other, 0.3).parts]
        met += sum(best_iou(part, after) > 0.85 for part in before)
        found += len(after)
    assert met >= 0.95 * max(8 * len(before), found)


def best_iou(part: Polygon, others: list[Polygon]) -> float:
    """The largest intersection over union of a part with one of the others."""
    return float(max(part.intersection(other).area / part.union(other).area for other in others))
