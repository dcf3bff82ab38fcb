"""The ground of a block: classes of the ground stage, found with its surroundings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eaves.blocks.wide import load_wide
from eaves.ground import classify_ground
from eaves.ground.toolkit.wide_objects import WideObjects
from eaves.model import Bounds, PointCloud
from eaves.model.cloud import GROUND as GROUND_CLASS
from eaves.model.cloud import UNCLASSIFIED
from eaves.run.clock import Clock
from eaves.run.keys import GROUND
from eaves.run.store import SECONDS, Store, Task
from eaves.run.world_squares import WIDE_SQUARE, around_squares

if TYPE_CHECKING:
    from eaves.recipe.recipe import Recipe


def seen_from(bounds: Bounds, recipe: Recipe, side: float) -> Bounds:
    """World metres of the points that decide the ground of the blocks of a side (m) within `bounds`."""
    near = around_squares(bounds, side).buffered(recipe.ground.buffer)
    if not recipe.sees_wide:
        return near
    return around_squares(near, WIDE_SQUARE).buffered(recipe.ground.wide_buffer)


def keep_ground(task: Task, store: Store, recipe: Recipe) -> None:
    """The ground of a block, kept in the store in the order of the block's files."""
    block, reach = task.unit, recipe.ground.buffer
    cloud, number = store.load_points(block, reach, ids=False)
    bounds = block.bounds.buffered(reach)
    wide = load_wide(store, bounds) if recipe.sees_wide else None
    patches = () if wide is None else [one.cropped(bounds.buffered(one.cell)) for one in wide.patches]
    taken = store.key_of(GROUND.key(recipe, store.system), cloud, number, patches)
    if store.recalls(GROUND, block, task.read, taken):
        return
    clock = Clock()
    inside = np.flatnonzero(Bounds(0.0, 0.0, block.side, block.side).contains(cloud.xyz))
    arrays: dict[str, NDArray[Any]] = {}
    for name, values in zip(("class", "part"), classify_inside(cloud, inside, wide, recipe), strict=True):
        if values is not None:
            arrays[name] = np.empty_like(values)
            arrays[name][number] = values
    clock.lap("ground")
    arrays[SECONDS] = np.array(clock.laps["ground"])
    store.save(GROUND, block, arrays, task.read, taken)


def classify_inside(
    cloud: PointCloud, inside: NDArray[np.int64], wide: WideObjects | None, recipe: Recipe
) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """The classes of the points `inside` (K,) a block, and the parts the filter found on the way."""
    if recipe.use_classes:
        cloud = with_ground_classes(cloud, recipe.ground_classes)
    if len(inside) == 0:
        return np.zeros(0, np.uint8), None
    found = classify_ground(cloud, recipe.ground, use_classes=recipe.use_classes, wide=wide)
    assert found.classification is not None
    return found.classification[inside], None if found.part is None else found.part[inside]


def with_ground_classes(cloud: PointCloud, numbers: tuple[int, ...]) -> PointCloud:
    """The cloud whose file means ground by these classes: they become 2, and a 2 that is none of them 1."""
    given = cloud.classification
    if given is None or numbers == (GROUND_CLASS,):
        return cloud
    classes = np.where(given == GROUND_CLASS, np.uint8(UNCLASSIFIED), given)
    classes[np.isin(given, numbers)] = GROUND_CLASS
    return cloud.with_(classification=classes)
