"""Smoothed surfaces: how far they were smoothed is measured, and what was there comes back."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from eaves.blocks.points import SHARPENED_MARGIN as MARGIN
from eaves.blocks.points import Smoothed, find_sharpened
from eaves.raster.blur import measure_blur, measure_roughness, without_blur


def town(sigma: float, cell: float = 1.0) -> np.ndarray:
    """Heights (240, 240) of boxes of 8 to 20 m, 3 to 8 m high, on a slope of 5 %, smoothed by `sigma` (m)."""
    rng = np.random.default_rng(7)
    surface = np.zeros((240, 240))
    for row in range(20, 220, 40):
        for column in range(20, 220, 40):
            tall, wide = rng.integers(8, 21, 2)
            surface[row : row + tall, column : column + wide] = rng.uniform(3.0, 8.0)
    surface += 0.05 * np.arange(240)
    return ndimage.gaussian_filter(surface, sigma / cell) if sigma else surface


def points_of(surface: np.ndarray) -> np.ndarray:
    """A point in the middle of each cell of 1 m."""
    row, column = np.indices(surface.shape)
    return np.column_stack([column.ravel() + 0.5, row.ravel() + 0.5, surface.ravel()])


def test_sharp_walls_have_no_blur():
    assert np.isnan(measure_blur(points_of(town(0.0))))


@pytest.mark.parametrize("sigma", [1.5, 2.0, 3.0])
def test_blur_is_measured(sigma):
    assert 0.95 * sigma < measure_blur(points_of(town(sigma))) < 1.2 * sigma


def test_a_slope_without_walls_has_no_blur():
    assert np.isnan(measure_blur(points_of(0.3 * np.arange(240) * np.ones((240, 1)))))


@pytest.mark.parametrize("sigma", [1.5, 2.5])
def test_walls_come_back(sigma):
    sharp = town(0.0)
    found = without_blur(town(sigma), sigma, 1.0)
    before = np.abs(town(sigma) - sharp) > 0.7
    after = np.abs(found - sharp) > 0.7
    assert after.sum() < 0.25 * before.sum()


def test_a_plane_stays():
    plane = 0.2 * np.arange(160) + 0.1 * np.arange(160)[:, None]
    inner = np.s_[30:-30, 30:-30]  # beside the rim of a block lies its margin
    assert np.abs(without_blur(plane, 2.0, 1.0) - plane)[inner].max() < 0.05


def test_roughness_is_that_of_the_flat():
    rng = np.random.default_rng(3)
    xyz = points_of(town(0.0))
    assert measure_roughness(xyz) < 0.001
    xyz[:, 2] += rng.normal(0.0, 0.1, len(xyz))
    assert 0.04 < measure_roughness(xyz) < 0.1


@pytest.mark.slow
def test_points_of_a_block_are_sharpened_as_those_of_its_neighbour_see_them():
    """A wall on the border of two blocks is at one place in both: each sees the other's points."""
    xyz = points_of(town(2.0))
    west = xyz[:, 0] < 120.0

    class Parameters:
        blur = 2.0

    heights = []
    for own in (west, ~west):
        near = np.abs(xyz[:, 0] - 120.0) < MARGIN
        heights.append(find_sharpened(Smoothed(xyz[own], xyz[own | near]), Parameters)["z"] * 1e-4)
    whole = find_sharpened(Smoothed(xyz, xyz), Parameters)["z"] * 1e-4
    joined = np.empty(len(xyz))
    joined[west], joined[~west] = heights
    difference = np.abs(joined - whole)
    assert np.median(difference) < 0.03 and np.percentile(difference, 99) < 0.25
