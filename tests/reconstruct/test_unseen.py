"""Roofs of which a part shows no point: nothing over what was seen, the other side mirrored."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely

from eaves import Failure, RoofPlane, reconstruct_building, segment_roof
from eaves.model import BuildingModel, Footprint, Points
from eaves.reconstruct.toolkit.ceiling import highest_of, rise_over
from eaves.reconstruct.toolkit.unseen import mirrored_planes, unseen_places

LENGTH, WIDTH, SLOPE, EAVES, NOISE = 12.0, 8.0, 0.7, 3.0, 0.02
VOLUME = LENGTH * WIDTH * (EAVES + SLOPE * WIDTH / 4)
RIDGE = EAVES + SLOPE * WIDTH / 2
PLAN = Footprint(shapely.box(0, 0, LENGTH, WIDTH))


def gable_points(hidden: Callable[[Points], Any]) -> Points:
    """Points (N, 3) of a gable on a base of 0, less those that are hidden."""
    rng = np.random.default_rng(0)
    xy = rng.uniform((0, 0), (LENGTH, WIDTH), (1200, 2))
    z = EAVES + SLOPE * (WIDTH / 2 - np.abs(xy[:, 1] - WIDTH / 2)) + rng.normal(0, NOISE, len(xy))
    points = np.column_stack([xy, z])
    return points[~hidden(points)]


@pytest.mark.parametrize(
    "hidden",
    [
        pytest.param(lambda p: p[:, 1] > 4.0, id="a slope"),
        pytest.param(lambda p: (p[:, 1] > 4.0) & (p[:, 0] > 6.0), id="half a slope"),
        pytest.param(lambda p: (p[:, 1] > 3.0) & (p[:, 0] > 7.0), id="a corner"),
        pytest.param(lambda p: np.abs(p[:, 1] - 4.0) < 1.0, id="a strip along the ridge"),
    ],
)
def test_gable_with_a_part_unseen_stays_under_its_returns_and_has_its_volume(hidden: Any) -> None:
    points = gable_points(hidden)
    model = reconstruct_building(points, PLAN, segment_roof(points, spacing=0.3), ground=0.0)
    assert isinstance(model, BuildingModel)
    assert model.attributes["h_max"] <= points[:, 2].max() + 0.15
    assert model.attributes["volume_m3"] == pytest.approx(VOLUME, rel=0.1)


def test_other_slope_of_a_gable_seen_from_one_side_is_its_mirror_image_without_data() -> None:
    points = gable_points(lambda p: p[:, 1] > 4.0)
    model = reconstruct_building(points, PLAN, segment_roof(points, spacing=0.3), ground=0.0)
    assert isinstance(model, BuildingModel)
    faces = model.attributes["roof_faces"]
    assert model.attributes["roof_type"] == "gable"
    assert sorted(face["no_data"] for face in faces) == [False, True]
    assert [face["slope_deg"] for face in faces] == pytest.approx([np.degrees(np.arctan(SLOPE))] * 2, abs=1.0)


def test_whole_gable_has_no_unseen_place_and_no_mirrored_plane() -> None:
    points = gable_points(lambda p: p[:, 0] < 0.0)
    unseen = unseen_places(PLAN.polygon, points, 0.3)
    assert len(unseen) == 0
    planes = np.array([[0.0, SLOPE, EAVES], [0.0, 0.0, 4.0]])
    assert len(mirrored_planes(unseen, points, np.zeros(len(points), np.int32), planes, np.zeros(2))) == 0


def test_planes_may_rise_over_the_points_where_two_that_were_seen_meet_and_nowhere_else() -> None:
    points = gable_points(lambda p: np.abs(p[:, 1] - 4.0) < 0.3)
    labels = (points[:, 1] > 4.0).astype(np.int32)
    planes = np.array([[0.0, SLOPE, EAVES], [0.0, -SLOPE, EAVES + SLOPE * WIDTH], [0.0, 0.0, 4.0]])
    highest = highest_of(points, labels, planes, 0.45)
    assert highest.max() < RIDGE
    rise = rise_over(np.array([[6.0, 4.0], [6.0, 8.0]]), points, labels, planes, highest, 0.3)
    assert rise[0].tolist() == [0.0, 0.0, 0.0]
    assert rise[1, 0] > 2.0 and rise[1, 1] == 0.0


def test_one_return_far_off_does_not_decide_the_fit() -> None:
    points = gable_points(lambda p: p[:, 0] < 0.0)
    points[0] = 6.0, 4.0, 100_000.0
    model = reconstruct_building(points, PLAN, segment_roof(points, spacing=0.3), ground=0.0)
    assert isinstance(model, BuildingModel)
    assert model.attributes["rmse_m"] < 0.05
    assert model.attributes["h_max"] < RIDGE + 0.15


BOWTIE = shapely.Polygon([(0, 0), (12, 8), (12, 0), (0, 8)])


@pytest.mark.parametrize(
    ("changed", "error", "words"),
    [
        ({"planes": [RoofPlane((np.nan, 0.0, 3.0), np.arange(9), 0.0)]}, ValueError, "finite coefficients"),
        ({"planes": [RoofPlane((0.0, 0.0, 3.0), np.array([-3, 2]), 0.0)]}, ValueError, "-3 to 2"),
        ({"planes": [RoofPlane((0.0, 0.0, 3.0), np.array([5000]), 0.0)]}, ValueError, "5000 to 5000"),
        ({"planes": [RoofPlane((0.0, 0.0, 3.0), np.array([0.5]), 0.0)]}, ValueError, "integers"),
        ({"footprint": replace(PLAN, polygon=shapely.MultiPolygon([PLAN.polygon]))}, TypeError, "each part"),
        ({"footprint": replace(PLAN, polygon=BOWTIE)}, ValueError, "make_valid"),
        ({"footprint": replace(PLAN, polygon=shapely.Polygon())}, ValueError, "not empty"),
        ({"ground": -1e5}, ValueError, "within 2000 m"),
        ({"ground": float("nan")}, ValueError, "finite height"),
    ],
)
def test_argument_that_is_no_building_is_refused_in_one_sentence(
    changed: dict[str, Any], error: type[Exception], words: str
) -> None:
    points = gable_points(lambda p: p[:, 0] < 0.0)
    arguments: dict[str, Any] = {"footprint": PLAN, "planes": [], "ground": 0.0} | changed
    with pytest.raises(error, match=words) as caught:
        reconstruct_building(points, **arguments)
    assert "\n" not in str(caught.value)


def test_parts_of_a_bow_tie_are_modelled_as_the_message_says() -> None:
    points = gable_points(lambda p: p[:, 0] < 0.0)
    for part in shapely.make_valid(BOWTIE).geoms:
        model = reconstruct_building(points, Footprint(part), [], ground=0.0)
        assert not isinstance(model, Failure)
