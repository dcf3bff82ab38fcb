"""Whatever the footprint and the planes: a valid model, or a Failure with a reason."""

from __future__ import annotations

import numpy as np
import pytest

from eaves.model import Failure
from eaves.reconstruct.arrangement import Arrangement
from eaves.reconstruct.plane_intersection import PlaneIntersection
from eaves.reconstruct.prism import Prism
from eaves.validate.models import validate_model

from .made_buildings import make_building


def assert_valid_or_failure(seed: int) -> None:
    points, footprint, planes, ground = make_building(seed)
    before = points.copy()
    for method in (Arrangement(), PlaneIntersection(), Prism()):
        answer = method.model(points, footprint, planes, ground)
        if isinstance(answer, Failure):
            assert answer.reason
        else:
            assert not validate_model(answer), (seed, method.name)
    assert np.array_equal(points, before, equal_nan=True)


@pytest.mark.parametrize("first", range(0, 120, 20))
def test_random_buildings_are_valid_or_say_why_not(first: int) -> None:
    for seed in range(first, first + 20):
        assert_valid_or_failure(seed)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(1000, 4000, 100))
def test_thousands_of_random_buildings_are_valid_or_say_why_not(first: int) -> None:
    for seed in range(first, first + 100):
        assert_valid_or_failure(seed)
