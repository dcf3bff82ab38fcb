"""What stands over the terrain, found in squares fixed to the world: blocks are too narrow for halls."""

from __future__ import annotations

from functools import reduce
from typing import TYPE_CHECKING

import numpy as np

from eaves.ground.toolkit.floor import COARSEST_M, Floor
from eaves.ground.toolkit.wide_objects import Patch, WideObjects
from eaves.model import Bounds
from eaves.model.cloud import GRID_STEP, NOISE_CLASSES
from eaves.model.doubt import Doubt
from eaves.run.keys import DECKS, FLOORS, WIDE
from eaves.run.part_file import load_value, pack
from eaves.run.store import Store, Task, stored_extent
from eaves.run.world_squares import WIDE_SQUARE, squares_of, within
from eaves.surroundings.decks import Decks, decks_of, look_around

if TYPE_CHECKING:
    from eaves.recipe.recipe import Recipe

TYPES = {cls.__name__: cls for cls in (Floor, Patch, Doubt, Decks)}
"""The classes of the parts kept here."""
EMPTY_RIM = 24 * COARSEST_M
"""So much (m) is looked at around the data, as far as decks are followed: more, being empty, changes
nothing."""


def keep_floor(task: Task, store: Store) -> None:
    """The floor of a block's points, kept in the store; what the file calls noise stays out."""
    block = task.unit
    records = store.read_points(block)
    if store.has_classes:
        used = np.flatnonzero(~np.isin(records["classification"], NOISE_CLASSES))
        records = records if len(used) == len(records) else records.take(used)
    floor = Floor.empty(stored_extent(records["xyz"], block) or Bounds(*block.origin, *block.origin))
    floor.add(records["xyz"], 1.0, [round(value / GRID_STEP) for value in block.origin])
    store.save(FLOORS, block, pack("value", floor), task.read)


def keep_square(task: Task, store: Store, side: float, recipe: Recipe) -> None:
    """What stands over the terrain in a square, and the decks of bridges there, kept in the store; `side` is
    that of the blocks."""
    square, ground = task.unit, recipe.ground
    seen = square.bounds.buffered(ground.wide_buffer)
    blocks = (block for block in squares_of([seen], side) if store.has(FLOORS, block))
    floors = [load_value(store.path(FLOORS, block), TYPES) for block in blocks]
    patches: tuple[Patch, ...] = ()
    if not floors:
        store.remove(DECKS, square)
    else:
        extent = reduce(Bounds.union, (one.bounds for one in floors))
        floor = Floor.empty(within(seen, extent.buffered(EMPTY_RIM)))  # cost follows the data's area
        for one in floors:
            floor.merge(one)
        patch = ground.find_wide_objects(floor)
        patches = () if patch is None else (patch.cropped(square.bounds),)
        look = look_around(floor, square.bounds, patch)
        taken = store.key_of(DECKS.key(recipe, store.system), *look)
        if not store.recalls(DECKS, square, task.read, taken):
            found = decks_of(*look, square.bounds)
            store.save(DECKS, square, pack("value", found), task.read, taken)
    store.save(WIDE, square, pack("value", patches), task.read)


def load_wide(store: Store, bounds: Bounds) -> WideObjects:
    """What stands over the terrain within `bounds`, world metres."""
    patches = []
    for square in squares_of([bounds], WIDE_SQUARE):
        path = store.path(WIDE, square)
        if path.exists():
            patches += load_value(path, TYPES)
    return WideObjects(tuple(patches))


def load_decks(store: Store, bounds: Bounds) -> tuple[Decks, ...]:
    """The decks of bridges within `bounds`, world metres."""
    paths = [store.path(DECKS, square) for square in squares_of([bounds], WIDE_SQUARE)]
    return tuple(load_value(path, TYPES) for path in paths if path.exists())
