"""The ground pass: classes of the ground stage, found in squares fixed to the world.

A block may have any size, and what its ground is must not follow from it: the spacing, the roughness and the
way the terrain goes on at a rim are measured in what a filter sees. So a filter always sees a square of
`GROUND_SQUARE` with its buffer, and a block takes the classes of the squares that it meets.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eaves.blocks.wide import load_wide
from eaves.ground import classify_ground
from eaves.ground.toolkit.wide_objects import WideObjects
from eaves.model import Block, Bounds, PointCloud
from eaves.model.cloud import GROUND as GROUND_CLASS
from eaves.model.cloud import UNCLASSIFIED
from eaves.run.clock import Clock
from eaves.run.keys import GROUND
from eaves.run.store import SECONDS, Places, Store, Task
from eaves.run.world_squares import GROUND_SQUARE, WIDE_SQUARE, around_squares

if TYPE_CHECKING:
    from eaves.recipe.recipe import Recipe

Numbers = NDArray[np.int64]


def seen_from(bounds: Bounds, recipe: Recipe) -> Bounds:
    """World metres of the points that decide the ground within `bounds`."""
    near = around_squares(bounds, GROUND_SQUARE).buffered(recipe.ground.buffer)
    if not recipe.sees_wide:
        return near
    return around_squares(near, WIDE_SQUARE).buffered(recipe.ground.wide_buffer)


def group_squares(tasks: Sequence[Task], side: float) -> list[list[Task]]:
    """The squares that are loaded at once: those with their corner in one block of a side (m)."""
    groups: dict[Block, list[Task]] = {}
    for task in tasks:
        square: Block = task.unit
        home = Block.at(*square.origin, side) if side > GROUND_SQUARE else square
        groups.setdefault(home, []).append(task)
    return list(groups.values())


def classify_squares(tasks: Sequence[Task], store: Store, recipe: Recipe, side: float) -> None:
    """The ground stage for the points in some squares, kept in the store; `side` is that of the blocks."""
    reach, squares = recipe.ground.buffer, [task.unit for task in tasks]
    seen = squares[0].bounds.buffered(reach)
    for square in squares[1:]:
        seen = seen.union(square.bounds.buffered(reach))
    cloud, places = store.load_points(seen, squares[0].origin, side, ids=False)
    for row in sorted({square.row for square in squares}):
        line = [task for task in tasks if task.unit.row == row]
        low, high = line[0].unit.bounds.south - reach, line[0].unit.bounds.north + reach
        strip = points_in(cloud, Bounds(seen.west, low, seen.east, high)) if len(squares) > 1 else None
        for task in line:
            near = np.arange(len(cloud))
            if len(squares) > 1:
                near = points_in(cloud, task.unit.bounds.buffered(reach), strip)
            some = cloud if len(near) == len(cloud) else cloud.take(near)
            keep_ground(task, some.about(task.unit.origin), near, places, store, recipe)


def keep_ground(
    task: Task, cloud: PointCloud, near: Numbers, places: Places, store: Store, recipe: Recipe
) -> None:
    """The ground of a square, kept in the store block by block.

    `cloud` holds the points of the square and of its surroundings up to the method's buffer, and no others;
    `near` are their numbers (N,) among those of which the `places` are known.
    """
    clock, square = Clock(), task.unit
    inside = np.flatnonzero(Bounds(0.0, 0.0, square.side, square.side).contains(cloud.xyz))
    own = {block: places.of(block, near[inside]) for block in places.range_of}
    own = {block: found for block, found in own.items() if len(found[0])}
    bounds = square.bounds.buffered(recipe.ground.buffer)
    wide = load_wide(store, bounds) if recipe.sees_wide else None
    patches = () if wide is None else [one.cropped(bounds.buffered(one.cell)) for one in wide.patches]
    taken = store.key_of(
        GROUND.key(recipe, store.system), cloud, [number for _, number in own.values()], patches
    )
    if store.recalls(GROUND, square, task.read, taken):
        return
    classes, part = classify_square(cloud, inside, wide, recipe)
    arrays: dict[str, NDArray[Any]] = {}
    for block, (some, number) in own.items():
        arrays[f"class-{block.name}"] = classes[some]
        if len(number) < places.count(block):  # else they are all, in the order of the block's files
            arrays[f"number-{block.name}"] = number
        if part is not None:
            arrays[f"part-{block.name}"] = part[some]
    clock.lap("ground")
    arrays[SECONDS] = np.array(clock.laps["ground"])
    store.save(GROUND, square, arrays, task.read, taken)


def classify_square(
    cloud: PointCloud, inside: Numbers, wide: WideObjects | None, recipe: Recipe
) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """The classes of the points `inside` (K,) a square, and the parts the filter found on the way."""
    if recipe.use_classes:
        cloud = with_ground_classes(cloud, recipe.ground_classes)
    if len(inside) == 0:
        return np.zeros(0, np.uint8), None
    found = classify_ground(cloud, recipe.ground, use_classes=recipe.use_classes, wide=wide)
    assert found.classification is not None
    return found.classification[inside], None if found.part is None else found.part[inside]


def points_in(cloud: PointCloud, bounds: Bounds, among: Numbers | None = None) -> Numbers:
    """Numbers (K,) of the points within `bounds`, world metres, out of some (M,)."""
    local = bounds.translated(-cloud.origin[0], -cloud.origin[1])
    if among is None:
        return np.flatnonzero(local.contains(cloud.xyz))
    return np.asarray(among[local.contains(cloud.xyz[among])])


def with_ground_classes(cloud: PointCloud, numbers: tuple[int, ...]) -> PointCloud:
    """The cloud whose file means ground by these classes: they become 2, and a 2 that is none of them 1."""
    given = cloud.classification
    if given is None or numbers == (GROUND_CLASS,):
        return cloud
    classes = np.where(given == GROUND_CLASS, np.uint8(UNCLASSIFIED), given)
    classes[np.isin(given, numbers)] = GROUND_CLASS
    return cloud.with_(classification=classes)
