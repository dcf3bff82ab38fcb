"""The fitted outline has the true corners, no shift, and squares only what is square."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from shapely import Polygon, affinity

from eaves.model import Boundary, Footprint
from eaves.outline import regularise_outlines, trace_outline
from eaves.outline.global_fit import GlobalFit
from eaves.outline.toolkit.edges import edge_shift_kernel

RECTANGLE = Polygon([(0, 0), (14, 0), (14, 9), (0, 9)])
L_SHAPE = Polygon([(0, 0), (14, 0), (14, 6), (6, 6), (6, 12), (0, 12)])
JOG = Polygon([(0, 0), (10, 0), (10, 1.2), (18, 1.2), (18, 10), (0, 10)])
OBLIQUE = Polygon([(0, 0), (14, 0), (12, 9), (1, 8)])
COURTYARD = Polygon([(0, 0), (24, 0), (24, 20), (0, 20)], [[(7, 6), (17, 6), (17, 14), (7, 14)]])


def scanned(shape: Polygon, density: float, seed: int = 1, noise: float = 0.03) -> NDArray[np.float64]:
    """Points on `shape` at `density` (1/m²), random in plan with noise (m)."""
    rng = np.random.default_rng(seed)
    west, south, east, north = shape.bounds
    count = rng.poisson(density * (east - west) * (north - south))
    xy = rng.uniform([west, south], [east, north], (count, 2))
    xy = xy[shapely.contains_xy(shape, xy)]
    return np.column_stack([xy + rng.normal(0, noise, xy.shape), np.full(len(xy), 5.0)])


def outlined(points: NDArray[np.float64], density: float, **around: NDArray[np.float64]) -> Polygon:
    method = GlobalFit(spot=0.0)  # a beam without width
    boundary = trace_outline(points, density**-0.5, method, **around)
    assert isinstance(boundary, Boundary)
    footprint = regularise_outlines([boundary], method)[0]
    assert isinstance(footprint, Footprint)
    assert footprint.polygon.is_valid and footprint.polygon.exterior.is_ccw
    return footprint.polygon


def iou(a: Polygon, b: Polygon) -> float:
    return float(a.intersection(b).area / a.union(b).area)


def corner_count(shape: Polygon) -> int:
    return sum(len(ring.coords) - 1 for ring in [shape.exterior, *shape.interiors])


@pytest.mark.parametrize("shape", [RECTANGLE, L_SHAPE, JOG, COURTYARD], ids=["box", "ell", "jog", "court"])
@pytest.mark.parametrize("turn", [0.0, 33.0])
def test_corners_are_those_of_the_truth__10_points_per_m2(shape: Polygon, turn: float) -> None:
    truth = affinity.rotate(shape, turn)
    drawn = outlined(scanned(truth, 10.0), 10.0)
    assert corner_count(drawn) == corner_count(truth)
    assert iou(drawn, truth) > 0.97
    assert abs(drawn.area - truth.area) / truth.length < 0.05


def test_outlines_through_half_of_the_points_agree_the_better_the_more_there_are() -> None:
    def agreement(density: float) -> float:
        boundary = trace_outline(scanned(L_SHAPE, density), density**-0.5)
        assert isinstance(boundary, Boundary)
        footprint = regularise_outlines([boundary])[0]
        assert isinstance(footprint, Footprint) and footprint.agreement is not None
        return footprint.agreement

    assert agreement(0.4) < 0.95 < 0.97 < agreement(10.0) <= 1.0


def test_oblique_walls_are_not_squared() -> None:
    drawn = outlined(scanned(OBLIQUE, 10.0), 10.0)
    assert corner_count(drawn) == 4
    assert drawn.hausdorff_distance(OBLIQUE) < 0.4


@pytest.mark.parametrize(("radius", "density"), [(2.5, 10.0), (4.0, 4.0), (9.0, 2.0), (16.0, 10.0)])
def test_a_tank_is_a_regular_polygon__and_a_box_of_its_size_is_none(radius: float, density: float) -> None:
    truth = shapely.Point(3, 1).buffer(radius, 64)
    drawn = outlined(scanned(truth, density), density)
    reach = np.hypot(*(np.array(drawn.exterior.coords) - [drawn.centroid.x, drawn.centroid.y]).T)
    assert corner_count(drawn) >= 24 and np.ptp(reach) < 0.01
    assert iou(drawn, truth) > 1.0 - 0.5 * density**-0.5 / radius
    square = affinity.rotate(truth.envelope, 20.0)
    assert corner_count(outlined(scanned(square, density), density)) <= 6


def test_right_angles_are_exact_where_the_points_support_them() -> None:
    drawn = outlined(scanned(affinity.rotate(L_SHAPE, 20.0), 8.0), 8.0)
    run = np.diff(np.array(drawn.exterior.coords), axis=0)
    angle = np.degrees(np.arctan2(run[:, 1], run[:, 0])) % 90
    assert np.ptp(angle) < 0.05


@pytest.mark.parametrize("lines_along_the_edge", [True, False])
def test_edge_stands_where_the_points_end__on_average(lines_along_the_edge: bool) -> None:
    rng = np.random.default_rng(2)
    shifts = []
    for _ in range(200):
        if lines_along_the_edge:
            depth = np.repeat(rng.uniform(0, 0.8) + 0.8 * np.arange(4), 40)
            xyz = np.stack([rng.uniform(0, 10, len(depth)), depth, np.zeros(len(depth))], axis=1)
        else:
            xyz = rng.uniform([0, 0, 0], [10, 4, 0.1], (160, 3))
        edge = (np.array([[0.0, 1.0]]), np.zeros(1), np.zeros((1, 2)), np.full(1, 10.0))
        shifts.append(edge_shift_kernel(xyz, *edge, 1.0, 3.2, 0.0, 0.0, 0.5, 4)[0])
    assert abs(np.mean(shifts)) < 0.04


@pytest.mark.parametrize("density", [2.0, 4.0, 10.0])
def test_hidden_corner_is_drawn_where_its_sides_meet(density: float) -> None:
    points = scanned(affinity.rotate(RECTANGLE, 20.0), density)
    corner = np.array(affinity.rotate(RECTANGLE, 20.0).exterior.coords)[2]
    seen = points[np.hypot(*(points[:, :2] - corner).T) > 2.0 * density**-0.5]
    drawn = outlined(seen, density)
    assert corner_count(drawn) == 4
    assert drawn.exterior.distance(shapely.Point(corner)) < 1.5 * density**-0.5


def test_spike_is_left_out() -> None:
    tail = np.column_stack([np.arange(14.2, 18.0, 0.3), np.full(13, 4.5), np.full(13, 5.0)])
    drawn = outlined(np.concatenate([scanned(RECTANGLE, 10.0), tail, tail + [0.1, 0.25, 0.0]]), 10.0)
    assert corner_count(drawn) == 4
    assert iou(drawn, RECTANGLE) > 0.95


def test_moved_points_give_the_moved_outline() -> None:
    points = np.round(scanned(L_SHAPE, 6.0), 3)
    here = outlined(points, 6.0)
    there = outlined(points + np.array([480.0, -240.0, 0.0]), 6.0)
    assert here.equals_exact(affinity.translate(there, -480.0, 240.0), 0.0015)


@pytest.mark.parametrize("beam", [0.0, 0.1, 0.2])
def test_edge_stands_amid_divided_pulses__whatever_the_beam(beam: float) -> None:
    rng = np.random.default_rng(3)
    truth = shapely.box(0.0, 0.0, 14.0, 9.0)
    xy = rng.uniform([-1, -1], [15, 10], (2600, 2))
    depth = shapely.distance(truth.exterior, shapely.points(xy))
    depth = np.where(shapely.contains_xy(truth, xy[:, 0], xy[:, 1]), depth, -depth)
    seen = depth > -beam
    points = np.column_stack([xy, np.full(len(xy), 6.0)])[seen]
    boundary = trace_outline(points, 0.3, GlobalFit(), not_last=(np.abs(depth) < beam)[seen])
    assert isinstance(boundary, Boundary)
    footprint = regularise_outlines([boundary], GlobalFit())[0]
    assert isinstance(footprint, Footprint)
    assert abs(footprint.polygon.area - truth.area) / truth.length < 0.04


@pytest.mark.parametrize(
    ("height", "ground_below", "truth"),
    [(9.0, False, RECTANGLE), (9.0, True, None), (4.0, False, None)],
    ids=["hidden", "ground seen", "lower than the roof"],
)
def test_a_bite_under_a_crown_is_closed_unless_ground_was_seen_in_it(
    height: float, ground_below: bool, truth: Polygon | None
) -> None:
    bite = shapely.Point(14, 9).buffer(4.0)
    roof = scanned(RECTANGLE.difference(bite), 10.0)
    crown = scanned(bite, 10.0, seed=2) + [0.0, 0.0, height - 5.0]
    ground = scanned(RECTANGLE.buffer(2.0).difference(RECTANGLE.union(bite)), 10.0, seed=3)[:, :2]
    if ground_below:
        ground = np.concatenate([ground, scanned(bite, 10.0, seed=4)[:, :2]])
    drawn = outlined(roof, 10.0, ground=ground, others=crown)
    if truth is None:
        assert drawn.intersection(bite).area < 0.4 * bite.intersection(RECTANGLE).area
    else:
        assert corner_count(drawn) == 4
        assert iou(drawn, truth) > 0.96


@pytest.mark.parametrize(("apart", "side", "count"), [(1.0, 8.0, 2), (0.0, 8.0, 1), (1.0, 1.5, 1)])
def test_neighbours_a_disc_passes_between_have_an_outline_each__unless_one_is_no_building(
    apart: float, side: float, count: int
) -> None:
    houses = [shapely.box(0.0, 0.0, 10.0, 8.0), shapely.box(10.0 + apart, 0.0, 10.0 + apart + side, side)]
    density = 10.0
    turned = [affinity.rotate(house, 20.0, origin=(0, 0)) for house in houses]
    points = np.vstack([scanned(house, density, seed) for seed, house in enumerate(turned)])
    part = GlobalFit().parts(points, density**-0.5)
    first = shapely.intersects_xy(turned[0].buffer(0.1), *points[:, :2].T)
    assert len(np.unique(part)) == count
    assert len(np.unique(part[first])) == len(np.unique(part[~first])) == 1


@pytest.mark.parametrize(("width", "count"), [(1.0, 2), (4.0, 1)])
def test_a_neck_narrower_than_a_balcony_may_be_joins_no_two_houses(width: float, count: int) -> None:
    neck = shapely.box(10.0, 4.0 - width / 2.0, 12.0, 4.0 + width / 2.0)
    plan = shapely.union_all([shapely.box(0.0, 0.0, 10.0, 8.0), neck, shapely.box(12.0, 0.0, 20.0, 8.0)])
    density = 10.0
    points = scanned(affinity.rotate(plan, 20.0), density)
    assert len(np.unique(GlobalFit().parts(points, density**-0.5))) == count


@pytest.mark.parametrize("density", [10.0, 60.0])
def test_a_branch_over_the_eaves_is_not_drawn__however_dense_the_scan(density: float) -> None:
    branch = shapely.box(4.0, 9.0, 4.8, 9.4)
    assert corner_count(outlined(scanned(RECTANGLE | branch, density), density)) == 4
