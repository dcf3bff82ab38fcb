"""Roof planes on label images and on points, scored by hand."""

from __future__ import annotations

import numpy as np
import pytest

from eaves.evaluate import evaluate_planes


def gable(split: int = 10, rows: int = 12, columns: int = 20) -> np.ndarray:
    """Two planes of one house, the first `split` columns and the rest; cells of half a metre."""
    labels = np.zeros((40, 40), np.int64)
    labels[5 : 5 + rows, 5 : 5 + split] = 1
    labels[5 : 5 + rows, 5 + split : 5 + columns] = 2
    return labels


AREA = 0.25


def test_a_perfect_result_scores_perfectly() -> None:
    height = np.full((40, 40), 7.0)
    score = evaluate_planes(gable(), gable(), AREA, height, height)
    assert score.planes.quality == 1 and score.planes_over_10.quality == 1
    assert score.relations["1:1"] == 2 and score.rms_xy_m == 0 and score.rms_z_m == 0


def test_a_lift_moves_the_height_only() -> None:
    height = np.full((40, 40), 7.0)
    score = evaluate_planes(gable(), gable(), AREA, height + 0.1, height)
    assert score.rms_z_m == pytest.approx(0.1) and score.rms_xy_m == 0 and score.planes.quality == 1


def test_a_split_plane_is_one_to_many() -> None:
    result = gable()
    result[11:17][result[11:17] == 1] = 3
    score = evaluate_planes(result, gable(), AREA)
    assert score.relations["1:M"] == 1 and score.relations["1:1"] == 1
    assert score.planes.quality == 1 and score.rms_xy_m == 0


def test_merged_planes_are_many_to_one() -> None:
    score = evaluate_planes((gable() > 0).astype(np.int64), gable(), AREA)
    assert score.relations["N:1"] == 1 and score.planes.quality == 1


def test_a_missing_plane_costs_completeness() -> None:
    result = gable()
    result[result == 2] = 0
    score = evaluate_planes(result, gable(), AREA)
    assert score.planes.completeness == 0.5 and score.planes.correctness == 1


def test_a_ridge_half_a_metre_off_moves_the_outlines_of_both_planes() -> None:
    score = evaluate_planes(gable(11), gable(10), AREA)
    assert score.planes.quality == 1 and score.relations["1:1"] == 2
    # the wider plane has 12 sides half a metre off and two a quarter beyond a corner; the narrower 12 sides
    # half a metre inside, of which the two at the ends are a quarter from the line above or below
    squares = (12 * 0.5**2 + 2 * 0.25**2) + (10 * 0.5**2 + 2 * 0.25**2)
    sides = 2 * (12 + 11) + 2 * (12 + 9)
    assert score.rms_xy_m == pytest.approx((squares / sides) ** 0.5)


def test_large_planes_are_counted_apart() -> None:
    labels = gable()
    labels[30:34, 30:34] = 3  # 4 m²
    score = evaluate_planes(labels, gable(), AREA)
    assert score.planes.correctness == pytest.approx(2 / 3) and score.planes_over_10.correctness == 1


def test_points_are_scored_by_their_share_of_the_area() -> None:
    reference = np.repeat([1, 2, 0], [60, 40, 10])
    result = np.repeat([5, 7, 0], [50, 50, 10])
    score = evaluate_planes(result, reference, 0.1)
    assert score.planes.quality == 1 and np.isnan(score.rms_xy_m)
    assert [row.area_m2 for row in score.rows] == pytest.approx([6, 4, 5, 5])
    assert [row.covered for row in score.rows] == pytest.approx([1, 1, 1, 1])


def test_no_planes_give_a_score() -> None:
    empty = np.zeros((4, 4), np.int64)
    assert evaluate_planes(empty, empty, AREA).relations["1:1"] == 0
