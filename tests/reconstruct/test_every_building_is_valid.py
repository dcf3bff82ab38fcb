"""Whatever the footprint and the planes: a valid model, or a Failure with a reason."""

from __future__ import annotations

import numpy as np
import pytest

from eaves.model import Failure
from eaves.published.xiao2014.plane_intersection import PlaneIntersection
from eaves.reconstruct.arrangement import Arrangement
from eaves.reconstruct.prism import Prism
from eaves.validate.models import validate_model
from tests.conftest import but_first

from .made_buildings import make_building

METHODS = (Arrangement(), PlaneIntersection(), Prism())

LEAST_SHARE = 0.95
"""The arrangement models so much of what the prism models: failures must not become the rule."""

LEAST_MODELS = 0.5
"""Share of the buildings that have points and area enough for a prism."""


def assert_valid_or_failure(seed: int) -> dict[str, int]:
    """1 for each method that gave a model of one building, a valid one, and 0 for the others."""
    models = {}
    points, footprint, planes, ground = make_building(seed)
    before = points.copy()
    for method in METHODS:
        answer = method.model(points, footprint, planes, ground)
        models[method.name] = int(not isinstance(answer, Failure))
        if isinstance(answer, Failure):
            assert answer.reason
        else:
            assert not validate_model(answer), (seed, method.name)
    assert np.array_equal(points, before, equal_nan=True)
    return models


def assert_most_are_modelled(seeds: range) -> None:
    models = [assert_valid_or_failure(seed) for seed in seeds]
    prisms = sum(answer["prism"] for answer in models)
    assert prisms >= LEAST_MODELS * len(seeds)
    assert sum(answer["arrangement"] for answer in models) >= LEAST_SHARE * prisms


@pytest.mark.parametrize("first", but_first(range(0, 120, 40)))
def test_random_buildings_are_valid_or_say_why_not(first: int) -> None:
    assert_most_are_modelled(range(first, first + 40))


@pytest.mark.slow
@pytest.mark.parametrize("first", range(1000, 4000, 100))
def test_thousands_of_random_buildings_are_valid_or_say_why_not(first: int) -> None:
    assert_most_are_modelled(range(first, first + 100))
