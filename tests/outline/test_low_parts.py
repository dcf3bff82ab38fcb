"""Walls and balconies are no part of the outline; annexes and dormers are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eaves.outline.global_fit import GlobalFit
from eaves.outline.global_fit.low_parts import low_parts
from eaves.outline.toolkit.alpha import triangulate_points


def house(seed: int = 0) -> NDArray[np.float64]:
    """A flat roof of 12 m × 9 m at 9 m, 10 points/m²."""
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform([0, 0], [12, 9], (1080, 2)), rng.normal(9.0, 0.02, 1080)])


def slab(west: float, south: float, east: float, north: float, z: float) -> NDArray[np.float64]:
    rng = np.random.default_rng(1)
    count = int(10 * (east - west) * (north - south))
    return np.column_stack([rng.uniform([west, south], [east, north], (count, 2)), np.full(count, z)])


def low(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    mesh = triangulate_points(points[:, :2])
    assert mesh is not None
    return low_parts(mesh, points[:, 2], 0.8, 50.0, GlobalFit())


def test_a_balcony_is_low_and_the_roof_is_not() -> None:
    found = low(np.concatenate([house(), slab(4, -1.2, 7, 0, 6.0)]))
    assert not found[:1080].any()
    assert found[1080:].mean() > 0.9


def test_points_of_a_wall_are_low() -> None:
    rng = np.random.default_rng(2)
    wall = np.column_stack([rng.uniform(0, 12, 60), rng.normal(0, 0.02, 60), rng.uniform(0, 7, 60)])
    assert low(np.concatenate([house(), wall]))[1080:].mean() > 0.9


def test_an_annex_stays_and_so_does_a_dormer() -> None:
    annex, dormer = slab(12, 2, 15, 6, 3.0), slab(5, 4, 6.5, 5.5, 11.0)
    assert low(np.concatenate([house(), annex, dormer])).mean() < 0.01
