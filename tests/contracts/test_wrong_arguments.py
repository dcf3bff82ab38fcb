"""Wrong types and empty inputs raise one sentence that names the argument and the remedy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import shapely

import eaves
from eaves.evaluate import evaluate_detection, evaluate_footprints, evaluate_ground, label_objects
from eaves.methods import method_class
from eaves.model import Bounds, Failure, Footprint, PointCloud
from eaves.validate import fit_to_points, validate_model

XYZ = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [1.0, 1.0, 1.0]])
CLOUD = PointCloud(XYZ, classification=np.full(4, 1, np.uint8))
BOUNDS = Bounds(0.0, 0.0, 2.0, 2.0)
SHED = Footprint(shapely.box(0, 0, 1, 1))

WRONG: dict[str, tuple[Callable[[], Any], type[Exception], str]] = {
    "cloud of words": (lambda: PointCloud([["a", "b", "c"]]), TypeError, "xyz must be numbers"),
    "cloud of rows of several lengths": (lambda: PointCloud([[0.0], [1.0, 2.0]]), TypeError, "xyz must be"),
    "cloud without z": (lambda: PointCloud(XYZ[:, :2]), ValueError, r"shape \(N, 3\), not \(4, 2\)"),
    "cloud of one row": (lambda: PointCloud(XYZ[0]), ValueError, r"shape \(N, 3\), not \(3,\)"),
    "classes of other points": (
        lambda: PointCloud(XYZ, classification=np.zeros(3, np.uint8)),
        ValueError,
        r"classification must have the shape \(4,\)",
    ),
    "world coordinates without z": (lambda: PointCloud.from_world(XYZ[:, :2]), ValueError, r"\(N, 3\)"),
    "bounds of no points": (lambda: PointCloud(XYZ[:0]).bounds, ValueError, "has no points"),
    "ground of an array": (lambda: eaves.classify_ground(XYZ), TypeError, "cloud must be a PointCloud"),
    "ground with a detector": (
        lambda: eaves.classify_ground(CLOUD, eaves.Consensus()),
        TypeError,
        "a ground method is wanted",
    ),
    "ground by number": (lambda: eaves.classify_ground(CLOUD, 3), TypeError, "see `eaves methods ground`"),
    "ground by unknown name": (lambda: eaves.classify_ground(CLOUD, "csf"), ValueError, "choose one of"),
    "unknown parameter": (
        lambda: eaves.classify_ground(CLOUD, {"windwo": 3}),
        ValueError,
        "unknown parameter 'windwo'",
    ),
    "misspelt parameter": (
        lambda: eaves.Consensus(min_hight=2.0),
        ValueError,
        "did you mean 'min_height'. it has: ",
    ),
    "parameter out of range": (
        lambda: eaves.Consensus(min_height=-2.0),
        ValueError,
        "parameter 'min_height' of detect method 'consensus': .* equal to 0, not -2.0; see",
    ),
    "parameter of another type": (
        lambda: eaves.make_recipe({"roof": {"price": "low"}}),
        ValueError,
        "parameter 'price' of roof method 'global_refinement': .* number.*, not 'low'",
    ),
    "terrain without ground": (lambda: eaves.make_dtm(CLOUD, BOUNDS), ValueError, "must have ground points"),
    "terrain without classes": (
        lambda: eaves.make_dtm(PointCloud(XYZ), BOUNDS),
        ValueError,
        r"call classify_ground\(cloud\) first",
    ),
    "scene without ground": (lambda: eaves.make_scene(CLOUD, BOUNDS), ValueError, "must have ground points"),
    "raster over words": (lambda: eaves.make_dsm(CLOUD, "all"), TypeError, "bounds must be a Bounds"),
    "raster over NaN bounds": (
        lambda: eaves.make_dsm(CLOUD, Bounds(0.0, 0.0, np.nan, 2.0)),
        ValueError,
        "finite metres",
    ),
    "raster of no cell": (
        lambda: eaves.make_dsm(CLOUD, BOUNDS, cell=0.0),
        ValueError,
        "cell must be above 0",
    ),
    "regions of an array": (lambda: eaves.detect_buildings(XYZ), TypeError, "scene must be a Scene"),
    "regions of a cloud without classes": (
        lambda: eaves.detect_buildings(CLOUD),
        ValueError,
        "call classify_ground",
    ),
    "outline of words": (lambda: eaves.trace_outline([["x"]], 0.5), TypeError, "points must be"),
    "outline in two columns": (lambda: eaves.trace_outline(XYZ[:, :2], 0.5), ValueError, r"\(N, 3\)"),
    "outline of no spacing": (lambda: eaves.trace_outline(XYZ, 0.0), ValueError, "spacing must be above 0"),
    "outline of a failure": (
        lambda: eaves.regularise_outlines([Failure("too_few_points", "")]),
        TypeError,
        r"boundaries\[0\] must be a Boundary",
    ),
    "roof of NaN spacing": (lambda: eaves.segment_roof(XYZ, np.nan), ValueError, "spacing must be above 0"),
    "model without footprint": (
        lambda: eaves.reconstruct_building(XYZ, None, [], 0.0),
        TypeError,
        "footprint must be a Footprint, not None",
    ),
    "model on no ground": (
        lambda: eaves.reconstruct_building(XYZ, SHED, [], float("nan")),
        ValueError,
        "ground must be a finite height",
    ),
    "validity of a failure": (lambda: validate_model(Failure("no_plane", "")), TypeError, "must be a Buil"),
    "fit to a failure": (lambda: fit_to_points(Failure("no_plane", ""), XYZ), TypeError, "must be a Buil"),
    "masks of two sizes": (
        lambda: evaluate_ground(np.ones(3, bool), np.ones(2, bool)),
        ValueError,
        "compared",
    ),
    "images of two sizes": (
        lambda: evaluate_detection(np.ones((2, 2), int), np.ones((2, 3), int), 0.5),
        ValueError,
        "result and reference must have the same shape",
    ),
    "labels of a row": (lambda: label_objects(np.ones(3, bool)), ValueError, r"\(H, W\)"),
    "ids of other polygons": (
        lambda: evaluate_footprints([shapely.box(0, 0, 1, 1)], [], result_ids=[]),
        ValueError,
        "result_ids must be one id for each of 1 polygons",
    ),
    "no processes": (lambda: eaves.build("a.laz", "out", jobs=-1), ValueError, "must be 0 or more"),
    "jobs as text": (lambda: eaves.build("a.laz", "out", jobs="two"), ValueError, "valid integer"),
    "three bounds": (
        lambda: eaves.build("a.laz", "out", bounds=(0.0, 0.0, 1.0)),
        ValueError,
        "bounds.*: not four numbers",
    ),
    "unknown level": (lambda: eaves.build("a.laz", "out", lod="3"), ValueError, "unknown level of detail"),
    "unknown option": (lambda: eaves.build("a.laz", "out", tiles=3), TypeError, "unknown option 'tiles'"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_argument_raises_one_sentence(case: str) -> None:
    call, error, words = WRONG[case]
    with pytest.raises(error, match=words) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_no_points_give_no_points() -> None:
    assert len(eaves.classify_ground(PointCloud(np.zeros((0, 3))))) == 0
    assert eaves.segment_roof(np.zeros((0, 3)), 0.5) == []


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_few_points_have_no_outline_and_a_reason(count: int) -> None:
    result = eaves.trace_outline(XYZ[:count], 0.5)
    assert isinstance(result, Failure)
    assert result.code == "too_few_points"
    assert f"{count} points" in result.reason


def test_points_without_coordinates_are_left_out_of_a_model() -> None:
    x, y = np.meshgrid(np.arange(0.25, 8, 0.5), np.arange(0.25, 6, 0.5))
    roof = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 5.0)])
    holed = np.insert(roof, 7, np.nan, axis=0)
    footprint = Footprint(shapely.box(0, 0, 8, 6))
    models = [
        eaves.reconstruct_building(points, footprint, eaves.segment_roof(points, 0.5), 0.0)
        for points in (roof, holed)
    ]
    one, other = (model.solids["2.2"][0].vertices for model in models if model)
    assert np.array_equal(one, other)


def test_a_method_of_an_unknown_name_is_refused_in_one_line() -> None:
    with pytest.raises(ValueError, match="unknown detect method") as refusal:
        method_class("detect", "contours\n[outline]\n")
    assert "\n" not in str(refusal.value)
