"""The laws of every registered method, whatever its stage (docs/conventions.md, Laws)."""

from __future__ import annotations

import pickle
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from eaves.detect import Detector, detect_buildings
from eaves.ground import GroundMethod, classify_ground
from eaves.methods import REGISTRY, make_method, method_class
from eaves.model import Block, BuildingModel, Failure, Footprint, PointCloud
from eaves.model.cloud import GROUND
from eaves.outline import OutlineMethod, regularise_outlines, trace_outline
from eaves.raster import surfaces
from eaves.reconstruct import Reconstructor, reconstruct_building
from eaves.roof import RoofMethod, segment_roof
from eaves.simulate.objects.roofs import ExactScene

EVERY = [(stage, name) for stage, names in REGISTRY.items() for name in names]
MOVE = np.array([2000 * 240.0, -1000 * 240.0, 0.0])


def of_stage(stage: str) -> list[str]:
    return list(REGISTRY[stage])


@pytest.fixture(scope="module")
def cloud(nine_roofs: ExactScene) -> PointCloud:
    return nine_roofs.cloud.take(nine_roofs.cloud.canonical_order())


@pytest.fixture(scope="module")
def true_ground(nine_roofs: ExactScene) -> PointCloud:
    """The cloud with its true classes: what detectors are tested on, apart from any ground filter."""
    scene = nine_roofs
    order = scene.cloud.canonical_order()
    classes = np.where(scene.truth_class == GROUND, GROUND, 1).astype(np.uint8)
    if "given_classes" in REGISTRY["detect"]:
        classes[scene.truth_class == 6] = 6
    return scene.cloud.with_(classification=classes).take(order)


@pytest.fixture(scope="module")
def gable(nine_roofs: ExactScene) -> tuple[NDArray[np.float64], shapely.Polygon, float]:
    """Points, footprint and base of the scene's first gable house."""
    for number, building in enumerate(nine_roofs.buildings, 1):
        if building.kind == "gable":
            return nine_roofs.cloud.xyz[nine_roofs.building == number], building.footprint, building.base
    raise AssertionError("the scene has no gable")


def moved(cloud: PointCloud) -> PointCloud:
    """The same points, 480 km to the east and 240 km to the south."""
    world = cloud.xyz + [*cloud.origin, 0.0] + MOVE
    return PointCloud.from_world(
        world,
        return_number=cloud.return_number,
        number_of_returns=cloud.number_of_returns,
        classification=cloud.classification,
    )


@pytest.mark.parametrize(("stage", "name"), EVERY)
def test_a_method_is_a_value(stage: str, name: str) -> None:
    cls = method_class(stage, name)
    for method in (make_method(stage, name), cls.as_published()):
        assert pickle.loads(pickle.dumps(method)) == method
        assert method.model_dump_json()
        with pytest.raises(ValueError, match="frozen"):
            method.__setattr__(next(iter(cls.model_fields), "x"), 1)
    assert cls.name == name
    assert cls.stage == stage
    assert method.buffer >= 0


@pytest.mark.parametrize(("stage", "name"), EVERY)
def test_every_parameter_has_a_sentence_a_unit_and_a_range(stage: str, name: str) -> None:
    for key, field in method_class(stage, name).model_fields.items():
        extra = field.json_schema_extra
        assert field.description, key
        assert isinstance(extra, dict) and extra["unit"], key
        if field.annotation in (int, float):
            assert field.metadata, f"{key} has no range"


@pytest.mark.parametrize(("stage", "name"), EVERY)
def test_its_paper_is_in_the_references(stage: str, name: str) -> None:
    keys = re.findall(r"@\w+\{([^,]+),", Path("references.bib").read_text(encoding="utf-8"))
    cls = method_class(stage, name)
    assert cls.paper in keys
    assert "Fidelity" in (cls.__doc__ or "")


@pytest.mark.parametrize("name", of_stage("ground"))
def test_ground_does_not_depend_on_the_order_of_points(name: str, cloud: PointCloud) -> None:
    method = make_method("ground", name)
    assert isinstance(method, GroundMethod)
    shuffle = np.random.default_rng(1).permutation(len(cloud))
    straight = classify_ground(cloud, method).ground
    before = cloud.xyz.copy()
    assert np.array_equal(classify_ground(cloud.take(shuffle), method).ground, straight[shuffle])
    assert np.array_equal(cloud.xyz, before)
    assert straight.any()


@pytest.mark.parametrize("name", of_stage("ground"))
def test_ground_moves_with_the_data(name: str, cloud: PointCloud) -> None:
    method = make_method("ground", name)
    assert isinstance(method, GroundMethod)
    assert np.array_equal(classify_ground(moved(cloud), method).ground, classify_ground(cloud, method).ground)


@pytest.mark.parametrize("name", of_stage("detect"))
def test_detection_does_not_depend_on_the_order_of_points(name: str, true_ground: PointCloud) -> None:
    method = make_method("detect", name)
    assert isinstance(method, Detector)
    shuffle = np.random.default_rng(2).permutation(len(true_ground))
    straight = detect_buildings(scene_of(true_ground), method)
    shuffled = detect_buildings(scene_of(true_ground.take(shuffle)), method)
    assert np.array_equal(shuffled.label, straight.label[shuffle])
    assert straight.count > 0


