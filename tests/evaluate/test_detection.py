"""Detection on scenes of two to four square buildings, scored by hand; each defect moves the figures it
should.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from eaves.evaluate import evaluate_detection, label_objects
from eaves.raster.grid import FALSE_NEGATIVE, FALSE_POSITIVE, TRUE_POSITIVE, UNKNOWN

CELL = 0.5


def scene(*buildings: tuple[int, int, int, int], width: int = 60) -> np.ndarray:
    """Labels of cells; a building is (row, column, rows, columns)."""
    labels = np.zeros((60, width), np.int64)
    for number, (row, column, rows, columns) in enumerate(buildings, 1):
        labels[row : row + rows, column : column + columns] = number
    return labels


ONE, TWO = (10, 10, 20, 20), (10, 40, 20, 10)  # 100 m² and 50 m²


def test_a_perfect_result_scores_perfectly() -> None:
    score = evaluate_detection(scene(ONE, TWO), scene(ONE, TWO), CELL)
    for agreement in (score.area, score.objects, *score.objects_over.values()):
        assert (agreement.completeness, agreement.correctness, agreement.quality) == (1, 1, 1)
    assert score.relations == {"1:1": 2, "1:M": 0, "N:1": 0, "N:M": 0, "1:0": 0, "0:1": 0}
    assert score.rms_m == 0
    assert score.objects_over[10].reference == 2 and score.objects_over[50].reference == 1


def test_a_missing_building_costs_completeness_only() -> None:
    score = evaluate_detection(scene(ONE), scene(ONE, TWO), CELL)
    assert score.area.completeness == pytest.approx(100 / 150) and score.area.correctness == 1
    assert score.area.quality == pytest.approx(100 / 150)
    assert score.objects.completeness == 0.5 and score.objects.correctness == 1
    assert score.relations["1:0"] == 1 and score.relations["1:1"] == 1
    assert score.rms_m == 0
    assert (score.map == FALSE_NEGATIVE).sum() == 200 and (score.map == TRUE_POSITIVE).sum() == 400


def test_a_false_building_costs_correctness_only() -> None:
    score = evaluate_detection(scene(ONE, TWO), scene(ONE), CELL)
    assert score.area.completeness == 1 and score.area.correctness == pytest.approx(100 / 150)
    assert score.objects.completeness == 1 and score.objects.correctness == 0.5
    assert score.objects.quality == pytest.approx(0.5)
    assert score.relations["0:1"] == 1
    assert (score.map == FALSE_POSITIVE).sum() == 200


def test_a_building_split_in_two_is_one_to_many_and_no_error_of_detection() -> None:
    halves = scene((10, 10, 20, 10), (10, 20, 20, 10))
    score = evaluate_detection(halves, scene(ONE), CELL)
    assert score.relations == {"1:1": 0, "1:M": 1, "N:1": 0, "N:M": 0, "1:0": 0, "0:1": 0}
    assert score.objects.completeness == 1 and score.objects.correctness == 1
    assert (score.objects.reference, score.objects.result) == (1, 2)
    assert score.area.quality == 1 and score.rms_m == 0


def test_two_buildings_merged_are_many_to_one() -> None:
    merged = scene((10, 10, 20, 40))  # fills the gap of 10 columns too: 200 of 800 cells are wrong
    score = evaluate_detection(merged, scene(ONE, TWO), CELL)
    assert score.relations == {"1:1": 0, "1:M": 0, "N:1": 1, "N:M": 0, "1:0": 0, "0:1": 0}
    assert score.objects.completeness == 1 and score.objects.correctness == 1
    assert score.area.completeness == 1 and score.area.correctness == pytest.approx(600 / 800)


def test_two_buildings_cut_the_other_way_are_many_to_many() -> None:
    reference = scene((10, 10, 20, 10), (10, 20, 20, 10))
    result = scene((10, 10, 10, 20), (20, 10, 10, 20))
    score = evaluate_detection(result, reference, CELL)
    assert score.relations["N:M"] == 1 and sum(score.relations.values()) == 1
    assert score.area.quality == 1


def test_a_shift_by_one_metre_moves_area_and_outline() -> None:
    row, column, rows, columns = ONE
    score = evaluate_detection(scene((row, column + 2, rows, columns)), scene(ONE), CELL)
    assert score.area.completeness == pytest.approx(0.9) and score.area.correctness == pytest.approx(0.9)
    assert score.area.quality == pytest.approx(90 / 110)
    assert score.objects.quality == 1
    # the 20 sides at the right are 1 m off, so are those at the left but for two at each end, nearer to the
    # line above or below; of those above and below all lie on the line but the last two, which stand
    # beyond it
    ends = 0.25**2 + 0.75**2
    squares = 20 * 1.0**2 + (16 * 1.0**2 + 2 * ends) + 2 * ends
    assert score.rms_m == pytest.approx(math.sqrt(squares / 80))


def test_a_hole_that_was_missed_costs_correctness_and_the_hole_has_no_outline() -> None:
    court = scene(ONE)
    court[16:24, 16:24] = 0
    score = evaluate_detection(scene(ONE), court, CELL)
    assert score.area.completeness == 1 and score.area.correctness == pytest.approx(336 / 400)
    assert score.objects.quality == 1 and score.relations["1:1"] == 1
    assert score.rms_m == 0


def test_a_hole_that_is_not_there_costs_completeness_and_outline() -> None:
    court = scene(ONE)
    court[16:24, 16:24] = 0
    score = evaluate_detection(court, scene(ONE), CELL)
    assert score.area.completeness == pytest.approx(336 / 400) and score.area.correctness == 1
    # the hole's 32 sides lie 3 m inside; the outer 80 on the line
    assert score.rms_m == pytest.approx(math.sqrt(32 * 3.0**2 / 112))


def test_outlines_more_than_three_metres_off_are_left_out() -> None:
    court = scene(ONE)
    court[17:23, 17:23] = 0  # 3.5 m inside
    assert evaluate_detection(court, scene(ONE), CELL).rms_m == 0


def test_objects_under_two_and_a_half_square_metres_are_left_out() -> None:
    crumb = scene(ONE, (40, 40, 3, 3))  # 2.25 m²
    score = evaluate_detection(crumb, scene(ONE), CELL)
    assert score.area.quality == 1 and score.objects.quality == 1
    assert evaluate_detection(scene(ONE, (40, 40, 2, 5)), scene(ONE), CELL).objects.correctness == 0.5


def test_an_object_counts_from_half_of_it_on() -> None:
    half = evaluate_detection(scene((10, 10, 20, 10)), scene(ONE), CELL)
    less = evaluate_detection(scene((10, 10, 19, 10)), scene(ONE), CELL)
    assert (half.objects.completeness, less.objects.completeness) == (1, 0)
    assert (half.objects.correctness, less.objects.correctness) == (1, 1)


def test_cells_without_points_are_left_out() -> None:
    known = np.ones((60, 60), bool)
    known[:, 40:] = False
    score = evaluate_detection(scene(ONE), scene(ONE, TWO), CELL, known)
    assert score.area.quality == 1 and score.objects.quality == 1
    assert (score.map[:, 40:] == UNKNOWN).all()


def test_a_party_wall_that_is_off_is_no_second_partner() -> None:
    row = scene((10, 10, 20, 20), (10, 30, 20, 20))
    score = evaluate_detection(scene((10, 10, 20, 24), (10, 34, 20, 16)), row, CELL)
    assert score.relations["1:1"] == 2 and score.area.quality == 1


def test_every_object_has_a_row() -> None:
    score = evaluate_detection(scene(ONE), scene(ONE, TWO), CELL)
    assert [(row.set, row.area_m2, row.covered, row.found, row.relation) for row in score.rows] == [
        ("reference", 100.0, 1.0, True, "1:1"),
        ("reference", 50.0, 0.0, False, "1:0"),
        ("result", 100.0, 1.0, True, "1:1"),
    ]


@pytest.mark.parametrize("which", ["nothing found", "nothing there", "neither"])
def test_empty_images_give_a_score(which: str) -> None:
    empty = scene()
    result = scene(ONE) if which == "nothing there" else empty
    reference = scene(ONE) if which == "nothing found" else empty
    score = evaluate_detection(result, reference, CELL)
    assert math.isnan(score.rms_m)
    assert score.area.completeness == 0 if which == "nothing found" else math.isnan(score.area.completeness)


def test_pieces_that_touch_in_a_corner_are_two_objects() -> None:
    mask = np.zeros((4, 4), bool)
    mask[:2, :2] = mask[2:, 2:] = True
    assert label_objects(mask).max() == 2
