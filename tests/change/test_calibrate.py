"""Weights fitted to verdicts: exact on data whose weights are known, and no worse than the shipped ones."""

import json
from pathlib import Path

import numpy as np
import pytest

from eaves.change.upkeep.calibrate import (
    LEAST,
    Places,
    check_score,
    compare,
    leave_one_out,
    regress,
    scaled,
    sigmoid,
    toml,
)
from eaves.cli.runs import read_config
from eaves.detect.consensus.classifier import (
    FITTED,
    ScoreWeights,
    Weights,
    read_weights,
    write_weights,
)
from eaves.recipe.recipe import make_recipe

NOTHING = Places(np.zeros((0, 3)), np.zeros(0), np.zeros(0))
TRUE = np.array([-1.0, 2.0, 0.5])


def places(count: int, seed: int, weights: np.ndarray = TRUE) -> Places:
    """Places whose truth is drawn by known weights."""
    rng = np.random.default_rng(seed)
    terms = np.column_stack([np.ones(count), rng.normal(0, 2, (count, 2))])
    return Places(terms, (rng.random(count) < sigmoid(terms @ weights)).astype(float), np.ones(count))


def test_many_verdicts_give_the_weights_that_made_them() -> None:
    found = regress(places(20_000, 1), NOTHING, np.zeros(3))
    assert found == pytest.approx(TRUE, abs=0.1)


def test_without_verdicts_the_weights_stay() -> None:
    held = places(50, 2)
    told = Places(held.terms, sigmoid(held.terms @ TRUE), held.weight)
    assert regress(NOTHING, told, TRUE) == pytest.approx(TRUE, abs=1e-6)


def test_what_is_said_elsewhere_holds_the_weights_back() -> None:
    some, start = places(60, 3, -TRUE), TRUE
    rest = places(600, 4)
    told = Places(rest.terms, sigmoid(rest.terms @ start), rest.weight)
    free, held = regress(some, NOTHING, start), regress(some, told, start)
    assert np.linalg.norm(held - start) < 0.5 * np.linalg.norm(free - start)


def test_verdicts_that_agree_with_wrong_weights_no_more_are_judged_better() -> None:
    check = leave_one_out(places(80, 5), NOTHING, np.array([3.0, 0.0, 0.0]))
    assert check.better
    assert check.right[0] > check.right[1]


@pytest.mark.parametrize("seed", range(6))
def test_verdicts_by_the_shipped_weights_change_nothing(seed: int) -> None:
    assert not leave_one_out(places(40, seed), NOTHING, TRUE).better


def test_verdicts_by_chance_change_nothing() -> None:
    some = places(60, 7)
    coins = Places(some.terms, np.random.default_rng(8).integers(0, 2, 60).astype(float), some.weight)
    chance = leave_one_out(coins, NOTHING, np.zeros(3))
    assert not chance.better


def test_a_comparison_counts_both() -> None:
    check = compare(np.array([1.0, 1.0, -1.0]), np.array([1.0, -1.0, -1.0]), np.array([True, True, True]))
    assert check.right == (2, 1)
    assert check.loss[0] < check.loss[1]


def test_a_score_is_scaled_to_the_verdicts__and_too_few_scale_nothing() -> None:
    rng = np.random.default_rng(9)
    score = rng.uniform(0.5, 0.99, 200)
    truth = rng.random(200) < score**6
    check, (shift, _) = check_score(score, truth)
    assert check is not None and check.better
    assert shift < 0
    assert scaled(ScoreWeights(), 0.0, 1.0) == ScoreWeights()
    assert scaled(ScoreWeights(1.4, 0.3), -1.0, 2.0) == ScoreWeights(1.8, 0.6)
    assert check_score(score[: LEAST - 1], truth[: LEAST - 1])[0] is None


def test_weights_are_read_as_they_were_written__by_a_configuration_too(tmp_path: Path) -> None:
    weights = Weights(
        FITTED.surface,
        tuple(value + 0.125 for value in FITTED.cell),
        scaled(ScoreWeights(1.4, 0.3), 0.5, 1.5),
    )
    assert read_weights(write_weights(weights)) == weights
    path = tmp_path / "calibration.toml"
    path.write_text(f'[detect]\nmethod = "consensus"\nweights = {toml(write_weights(weights))}\n')
    detector = make_recipe(read_config(path)).detect
    assert detector.judged_by == weights  # type: ignore[union-attr]
    assert json.loads(write_weights(weights))["score"][0] == 2.6
