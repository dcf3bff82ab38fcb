"""Footprints against rectangles, scored by hand."""

from __future__ import annotations

import math

import pytest
import shapely
from shapely import Polygon, affinity

from eaves.evaluate import evaluate_footprints
from eaves.evaluate.footprint_scores import polis

HOUSE = shapely.box(0, 0, 10, 8)
SHED = shapely.box(20, 0, 24, 4)


def test_a_perfect_result_scores_perfectly() -> None:
    score = evaluate_footprints([HOUSE, SHED], [HOUSE, SHED])
    assert score.mean_iou == 1 and score.area.quality == 1 and score.pairs == 2
    assert score.rms_m == 0 and score.median_hausdorff_m == 0 and score.mean_polis_m == 0
    assert score.vertex_ratio == 1


def test_a_shift_by_one_metre_moves_every_distance() -> None:
    score = evaluate_footprints([affinity.translate(HOUSE, 1, 0)], [HOUSE])
    assert score.mean_iou == pytest.approx(72 / 88)
    assert score.median_hausdorff_m == pytest.approx(1)
    # two corners of each rectangle lie on the other's outline, the two others 1 m off
    assert score.mean_polis_m == pytest.approx(0.5)
    # 33 points on each upright side, 1 m off (33rd = corner); level sides on the line but for the last metre
    assert 0.5 < score.rms_m < 0.8
    assert score.vertex_ratio == 1


def test_a_missing_building_leaves_the_distances_alone() -> None:
    score = evaluate_footprints([HOUSE], [HOUSE, SHED])
    assert score.pairs == 1 and score.references == 2 and score.mean_iou == 1 and score.rms_m == 0
    assert score.area.completeness == pytest.approx(80 / 96) and score.area.correctness == 1
    assert score.rows[1].result is None and score.rows[1].iou == 0


def test_a_building_split_in_two_is_paired_with_its_larger_part() -> None:
    score = evaluate_footprints([shapely.box(0, 0, 4, 8), shapely.box(4, 0, 10, 8)], [HOUSE])
    assert score.pairs == 1 and score.rows[0].result == "2"
    assert score.rows[0].iou == pytest.approx(0.6) and score.area.quality == pytest.approx(1)


def test_two_merged_buildings_use_up_their_footprint_once() -> None:
    score = evaluate_footprints([shapely.box(0, 0, 20, 8)], [HOUSE, shapely.box(10, 0, 20, 8)])
    assert score.pairs == 1 and score.area.quality == pytest.approx(1)
    assert sorted(row.iou for row in score.rows) == [0, 0.5]


def test_a_missed_courtyard_costs_overlap_and_distance_of_its_corners() -> None:
    court = Polygon(HOUSE.exterior, [shapely.box(3, 3, 5, 5).exterior])
    score = evaluate_footprints([HOUSE], [court])
    assert score.mean_iou == pytest.approx(76 / 80) and score.rms_m == 0
    assert score.vertex_ratio == 0.5
    # of 8 reference corners the 4 of the courtyard lie 3 m from the outline
    assert score.mean_polis_m == pytest.approx((0 + 4 * 3 / 8) / 2)


def test_vertices_on_a_straight_side_are_no_corners() -> None:
    dense = shapely.segmentize(HOUSE, 1.0)
    assert evaluate_footprints([dense], [HOUSE]).vertex_ratio == 1


def test_polis_of_a_square_in_a_square() -> None:
    assert polis(shapely.box(0, 0, 4, 4), shapely.box(1, 1, 3, 3)) == pytest.approx((2**0.5 + 1) / 2)


@pytest.mark.parametrize(("result", "reference"), [([], [HOUSE]), ([HOUSE], []), ([], [])])
def test_nothing_gives_a_score(result: list[Polygon], reference: list[Polygon]) -> None:
    score = evaluate_footprints(result, reference)
    assert score.pairs == 0 and math.isnan(score.mean_iou)


def test_an_invalid_footprint_is_compared_as_its_valid_shape() -> None:
    bow = Polygon([(0, 0), (10, 8), (10, 0), (0, 8)])
    assert evaluate_footprints([bow], [HOUSE]).rows[0].iou == pytest.approx(0.5)
