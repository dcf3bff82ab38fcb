"""The weights of the detector are a file that a configuration names."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from eaves.cli.runs import read_config
from eaves.detect.consensus.classifier import FITTED, ScoreWeights, Weights, read_weights
from eaves.recipe.recipe import make_recipe

WEIGHTS = Weights(FITTED.surface, tuple(value + 0.125 for value in FITTED.cell), ScoreWeights(1.4, 0.3))


def written(weights: Weights) -> str:
    return json.dumps(
        {"surface": weights.surface, "cell": weights.cell, "score": list(vars(weights.score).values())}
    )


def test_a_configuration_gives_weights_as_text_or_as_a_file(tmp_path: Path) -> None:
    (tmp_path / "weights.json").write_text(written(WEIGHTS), encoding="utf-8")
    path = tmp_path / "run.toml"
    for given in (written(WEIGHTS), (tmp_path / "weights.json").as_posix()):
        path.write_text(f"[detect]\nmethod = \"consensus\"\nweights = '{given}'\n", encoding="utf-8")
        assert make_recipe(read_config(path)).detect.judged_by == WEIGHTS  # type: ignore[union-attr]


def test_weights_of_another_length_are_refused() -> None:
    with pytest.raises(ValueError, match="fit them again"):
        read_weights(written(Weights(FITTED.surface[:-1], FITTED.cell)))
