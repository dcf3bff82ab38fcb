"""The figures of the tables of sources, on inputs of which the answer is plain."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from benchmarks.accuracy.sources import isprs_figures, kinds_of, pieces_of
from benchmarks.accuracy.sources_tuning import parameters_of, table_of

from eaves.evaluate.detection_scores import evaluate_detection
from eaves.recipe.recipe import make_recipe, sources


def test_buildings_are_counted_by_what_they_are_made_of() -> None:
    frame = pd.DataFrame(
        {
            "method": ["maas_vosselman", "maas_vosselman", "plane_intersection", "prism", "maas_vosselman"],
            "primitives": [2, 3, np.nan, 1, 2],
            "primitives_by_moments": [2, 1, np.nan, 1, 0],
        }
    )
    assert kinds_of(frame) == "1/1/2/1"
    assert kinds_of(pd.DataFrame({"method": ["plane_intersection", "prism"]})) == "0/0/1/1"


def test_points_that_hang_together_are_a_piece_at_its_place() -> None:
    rng = np.random.default_rng(1)
    xy = np.vstack([rng.uniform(0.0, 10.0, (2000, 2)), rng.uniform(0.0, 6.0, (900, 2)) + 20.0])
    points = np.c_[xy + [85_000.0, 447_000.0], np.full(len(xy), 5.0)]
    areas = sorted(piece.area for piece in pieces_of(points))
    assert areas == pytest.approx([36.0, 100.0], rel=0.1)
    largest = max(pieces_of(points), key=lambda piece: piece.area)
    assert largest.centroid.coords[0] == pytest.approx((85_005.0, 447_005.0), abs=0.3)


def test_the_figures_of_the_benchmark_are_those_of_the_evaluation() -> None:
    reference = np.zeros((60, 60), int)
    reference[5:25, 5:25], reference[40:50, 5:55] = 1, 2
    result = np.where(reference == 1, 1, 0)
    result[40:50, 5:25], result[40:50, 35:55] = 2, 3  # one object in two pieces
    figures = isprs_figures(evaluate_detection(result, reference, 0.5))
    assert figures["area"] == "0.889/1.000/0.889"
    assert figures["1:1/1:M/N:1/N:M"] == "1/1/0/0"
    assert figures["objects ≥ 50 m²"] == "1.000/1.000/1.000"


@pytest.mark.parametrize("source", sources())
def test_every_number_of_a_source_can_be_varied__of_nested_methods_too(source: str) -> None:
    plain, varied = make_recipe(source=source), 0
    for stage, name, value in parameters_of(sources()[source]):
        try:
            recipe = make_recipe({stage: dict(table_of(name, value * 0.75))}, source=source)
        except ValueError:  # whole numbers
            continue
        changed = [one for one in sources()[source].methods if getattr(recipe, one) != getattr(plain, one)]
        assert changed == [stage], name
        varied += 1
    assert varied > 8
    if source == "maas_vosselman":
        assert ("reconstruct", "houses.tolerance", 0.2) in list(parameters_of(sources()[source]))
