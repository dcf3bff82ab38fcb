"""The ground of a block: classes of the ground stage, found with its surroundings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eaves.blocks.large import large_objects
from eaves.ground import classify_ground
from eaves.ground.toolkit.wide_objects import Patch, WideObjects
from eaves.model import Block, Bounds, PointCloud
from eaves.model.cloud import GROUND as GROUND_CLASS
from eaves.model.cloud import UNCLASSIFIED
from eaves.run.clock import Clock
from eaves.run.points import PointWindow
from eaves.run.store import SECONDS
from eaves.run.world_squares import WIDE_SQUARE, around_squares

if TYPE_CHECKING:
    from eaves.recipe.recipe import Recipe


def seen_from(bounds: Bounds, recipe: Recipe, side: float) -> Bounds:
    """World metres of the points that decide the ground of the blocks of a side (m) within `bounds`."""
    blocks = around_squares(bounds, side).buffered(recipe.ground.buffer)
    if not recipe.sees_wide:
        return blocks
    return around_squares(blocks, WIDE_SQUARE).buffered(recipe.ground.wide_buffer)


@dataclass(frozen=True, eq=False)
class GroundView:
    """All that decides the ground of a block: its points with those around, the numbers (K,) in its files of
    those inside, and the large objects near them."""

    block: Block
    cloud: PointCloud
    number: NDArray[np.int32]
    large: WideObjects | None


def see_ground(
    block: Block, points: PointWindow, large: Mapping[Block, tuple[Patch, ...]], parameters: Any
) -> GroundView:
    """View of a block from which its ground is computed."""
    objects = None
    if parameters.sees_wide:
        bounds = block.bounds.buffered(parameters.ground.buffer)
        patches = large_objects(large).patches
        objects = WideObjects(tuple(patch.cropped(bounds.buffered(patch.cell)) for patch in patches))
    return GroundView(block, points.cloud, points.inside, objects)


def classify_block(seen: GroundView, parameters: Any) -> dict[str, NDArray[Any]]:
    """Classes and, where the filter finds them, parts of a block's points, in the order of its files."""
    clock = Clock()
    core = Bounds(0.0, 0.0, seen.block.side, seen.block.side)
    results = classify_inside(seen.cloud, core, seen.large, parameters)
    arrays: dict[str, NDArray[Any]] = {}
    for name, values in zip(("class", "part"), results, strict=True):
        if values is not None:
            arrays[name] = np.empty_like(values)
            arrays[name][seen.number] = values
    clock.lap("ground")
    return arrays | {SECONDS: np.array(clock.laps["ground"])}


def classify_inside(
    cloud: PointCloud, core: Bounds, wide: WideObjects | None, recipe: Recipe
) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """The classes of the points (K,) inside a block, and the parts the filter found on the way."""
    inside = np.flatnonzero(core.contains(cloud.xyz))
    if recipe.use_classes:
        cloud = with_ground_classes(cloud, recipe.ground_classes)
    if len(inside) == 0:
        return np.zeros(0, np.uint8), None
    classified = classify_ground(cloud, recipe.ground, use_classes=recipe.use_classes, wide=wide, core=core)
    assert classified.classification is not None
    return classified.classification[inside], None if classified.part is None else classified.part[inside]


def with_ground_classes(cloud: PointCloud, numbers: tuple[int, ...]) -> PointCloud:
    """The cloud whose file means ground by these classes: they become 2, and a 2 that is none of them 1."""
    classes_of_file = cloud.classification
    if classes_of_file is None or numbers == (GROUND_CLASS,):
        return cloud
    classes = np.where(classes_of_file == GROUND_CLASS, np.uint8(UNCLASSIFIED), classes_of_file)
    classes[np.isin(classes_of_file, numbers)] = GROUND_CLASS
    return cloud.with_(classification=classes)
