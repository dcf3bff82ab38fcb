"""The laws of every method, whatever its stage and whoever wrote it (docs/conventions.md, Laws)."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.detect import detect_buildings
from eaves.ground import classify_ground
from eaves.methods import CONTRACTS, Method, check_contract
from eaves.model import (
    BUILDING,
    GROUND,
    UNCLASSIFIED,
    Block,
    BuildingModel,
    Failure,
    Footprint,
    PointCloud,
    Points,
    Scene,
)
from eaves.model.checks import error_line
from eaves.model.cloud import canonical_order
from eaves.outline import regularise_outlines, trace_outline
from eaves.raster import scene_of
from eaves.reconstruct import reconstruct_building
from eaves.roof import segment_roof
from eaves.simulate import ExactBuilding, ExactScene, coloured, nine_roofs_on_a_slope
from eaves.units import divide_block

MOVE, FARTHER = np.array([10 * 240.0, -5 * 240.0, 0.0]), 200
"""Whole blocks (m) by which the points of a building are moved, and clouds as many times as far."""
SPACING, CLOSE, NEARLY = 0.4, 1e-9, 1.5e-3
"""Spacing (m) of the points of a building here; differences (m) that arithmetic makes, and that the rounding
of places makes where points are moved."""
FEW: dict[str, Points] = {
    "none": np.zeros((0, 3)),
    "one": np.array([[1.0, 2.0, 3.0]]),
    "two": np.array([[1.0, 2.0, 3.0], [2.0, 2.0, 3.0]]),
    "collinear": np.column_stack([np.linspace(0, 20, 40), np.linspace(0, 10, 40), np.full(40, 5.0)]),
    "duplicate": np.repeat([[1.0, 2.0, 3.0]], 30, axis=0),
    "three places": np.repeat(np.eye(3), 4, axis=0),
    "not a number": np.array([[np.nan, 1.0, 2.0], [1.0, np.nan, 2.0], [1.0, 1.0, np.nan], [1.0, 1.0, 1.0]]),
}
"""Points with hardly anything to see."""

Arrays = list[NDArray[Any]]
Order = slice | NDArray[np.int64]
ASIS = slice(None)


def check_method(method: type[Method] | Method, scene: ExactScene | None = None) -> None:
    """Hold a method to the laws of its stage: silence is success.

    It is a value (frozen, picklable, as JSON), each parameter has a sentence, a unit and a range; it returns
    what its contract says, the same again for the same points in any order, and for points that are moved by
    whole blocks; it writes to no input, and takes 0, 1, 2, collinear, duplicate and missing points.

    Parameters
    ----------
    method : type of Method or Method
        The method, or its class with default parameters.
    scene : ExactScene or None
        A scene of `eaves.simulate` in which the method finds something; None is nine roofs on a slope.

    Raises
    ------
    AssertionError
        When a law is broken; it names law and method.
    ContractError
        When it is no method, or returns what its contract does not allow.

    Examples
    --------
    >>> import eaves
    >>> from eaves.testing import check_method
    >>> check_method(eaves.RegionGrowing)
    """
    made = method if isinstance(method, Method) else method()
    for law in LAWS:
        law(made, scene or default_scene())


@cache
def default_scene() -> ExactScene:
    """Nine roofs on a slope, with colours and intensity."""
    return coloured(nine_roofs_on_a_slope(density=6.0, noise=0.02, seed=3))


def require(held: bool, method: Method, law: str) -> None:
    """Raise AssertionError with a law that a method breaks."""
    assert held, f"{method.stage} method '{method.name}' breaks a law: {law}"


def is_a_value(method: Method, scene: ExactScene) -> None:
    """Law: a method is frozen, picklable and as JSON; it reaches some metres; parameters are declared."""
    cls = type(method)
    check_contract(method.stage, cls)
    require(pickle.loads(pickle.dumps(method)) == method, method, "it equals what its pickle gives")
    require(bool(method.model_dump_json()), method, "it can be written as JSON")
    require(bool(cls.model_config.get("frozen")), method, "it is frozen")
    require(method.buffer >= 0.0, method, "its buffer is 0 m or more")
    for name, field in cls.model_fields.items():
        extra = field.json_schema_extra
        declared = bool(field.description) and isinstance(extra, dict) and bool(extra.get("unit"))
        require(declared, method, f"parameter '{name}' has a sentence and a unit, by eaves.methods.parameter")
        ranged = field.annotation not in (int, float) or bool(field.metadata)
        require(ranged, method, f"parameter '{name}' has a range: ge, gt, le, lt")


def is_the_same_again(method: Method, scene: ExactScene) -> None:
    """Law: the same points, in any order, give the same, and something."""
    answer, still = ANSWERS[method.stage], np.zeros(3)
    straight = answer(method, scene, ASIS, still)
    found = any(bool(one.any()) for one in straight)
    require(found, method, "it finds something in the scene; pass another scene to check_method")
    again = answer(method, scene, ASIS, still)
    require(agree(straight, again, 0.0), method, "the same points give the same again")
    shuffled = answer(method, scene, np.random.default_rng(1).permutation(len(scene.cloud)), still)
    require(agree(straight, shuffled, CLOSE), method, "points in another order give the same")


def moves_with_its_points(method: Method, scene: ExactScene) -> None:
    """Law: points that are moved by whole blocks give the same, moved."""
    answer = ANSWERS[method.stage]
    way = MOVE * FARTHER if method.stage in ("ground", "detect") else MOVE
    here, there = (answer(method, scene, ASIS, shift) for shift in (np.zeros(3), way))
    require(agree(here, there, NEARLY), method, "points moved by whole blocks give the same, moved")


def writes_to_no_input(method: Method, scene: ExactScene) -> None:
    """Law: what a method is given is after it as before."""
    arguments, rng = ARGUMENTS[method.stage](scene), [np.random.default_rng(0)] * (method.stage == "roof")
    before = pickle.dumps(arguments)
    getattr(method, CONTRACTS[method.stage][1])(*arguments, *rng)
    require(pickle.dumps(arguments) == before, method, "it writes to nothing that it is given")


def takes_few_points(method: Method, scene: ExactScene) -> None:
    """Law: points with hardly anything to see raise nothing."""
    for name, points in FEW.items():
        try:
            result_of_few(method, points)
        except Exception as error:
            require(False, method, f"points ({name}) raise nothing; they raised {error_line(error)}")


LAWS = (is_a_value, is_the_same_again, moves_with_its_points, writes_to_no_input, takes_few_points)
"""In the order in which `check_method` holds a method to them."""


def agree(one: Arrays, other: Arrays, tolerance: float) -> bool:
    """True if two results are the same but for a tolerance (m)."""
    shapes = [array.shape for array in one] == [array.shape for array in other]
    return shapes and all(np.allclose(a, b, 0.0, tolerance) for a, b in zip(one, other, strict=True))


def put_back(values: NDArray[Any], order: Order) -> NDArray[Any]:
    """Values of points that came in an order, in that of the scene."""
    back = np.empty_like(values)
    back[order] = values
    return back


def moved_cloud(cloud: PointCloud, order: Order, shift: Points) -> PointCloud:
    """The points of a cloud in another order, moved (m)."""
    cloud = cloud.take(np.arange(len(cloud))[order])
    names = ("return_number", "number_of_returns", "classification")
    arrays: dict[str, Any] = {name: getattr(cloud, name) for name in names} | {"fields": cloud.fields}
    return PointCloud.from_world(cloud.xyz + [*cloud.origin, 0.0] + shift, **arrays)


def true_scene(scene: ExactScene, order: Order = ASIS, shift: Points | None = None) -> Scene:
    """A detector's scene with the true ground, and the true buildings as the file's classes."""
    shift = np.zeros(3) if shift is None else shift
    truth = np.isin(scene.truth_class, (GROUND, BUILDING))
    classes = np.where(truth, scene.truth_class, UNCLASSIFIED).astype(np.uint8)
    cloud = moved_cloud(scene.cloud.with_(classification=classes), order, shift)
    return scene_of(cloud, Block(0, 0).bounds)


def house_of(scene: ExactScene) -> tuple[ExactBuilding, NDArray[np.int64]]:
    """The first gable house of a scene, or the first building of all, with the numbers (K,) of its points."""
    house = next((one for one in scene.buildings if one.kind == "gable"), scene.buildings[0])
    return house, np.flatnonzero(scene.building == house.number)


def house_points(scene: ExactScene, order: Order, shift: Points) -> tuple[Points, NDArray[np.int64]]:
    """The points (K, 3) of the house, in another order and moved (m), and that order (K,)."""
    _, members = house_of(scene)
    rank = np.argsort(put_back(np.arange(len(scene.cloud)), order)[members])
    return scene.cloud.xyz[members[rank]] + shift, rank


def ground_of(method: Any, scene: ExactScene, order: Order, shift: Points) -> Arrays:
    """The ground that a filter finds."""
    cloud = moved_cloud(scene.cloud, order, shift)
    return [put_back(classify_ground(cloud, method).ground, order)]


def regions_of(method: Any, scene: ExactScene, order: Order, shift: Points) -> Arrays:
    """The regions that a detector finds."""
    return [put_back(detect_buildings(true_scene(scene, order, shift), method).label, order)]


def outline_of(method: Any, scene: ExactScene, order: Order, shift: Points) -> Arrays:
    """The corners of the outline of the house; none for a Failure."""
    boundary = trace_outline(house_points(scene, order, shift)[0], SPACING, method)
    drawn = [] if isinstance(boundary, Failure) else regularise_outlines([boundary], method)
    return [shapely.get_coordinates(one.polygon) - shift[:2] for one in drawn if isinstance(one, Footprint)]


def units_of(method: Any, scene: ExactScene, order: Order, shift: Points) -> Arrays:
    """The corners of the units of the house."""
    points, _ = house_points(scene, order, shift)
    house, _ = house_of(scene)
    outline = shapely.transform(house.footprint, lambda xy: xy + shift[:2])
    parts = divide_block(points, points[:, 2] - house.base, outline, SPACING, method).parts
    return [shapely.get_coordinates(part) - shift[:2] for part in parts]


def planes_of(method: Any, scene: ExactScene, order: Order, shift: Points) -> Arrays:
    """The members of each roof plane of the house, and its heights over three points."""
    points, rank = house_points(scene, order, shift)
    corners = np.column_stack([scene.cloud.xyz[:3, :2] + shift[:2], np.ones(3)])
    planes = segment_roof(points, SPACING, method)
    heights = [corners @ np.array(plane.coefficients) for plane in planes]
    return [*(np.sort(rank[plane.members]) for plane in planes), *heights]


def model_of(method: Any, scene: ExactScene, order: Order, shift: Points) -> Arrays:
    """The corners of the solids of the house, level by level."""
    points, _ = house_points(scene, order, shift)
    house, _ = house_of(scene)
    footprint = Footprint(shapely.transform(house.footprint, lambda xy: xy + shift[:2]))
    planes = segment_roof(points, SPACING)
    model = reconstruct_building(points, footprint, planes, house.base, method)
    solids = model.solids.items() if isinstance(model, BuildingModel) else ()
    return [solid.vertices - shift for _, parts in sorted(solids) for solid in parts]


ANSWERS: dict[str, Callable[[Any, ExactScene, Order, Points], Arrays]] = {
    "ground": ground_of,
    "detect": regions_of,
    "outline": outline_of,
    "units": units_of,
    "roof": planes_of,
    "reconstruct": model_of,
}
"""Stage → the result of a method on a scene whose points come in another order and are moved (m), as arrays
put back into the order and to the place of the scene."""


def house_arguments(scene: ExactScene) -> tuple[ExactBuilding, Points]:
    """The house and its points in canonical order, as methods are given them."""
    house, members = house_of(scene)
    points = scene.cloud.xyz[members]
    return house, points[canonical_order(points)]


def model_arguments(scene: ExactScene) -> tuple[Any, ...]:
    """The arguments of a reconstructor."""
    house, points = house_arguments(scene)
    return points, Footprint(house.footprint), segment_roof(points, SPACING), house.base


def unit_arguments(scene: ExactScene) -> tuple[Any, ...]:
    """The arguments of a method that divides blocks."""
    house, points = house_arguments(scene)
    return points, points[:, 2] - house.base, house.footprint, SPACING


ARGUMENTS: dict[str, Callable[[ExactScene], tuple[Any, ...]]] = {
    "ground": lambda scene: (scene.cloud.with_(classification=None).in_canonical_order(),),
    "detect": lambda scene: (true_scene(scene, scene.cloud.canonical_order()),),
    "outline": lambda scene: (house_arguments(scene)[1], SPACING),
    "units": unit_arguments,
    "roof": lambda scene: (house_arguments(scene)[1], SPACING),
    "reconstruct": model_arguments,
}
"""Stage → the arguments of the first function of its contract, but for random numbers."""


def result_of_few(method: Any, points: Points) -> None:
    """Run a method on a few points (N, 3)."""
    finite = points[np.isfinite(points).all(axis=1)]
    cloud = PointCloud(points, fields={name: np.zeros(len(points)) for name in method.needs})
    if method.stage == "ground":
        classify_ground(cloud, method)
    elif method.stage == "detect" and len(finite):
        known = cloud.take(np.flatnonzero(np.isfinite(points).all(axis=1)))
        detect_buildings(scene_of(classify_ground(known), Block(0, 0).bounds), method)
    elif method.stage == "outline":
        boundary = trace_outline(points, 0.5, method)
        if not isinstance(boundary, Failure):
            regularise_outlines([boundary], method)
    elif method.stage == "units":
        divide_block(points, points[:, 2], shapely.box(0, 0, 5, 5), 0.5, method)
    elif method.stage == "roof":
        segment_roof(points, 0.5, method)
    elif method.stage == "reconstruct":
        planes = segment_roof(finite, 0.5)
        reconstruct_building(finite, Footprint(shapely.box(0, 0, 5, 5)), planes, 0.0, method)
