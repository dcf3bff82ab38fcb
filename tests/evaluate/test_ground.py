"""Ground errors on counts one can do in the head."""

from __future__ import annotations

import math

import numpy as np
import pytest

from eaves.evaluate import evaluate_ground

REFERENCE = np.array([True] * 60 + [False] * 40)


def test_a_perfect_result_scores_perfectly() -> None:
    score = evaluate_ground(REFERENCE, REFERENCE)
    assert (score.type_1, score.type_2, score.total_error, score.kappa, score.f1) == (0, 0, 0, 1, 1)


def test_rejected_ground_is_type_one() -> None:
    result = REFERENCE.copy()
    result[:6] = False
    score = evaluate_ground(result, REFERENCE)
    assert (score.type_1, score.type_2, score.total_error) == (0.1, 0.0, 0.06)
    chance = 0.54 * 0.6 + 0.46 * 0.4
    assert score.kappa == pytest.approx((0.94 - chance) / (1 - chance))


def test_accepted_objects_are_type_two() -> None:
    result = REFERENCE.copy()
    result[-4:] = True
    score = evaluate_ground(result, REFERENCE)
    assert (score.type_1, score.type_2, score.total_error) == (0.0, 0.1, 0.04)


def test_no_points_give_no_number() -> None:
    score = evaluate_ground(np.zeros(0, bool), np.zeros(0, bool))
    assert math.isnan(score.total_error) and math.isnan(score.kappa)


def test_masks_of_other_clouds_are_refused() -> None:
    with pytest.raises(ValueError, match="points"):
        evaluate_ground(REFERENCE, REFERENCE[:-1])
