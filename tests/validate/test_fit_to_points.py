"""The fit of a model to its points, on a shed roof whose distances are known."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from eaves.geometry.face_table import roof_point_mask
from eaves.model import BuildingModel, Face, Footprint, Solid
from eaves.validate import fit_to_points, validate_model

SLOPE = 0.75  # 3:4:5, so the cosine is 0.8
CORNERS = np.array(
    [[0, 0, 0], [4, 0, 0], [4, 8, 0], [0, 8, 0], [0, 0, 3], [4, 0, 6], [4, 8, 6], [0, 8, 3]], float
)
FACES = (
    Face(((0, 3, 2, 1),), "GroundSurface"),
    Face(((4, 5, 6, 7),), "RoofSurface"),
    Face(((0, 1, 5, 4),), "WallSurface"),
    Face(((1, 2, 6, 5),), "WallSurface"),
    Face(((2, 3, 7, 6),), "WallSurface"),
    Face(((3, 0, 4, 7),), "WallSurface"),
)
SHED = BuildingModel(Footprint(shapely.box(0, 0, 4, 8), id="shed"), {"2.2": (Solid.of(CORNERS, FACES),)})


def roof_points(lift: float = 0.0) -> np.ndarray:
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0.5, 4), np.arange(0.5, 8)))
    return np.stack([x, y, 3 + SLOPE * x + lift], axis=1)


def test_the_shed_is_valid() -> None:
    assert validate_model(SHED) == []


def test_points_on_the_roof_have_no_distance() -> None:
    fit = fit_to_points(SHED, roof_points())
    assert fit is not None
    assert (fit.points, fit.missed, fit.within_01) == (32, 0.0, 1.0)
    assert fit.rmse == pytest.approx(0, abs=1e-12)


def test_a_lift_counts_along_the_normal() -> None:
    fit = fit_to_points(SHED, roof_points(0.2))
    assert fit is not None
    assert fit.rmse == pytest.approx(0.16) and fit.median == pytest.approx(0.16)
    assert (fit.within_01, fit.within_02) == (0.0, 1.0)


def test_points_outside_the_footprint_do_not_count() -> None:
    fit = fit_to_points(SHED, np.vstack([roof_points(), [[9.0, 9.0, 9.0]]]))
    assert fit is not None and fit.points == 32


def test_wall_points_under_the_roof_do_not_count() -> None:
    top = roof_points()
    assert roof_point_mask(np.vstack([top, top - [0, 0, 1.0]])).tolist() == [True] * 32 + [False] * 32


def test_a_model_without_a_roof_misses_every_point() -> None:
    bare = SHED.with_(solids={"2.2": ()})
    fit = fit_to_points(bare, roof_points())
    assert fit is not None and (fit.missed, fit.rmse) == (1.0, 1.0)


@pytest.mark.parametrize("count", [0, 1])
def test_few_points_give_a_fit_or_none(count: int) -> None:
    fit = fit_to_points(SHED, roof_points()[:count])
    assert (fit is None) == (count == 0)
