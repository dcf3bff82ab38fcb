"""DTM and DSM: exact on planes, closed over gaps, flat at the rim."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from eaves.ground.toolkit.seeds import openings
from eaves.model import Bounds, PointCloud, Raster
from eaves.raster.grid import heights_of, highest_points, lowest_points, mean_heights, whole_cells
from eaves.raster.interpolate import fill_linear, fill_linear_twice, fill_nearest
from eaves.raster.surfaces import make_dsm, make_dtm, terrain_of

SQUARE = Bounds(0.0, 0.0, 20.0, 20.0)


def ground_cloud(xyz: np.ndarray) -> PointCloud:
    return PointCloud(xyz, classification=np.full(len(xyz), 2, np.uint8))


def plane_points(rng: np.random.Generator, count: int = 4000) -> np.ndarray:
    xy = rng.uniform(0, 20, (count, 2))
    return np.c_[xy, 3.0 + 0.1 * xy[:, 0] - 0.05 * xy[:, 1]]


def test_dtm_of_a_plane_is_the_plane__over_a_gap_too() -> None:
    xyz = plane_points(np.random.default_rng(1), 40000)
    hole = (np.abs(xyz[:, :2] - 10.0) < 4.0).all(axis=1)
    dtm = make_dtm(ground_cloud(xyz[~hole]), SQUARE)
    x, y = np.meshgrid(np.arange(0.25, 20, 0.5), np.arange(19.75, 0, -0.5))
    assert dtm.shape == (40, 40)
    assert np.abs(dtm.values - (3.0 + 0.1 * x - 0.05 * y)).max() < 0.05


def test_dtm_never_leaves_the_heights_of_its_points() -> None:
    rng = np.random.default_rng(2)
    xyz = np.c_[rng.uniform(4, 16, (60, 2)), rng.uniform(-1, 1, 60)]
    dtm = make_dtm(ground_cloud(xyz), SQUARE)
    assert np.isfinite(dtm.values).all()
    assert dtm.values.min() >= xyz[:, 2].min() - 1e-5
    assert dtm.values.max() <= xyz[:, 2].max() + 1e-5


@pytest.mark.parametrize("count", [0, 1, 2])
def test_few_ground_points_give_a_level_or_empty_terrain(count: int) -> None:
    dtm = terrain_of(ground_cloud(np.full((count, 3), 5.0)), SQUARE)
    assert np.isnan(dtm.values).all() if count == 0 else (dtm.values == 5.0).all()


def test_ground_outside_the_bounds_still_gives_a_terrain() -> None:
    dtm = make_dtm(ground_cloud(np.array([[50.0, 50.0, 7.0]])), SQUARE)
    assert (dtm.values == 7.0).all()


def test_dsm_keeps_the_jump_at_a_wall_and_leaves_noise_out() -> None:
    rng = np.random.default_rng(4)
    xyz = np.c_[rng.uniform(0, 20, (8000, 2)), np.zeros(8000)]
    xyz[xyz[:, 0] > 10, 2] = 6.0
    classes = np.ones(8000, np.uint8)
    xyz[0], classes[0] = (5.0, 5.0, 80.0), 18
    dsm = make_dsm(PointCloud(xyz, classification=classes), SQUARE)
    assert set(np.unique(dsm.values)) == {0.0, 6.0}
    assert (dsm.values[:, :20] == 0).all()
    assert (dsm.values[:, 20:] == 6).all()


def test_dsm_leaves_wide_gaps_empty() -> None:
    xyz = plane_points(np.random.default_rng(5))
    xyz = xyz[xyz[:, 0] < 10]
    dsm = make_dsm(PointCloud(xyz), SQUARE)
    assert np.isnan(dsm.values[:, -5:]).all()
    assert np.isfinite(dsm.values[:, :18]).all()


def test_rasters_do_not_depend_on_the_order_of_the_points() -> None:
    rng = np.random.default_rng(6)
    cloud = ground_cloud(plane_points(rng, 1000))
    mixed = cloud.take(rng.permutation(1000))
    assert np.allclose(make_dtm(cloud, SQUARE).values, make_dtm(mixed, SQUARE).values, atol=1e-5)
    assert (make_dsm(cloud, SQUARE).values == make_dsm(mixed, SQUARE).values)[:, 1:-1].all()


def test_lowest_and_highest_point_of_a_cell_are_found() -> None:
    xyz = np.array([[0.2, 0.2, 1.0], [0.3, 0.3, 3.0], [1.5, 0.5, 2.0]])
    bounds = Bounds(0.0, 0.0, 3.0, 1.0)
    assert lowest_points(xyz, bounds, 1.0).tolist() == [[0, 2, -1]]
    assert highest_points(xyz, bounds, 1.0).tolist() == [[1, 2, -1]]
    mean, count = mean_heights(xyz, bounds, 1.0)
    assert mean[0, :2].tolist() == [2.0, 2.0]
    assert count.tolist() == [[2.0, 1.0, 0.0]]
    assert np.isnan(heights_of(lowest_points(xyz, bounds, 1.0), xyz[:, 2])[0, 2])


def test_whole_cells_hold_the_bounds_and_lie_on_the_grid() -> None:
    grown = whole_cells(Bounds(0.3, -0.2, 2.0, 1.9), 0.5)
    assert (grown.west, grown.south, grown.east, grown.north) == (0.0, -0.5, 2.5, 2.0)
    rim = whole_cells(Bounds(1.0, 1.0, 1.0, 1.0), 0.5)
    assert (rim.west, rim.south, rim.east, rim.north) == (1.0, 0.5, 1.5, 1.0)


def test_opening_takes_what_is_narrower_than_its_window_and_nothing_else() -> None:
    flat = np.zeros((30, 30), np.float32)
    flat[5:9, 5:9], flat[15:24, 15:24] = 3.0, 3.0
    (after,) = openings(flat, [2])
    assert after[5:9, 5:9].max() == 0.0
    assert (after[15:24, 15:24] == 3.0).all()


@pytest.mark.parametrize(
    ("rows", "columns", "radius"), [(1, 1, 0), (1, 9, 3), (23, 40, 1), (31, 17, 5), (4, 5, 9)]
)
def test_opening_is_that_of_scipys_filters(rows: int, columns: int, radius: int) -> None:
    values = np.random.default_rng(rows).normal(0, 1, (rows, columns)).astype(np.float32)
    size = 2 * radius + 1
    low = ndimage.minimum_filter(values, size, mode="nearest")
    assert (next(openings(values, [radius])) == ndimage.maximum_filter(low, size, mode="nearest")).all()


def test_filling_leaves_known_cells_alone() -> None:
    values = np.arange(36, dtype=np.float32).reshape(6, 6)
    holed = values.copy()
    holed[2:4, 2:4] = np.nan
    raster = Raster(holed, 0.0, 6.0, 1.0)
    assert np.allclose(fill_linear(raster).values, values, atol=1e-4)
    assert (fill_nearest(raster, 2.0).values[~np.isnan(holed)] == values[~np.isnan(holed)]).all()


def test_a_short_gap_takes_the_heights_between_its_ends() -> None:
    values = np.full((5, 4), np.nan, np.float32)
    values[2] = 0.0, np.nan, np.nan, 3.0
    assert np.allclose(fill_linear(Raster(values, 0.0, 5.0, 1.0)).values[2], [0.0, 1.0, 2.0, 3.0])


@pytest.mark.parametrize("share", [0.0, 0.02, 0.3, 1.0])
def test_two_rasters_filled_together_are_those_filled_apart(share: float) -> None:
    rng = np.random.default_rng(5)
    # off the grid's own symmetry: four cells at equal distances may be joined by either diagonal
    rows, columns = np.indices((40, 50))
    plane = (0.3 * rows - 0.2 * columns).astype(np.float32)
    values = np.where(rng.random(plane.shape) < 0.4, plane, np.nan).astype(np.float32)
    richer = np.where(rng.random(plane.shape) < share, plane, values).astype(np.float32)
    deck = np.s_[10:16, 20:30]
    richer[deck] = plane[deck] + np.float32(share > 0.0)
    one, two = (Raster(grid, 0.0, 20.0, 0.5) for grid in (values, richer))
    filled, also = fill_linear_twice(one, two)
    assert np.array_equal(filled.values, fill_linear(one).values)
    away = np.ones(plane.shape, bool)
    away[6:20, 16:34] = False
    inside = away & np.isfinite(fill_linear(two).values)
    assert np.allclose(also.values[inside], fill_linear(two).values[inside], atol=1e-4)
    assert np.array_equal(also.values[np.isfinite(richer)], richer[np.isfinite(richer)])
