"""Order and origin of point clouds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from eaves.model import Block, Bounds, PointCloud, Raster
from eaves.model.cloud import canonical_order, snap

points = arrays(
    np.float64,
    st.tuples(st.integers(0, 60), st.just(3)),
    elements=st.integers(-3000, 3000).map(lambda k: k / 997),
)


@settings(deadline=None)
@given(points, st.randoms(use_true_random=False))
def test_canonical_order_depends_on_the_points_alone(xyz: np.ndarray, random: object) -> None:
    shuffle = np.random.default_rng(len(xyz)).permutation(len(xyz))
    assert np.array_equal(xyz[canonical_order(xyz)], xyz[shuffle][canonical_order(xyz[shuffle])])


def test_canonical_order_goes_by_one_metre_cells_row_by_row() -> None:
    xyz = np.array([[1.5, 0.1, 0], [0.2, 1.1, 0], [0.9, 0.9, 0], [0.1, 0.95, 0]])
    assert canonical_order(xyz).tolist() == [2, 3, 0, 1]


def test_a_cloud_moved_by_whole_blocks_has_the_same_local_coordinates() -> None:
    xyz = np.random.default_rng(0).random((100, 3)) * [200, 200, 30] + [84960.0, 446880.0, 0.0]
    here, there = PointCloud.from_world(xyz), PointCloud.from_world(xyz + [2000 * 240.0, 240.0, 0.0])
    assert np.array_equal(here.xyz, there.xyz)
    assert there.origin[0] - here.origin[0] == 2000 * 240.0


def test_about_another_origin_keeps_world_positions() -> None:
    cloud = PointCloud(snap(np.array([[1.2345, 2.0, 3.0]])), origin=(240.0, 480.0))
    moved = cloud.about((0.0, 0.0))
    assert np.allclose(moved.xyz[0], [241.2345, 482.0, 3.0])


def test_block_of_a_negative_coordinate() -> None:
    block = Block.at(-0.5, 10.0)
    assert (block.column, block.row) == (-1, 0)
    assert block.bounds == Bounds(-240.0, 0.0, 0.0, 240.0)


def test_raster_is_linear_between_cell_centres() -> None:
    values = np.add.outer(-np.arange(4.0), 2 * np.arange(5.0)).astype(np.float32)
    raster = Raster(values, west=10.0, north=20.0, cell=0.5)
    xy = np.array([[10.25, 19.75], [11.0, 19.5], [12.1, 18.6]])
    expected = 2 * ((xy[:, 0] - 10.25) / 0.5) - (19.75 - xy[:, 1]) / 0.5
    assert np.allclose(raster.at(xy), expected, atol=1e-6)


@pytest.mark.parametrize("count", [1, 127, 128, 1000])
@pytest.mark.parametrize("columns", [2, 3])
def test_bounds_are_the_extremes_of_the_columns(count: int, columns: int) -> None:
    xyz = np.random.default_rng(count).normal(0, 10, (count, columns))
    for points in (xyz, xyz[::-1], np.asfortranarray(xyz)):
        bounds = Bounds.of(points)
        assert (bounds.west, bounds.south) == tuple(xyz.min(axis=0)[:2])
        assert (bounds.east, bounds.north) == tuple(xyz.max(axis=0)[:2])


def test_order_is_known_while_points_are_picked_and_forgotten_when_they_move() -> None:
    xyz = np.random.default_rng(2).uniform(0, 30, (500, 3))
    cloud = PointCloud(xyz).in_canonical_order()
    assert np.array_equal(cloud.xyz, xyz[canonical_order(xyz)])
    picked = cloud.take(cloud.xyz[:, 2] > 10.0)
    assert picked.ordered
    assert np.array_equal(canonical_order(picked.xyz), picked.canonical_order())
    assert not cloud.take(np.arange(len(cloud))[::-1]).ordered
    assert not cloud.with_(xyz=cloud.xyz[::-1]).ordered
    assert cloud.about((240.0, 0.0)).ordered
    assert not cloud.about((0.5, 0.0)).ordered


def test_world_coordinates_without_an_origin_are_counted_from_a_block() -> None:
    world = np.array([[85012.0, 447001.0, 3.0], [85014.5, 447000.5, 4.0]])
    given, made = PointCloud(world), PointCloud.from_world(world)
    assert given.origin == made.origin == (84960.0, 446880.0) and np.array_equal(given.xyz, made.xyz)
    assert np.allclose(given.world, world) and given.crs is None
    near = PointCloud(world - [85000.0, 447000.0, 0.0])
    assert near.origin == (0.0, 0.0) and np.array_equal(near.world, near.xyz)


def test_a_cloud_is_indexed_as_an_array() -> None:
    cloud = PointCloud(np.arange(30.0).reshape(10, 3), classification=np.arange(10, dtype=np.uint8))
    assert cloud[cloud.xyz[:, 2] > 20].classification.tolist() == [7, 8, 9]  # type: ignore[union-attr]
    assert cloud[2:4].xyz.tolist() == [[6, 7, 8], [9, 10, 11]]
    assert len(cloud[5]) == 1 and len(cloud[np.array([1, 8])]) == 2 and len(cloud[:0]) == 0


@pytest.mark.parametrize("given", [[[1, 2, 3]], np.ones((2, 3), int), np.ones((3, 4), np.float32).T[:, :3]])
def test_numbers_of_any_kind_are_points(given: object) -> None:
    xyz = PointCloud(given).xyz  # type: ignore[arg-type]
    assert xyz.dtype == np.float64 and xyz.flags.c_contiguous and np.array_equal(xyz, np.asarray(given))


def test_float32_says_how_much_it_lost(caplog: pytest.LogCaptureFixture) -> None:
    PointCloud(np.full((2, 3), 446000.0, np.float32))
    assert "float32, whose steps at 446000 are 3.1 cm" in caplog.text
    caplog.clear()
    PointCloud(np.full((2, 3), 20.0, np.float32))
    assert not caplog.records


def test_bounds_leave_points_without_coordinates_out() -> None:
    cloud = PointCloud(np.array([[np.nan, 1.0, 2.0], [3.0, 4.0, 5.0], [6.0, 7.0, 8.0]]))
    assert cloud.bounds == Bounds(3.0, 4.0, 6.0, 7.0)


def test_cloud_of_points_without_coordinates_has_no_bounds() -> None:
    with pytest.raises(ValueError, match="no bounds"):
        _ = PointCloud(np.full((2, 3), np.nan)).bounds
