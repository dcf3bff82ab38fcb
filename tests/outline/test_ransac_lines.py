"""Long segments are found without chance, and turned into the main directions."""

from __future__ import annotations

import numpy as np
from shapely import affinity
from tests.outline.test_global_fit import L_SHAPE, corner_count, iou, scanned

from eaves.model import Boundary, Footprint
from eaves.outline import regularise_outlines, trace_outline
from eaves.outline.ransac_lines import RansacLines, long_runs


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
