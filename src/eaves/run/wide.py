"""What stands over the terrain, found in squares fixed to the world: blocks are too narrow for halls."""

from __future__ import annotations

import numpy as np

from eaves.ground import GroundMethod
from eaves.ground.toolkit.floor import COARSEST_M, Floor
from eaves.ground.toolkit.wide_objects import Patch, WideObjects
from eaves.model import Block, Bounds
from eaves.model.cloud import GRID_STEP, NOISE_CLASSES
from eaves.model.doubt import Doubt
from eaves.run.decks import Decks, decks_of
from eaves.run.part_file import load_value, save_value
from eaves.run.store import Store, extent_of
from eaves.run.world_squares import WIDE_SQUARE, squares_of, within

TYPES = {cls.__name__: cls for cls in (Floor, Patch, Doubt, Decks)}
"""The classes of the parts kept here."""
EMPTY_RIM = 24 * COARSEST_M
"""So much (m) is looked at around the data, as far as decks are followed: more, being empty, changes
nothing."""


def keep_floor(block: Block, store: Store) -> None:
    """The floor of a block's points, kept in the store; what the file calls noise stays out."""
    records = store.read_points(block)
    if store.has_classes:
        records = records[~np.isin(records["classification"], NOISE_CLASSES)]
    floor = Floor.empty(extent_of(records["xyz"], block) or Bounds(*block.origin, *block.origin))
    floor.add(records["xyz"], 1.0, [round(value / GRID_STEP) for value in block.origin])
    save_value(store.path("floors", block), floor)


def keep_square(square: Block, store: Store, side: float, ground: GroundMethod) -> None:
    """What stands over the terrain in a square, kept in the store; `side` is that of the blocks."""
    seen = square.bounds.buffered(ground.wide_buffer)
    blocks = (block for block in squares_of([seen], side) if store.has("floors", block))
    floors = [load_value(store.path("floors", block), TYPES) for block in blocks]
    patches: tuple[Patch, ...] = ()
    if floors:
        extent = floors[0].bounds
        for one in floors[1:]:
            extent = extent.union(one.bounds)
        floor = Floor.empty(within(seen, extent.buffered(EMPTY_RIM)))  # cost follows the data's area
        for one in floors:
            floor.merge(one)
        patch = ground.find_wide_objects(floor)
        patches = () if patch is None else (patch.cropped(square.bounds),)
        save_value(store.path("decks", square), decks_of(floor, square.bounds, patch))
    save_value(store.path("squares", square), patches)


def load_wide(store: Store, bounds: Bounds) -> WideObjects:
    """What stands over the terrain within `bounds`, world metres."""
    patches = []
    for square in squares_of([bounds], WIDE_SQUARE):
        path = store.path("squares", square)
        if path.exists():
            patches += load_value(path, TYPES)
    return WideObjects(tuple(patches))


def load_decks(store: Store, bounds: Bounds) -> tuple[Decks, ...]:
    """The decks of bridges within `bounds`, world metres."""
    paths = [store.path("decks", square) for square in squares_of([bounds], WIDE_SQUARE)]
    return tuple(load_value(path, TYPES) for path in paths if path.exists())