@pytest.mark.parametrize("name", of_stage("detect"))
def test_detection_moves_with_the_data(name: str, true_ground: PointCloud) -> None:
    method = make_method("detect", name)
    assert isinstance(method, Detector)
    here, there = (
        detect_buildings(scene_of(true_ground), method),
        detect_buildings(scene_of(moved(true_ground)), method),
    )
    assert np.array_equal(here.label, there.label)


@pytest.mark.parametrize("name", of_stage("outline"))
def test_outline_does_not_depend_on_the_order_of_points(name: str, gable: Any) -> None:
    method = make_method("outline", name)
    assert isinstance(method, OutlineMethod)
    points = gable[0]
    first = outline_of(points, method)
    second = outline_of(np.random.default_rng(3).permutation(points), method)
    assert first is not None
    assert first == second
    assert first.is_valid
    assert first.exterior.is_ccw


@pytest.mark.parametrize("name", of_stage("outline"))
def test_outline_moves_with_the_points(name: str, gable: Any) -> None:
    method = make_method("outline", name)
    assert isinstance(method, OutlineMethod)
    here = outline_of(gable[0], method)
    there = outline_of(gable[0] + [24000.0, 12000.0, 0.0], method)
    back = shapely.transform(there, lambda xy: xy - [24000.0, 12000.0])
    assert shapely.hausdorff_distance(here, back) < 1e-3


@pytest.mark.parametrize("name", of_stage("roof"))
def test_planes_do_not_depend_on_the_order_of_points(name: str, gable: Any) -> None:
    method = make_method("roof", name)
    assert isinstance(method, RoofMethod)
    points = gable[0]
    shuffle = np.random.default_rng(4).permutation(len(points))
    straight, shuffled = segment_roof(points, 0.4, method), segment_roof(points[shuffle], 0.4, method)
    assert len(straight) == len(shuffled) > 0
    for one, other in zip(straight, shuffled, strict=True):
        assert np.array_equal(np.sort(shuffle[other.members]), one.members)
        assert np.allclose(one.coefficients, other.coefficients, atol=1e-9)


@pytest.mark.parametrize("name", of_stage("reconstruct"))
def test_a_model_moves_with_its_points(name: str, gable: Any) -> None:
    method = make_method("reconstruct", name)
    assert isinstance(method, Reconstructor)
    points, polygon, base = gable
    shift = np.array([2400.0, 1200.0, 0.0])
    here = reconstruct_building(points, Footprint(polygon), segment_roof(points, 0.4), base, method)
    far = shapely.transform(polygon, lambda xy: xy + shift[:2])
    there = reconstruct_building(
        points + shift, Footprint(far), segment_roof(points + shift, 0.4), base, method
    )
    assert isinstance(here, BuildingModel)
    assert isinstance(there, BuildingModel)
    assert here.solids.keys() == there.solids.keys()
    for lod, solids in here.solids.items():
        for one, other in zip(solids, there.solids[lod], strict=True):
            assert np.allclose(one.vertices + shift, other.vertices, atol=1.5e-3)


FEW: dict[str, NDArray[np.float64]] = {
    "none": np.zeros((0, 3)),
    "one": np.array([[1.0, 2.0, 3.0]]),
    "two": np.array([[1.0, 2.0, 3.0], [2.0, 2.0, 3.0]]),
    "collinear": np.column_stack([np.linspace(0, 20, 40), np.linspace(0, 10, 40), np.full(40, 5.0)]),
    "duplicate": np.repeat([[1.0, 2.0, 3.0]], 30, axis=0),
    "three places": np.repeat(np.eye(3), 4, axis=0),
    "not a number": np.array([[np.nan, 1.0, 2.0], [1.0, np.nan, 2.0], [1.0, 1.0, np.nan], [1.0, 1.0, 1.0]]),
}


@pytest.mark.parametrize("few", FEW)
@pytest.mark.parametrize(("stage", "name"), EVERY)
def test_hard_points_give_a_result_or_a_failure(stage: str, name: str, few: str) -> None:
    points, method = FEW[few], make_method(stage, name)
    if isinstance(method, GroundMethod):
        assert len(classify_ground(PointCloud(points), method).ground) == len(points)
    elif isinstance(method, Detector):
        classified = classify_ground(PointCloud(points))
        if np.isfinite(points).all() and len(points):
            assert len(detect_buildings(scene_of(classified), method).label) == len(points)
    elif isinstance(method, OutlineMethod):
        boundary = trace_outline(points, 0.5, method)
        assert isinstance(boundary, Failure) or regularise_outlines([boundary], method)
    elif isinstance(method, RoofMethod):
        assert len(segment_roof(points, 0.5, method)) <= 1
    elif isinstance(method, Reconstructor):
        finite = points[np.isfinite(points).all(axis=1)]
        result = reconstruct_building(
            finite, Footprint(shapely.box(0, 0, 5, 5)), segment_roof(finite, 0.5), 0.0, method
        )
        assert isinstance(result, BuildingModel | Failure)


def scene_of(classified: PointCloud) -> Any:
    """A scene over the block that holds the points."""
    return surfaces.scene_of(classified, Block(0, 0).bounds)


def outline_of(points: NDArray[np.float64], method: OutlineMethod) -> Any:
    """The polygon of a region's points, None for a failure."""
    boundary = trace_outline(points, 0.4, method)
    if isinstance(boundary, Failure):
        return None
    footprint = regularise_outlines([boundary], method)[0]
    return None if isinstance(footprint, Failure) else footprint.polygon
