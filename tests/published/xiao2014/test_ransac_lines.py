"""Long segments are found without chance, and turned into the main directions."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely import Polygon, affinity

from eaves.model import Boundary, Failure, Footprint
from eaves.outline import regularise_outlines, trace_outline
from eaves.published.xiao2014.ransac_lines import RansacLines, long_runs
from tests.outline.test_global_fit import L_SHAPE, corner_count, iou, scanned


def test_four_sides_of_a_square_are_four_runs() -> None:
    side = np.arange(0.0, 10.0, 0.5)
    zero, ten = np.zeros_like(side), np.full_like(side, 10.0)
    square = [np.c_[side, zero], np.c_[ten, side], np.c_[10 - side, ten], np.c_[zero, 10 - side]]
    runs = long_runs(np.concatenate(square), 0.1, 1, 2.0)
    assert len(runs) == 4
    assert all(18 <= last - first <= 20 for first, last in runs)


def test_an_l_shape_is_drawn_with_right_angles__inside_by_half_a_spacing() -> None:
    truth = affinity.rotate(L_SHAPE, 25.0)
    points = scanned(truth, 10.0)
    boundary = trace_outline(points, 10.0**-0.5, RansacLines())
    assert isinstance(boundary, Boundary)
    footprint = regularise_outlines([boundary], RansacLines())[0]
    assert isinstance(footprint, Footprint)
    assert corner_count(footprint.polygon) == 6
    assert iou(footprint.polygon, truth) > 0.92
    run = np.diff(np.array(footprint.polygon.exterior.coords), axis=0)
    assert np.ptp(np.degrees(np.arctan2(run[:, 1], run[:, 0])) % 90) < 0.05
    assert footprint.polygon.area < truth.area


NECK = Polygon([(7, 5), (8, 4.5), (13, 8), (12, 9)])
DUMBBELL = shapely.union_all([shapely.box(0, 0, 8, 6), shapely.box(12, 7, 20, 14), NECK])
"""Two blocks that a slanting passage joins."""
TEETH = [
    affinity.rotate(shapely.box(k, 1.0, k + 1.6, 9.0), angle)
    for k, angle in zip((1, 5, 9, 13, 17), (-11, -5, 0, 5, 11), strict=True)
]
COMB = shapely.union_all([shapely.box(0, 0, 20, 2), *TEETH])
"""Narrow wings that fan out."""


@pytest.mark.parametrize("plan", [DUMBBELL, COMB], ids=["dumbbell", "comb"])
@pytest.mark.parametrize("angle", [0.0, 20.0, 33.0])
@pytest.mark.parametrize(
    "method", [RansacLines.as_published("xiao2014"), RansacLines()], ids=["published", ""]
)
def test_no_point_is_left_outside_where_segments_make_no_ring(
    plan: Polygon, angle: float, method: RansacLines
) -> None:
    for seed in range(4):
        rng = np.random.default_rng(seed)
        turned = affinity.rotate(plan, angle)
        west, south, east, north = turned.bounds
        xy = rng.uniform((west, south), (east, north), (round(6.0 * (east - west) * (north - south)), 2))
        xy = xy[shapely.contains_xy(turned, xy)] + [84900.0, 447500.0]
        points = np.c_[xy, np.full(len(xy), 6.0)]
        spacing = 6.0**-0.5
        part = method.parts(points, spacing)
        away = np.full(len(points), np.inf)
        for number in range(int(part.max()) + 1):
            boundary = trace_outline(points[part == number], spacing, method)
            assert not isinstance(boundary, Failure)
            (footprint,) = regularise_outlines([boundary], method)
            assert isinstance(footprint, Footprint)
            away = np.minimum(away, shapely.distance(shapely.points(xy), footprint.polygon))
        assert np.quantile(away, 0.99) < method.shortest * spacing
        assert (away > method.shortest * spacing).sum() <= 1


@pytest.mark.parametrize("angle", [0.0, 20.0, 33.0])
def test_a_stretch_that_segments_leave_outside_comes_back_alone(angle: float) -> None:
    method, spacing, lost = RansacLines(), 0.35, 0
    limit = method.shortest * spacing
    for seed in range(12):
        rng = np.random.default_rng(seed)
        x = np.arange(12.0, 16.0, spacing)
        ragged = np.c_[x, 12.0 + rng.uniform(2.0, 6.0, len(x))][::-1]  # climbers on a wall: no straight run
        corners = np.vstack([[[0.0, 0.0], [30.0, 0.0], [30.0, 12.0]], ragged, [[0.0, 12.0]]])
        plan = affinity.translate(affinity.rotate(Polygon(corners), angle, origin=(0, 0)), 84900.0, 447500.0)
        ring = shapely.get_coordinates(shapely.segmentize(plan.exterior, spacing))[:-1]
        boundary = Boundary((ring,), np.c_[ring, np.full(len(ring), 6.0)], spacing)
        adjusted = method.adjusted_ring(ring, spacing, lambda name, value: None)
        drawn = method.draw(boundary, lambda name, value: None)
        away = shapely.distance(shapely.points(ring), drawn)
        assert drawn.is_valid and away.max() < limit
        if adjusted is None or not Polygon(adjusted).is_valid:
            continue
        lost += shapely.distance(shapely.points(ring), Polygon(adjusted)).max() > limit
        walls = plan.exterior.buffer(0.05).intersection(drawn.exterior).length
        run = np.diff(shapely.get_coordinates(drawn.exterior), axis=0)
        off = np.degrees(np.arctan2(run[:, 1], run[:, 0])) - angle
        square = np.abs((off + 45.0) % 90.0 - 45.0) < 0.5
        assert np.hypot(*run[square].T).sum() > 50.0 and walls > 50.0  # three walls of 54 m
    assert lost > 3  # the segments alone leave it out
