"""What stands over the terrain, found in squares fixed to the world: blocks are too narrow for halls."""

from __future__ import annotations

import numpy as np

from eaves.ground import GroundMethod
from eaves.ground.toolkit.floor import COARSEST_M, Floor
from eaves.ground.toolkit.wide_objects import Patch, WideObjects
from eaves.model import Block, Bounds
from eaves.model.cloud import GRID_STEP, NOISE_CLASSES
from eaves.model.doubt import Doubt
from eaves.run.decks import Decks, decks_of, look_around
from eaves.run.mark import mark_of
from eaves.run.part_file import load_value, open_part, pack, save_part, save_value
from eaves.run.store import Store, extent_of, link_file
from eaves.run.world_squares import WIDE_SQUARE, squares_of, within

TYPES = {cls.__name__: cls for cls in (Floor, Patch, Doubt, Decks)}
"""The classes of the parts kept here."""
INPUTS = "inputs"
"""Array of a part of decks: the mark of what they follow from."""
EMPTY_RIM = 24 * COARSEST_M
"""So much (m) is looked at around the data, as far as decks are followed: more, being empty, changes
nothing."""


def keep_floor(block: Block, store: Store) -> None:
    """The floor of a block's points, kept in the store; what the file calls noise stays out."""
    records = store.read_points(block)
    if store.has_classes:
        used = np.flatnonzero(~np.isin(records["classification"], NOISE_CLASSES))
        records = records if len(used) == len(records) else records.take(used)
    floor = Floor.empty(extent_of(records["xyz"], block) or Bounds(*block.origin, *block.origin))
    floor.add(records["xyz"], 1.0, [round(value / GRID_STEP) for value in block.origin])
    save_value(store.path("floors", block), floor)


def keep_square(
    square: Block, store: Store, side: float, ground: GroundMethod, earlier: Store | None = None
) -> None:
    """What stands over the terrain in a square, kept in the store; `side` is that of the blocks.

    Decks are taken from the store of an `earlier` run where they follow from the same.
    """
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
        keep_decks(square, store, floor, patch, earlier)
    save_value(store.path("squares", square), patches)


def keep_decks(
    square: Block, store: Store, floor: Floor, raised: Patch | None, earlier: Store | None
) -> None:
    """The decks of bridges in a square, kept in the store."""
    seen, roofs = look_around(floor, square.bounds, raised)
    mark = mark_of(seen.west, seen.north, seen.cell, seen.level, seen.water, roofs)
    path = store.path("decks", square)
    if earlier is not None and earlier.has("decks", square):
        with open_part(earlier.path("decks", square)) as file:
            known = file[INPUTS].tobytes().decode() if INPUTS in file else ""
        if known == mark:
            link_file(earlier.path("decks", square), path)
            return
    found = pack("value", decks_of(seen, roofs, square.bounds))
    save_part(path, {**found, INPUTS: np.frombuffer(mark.encode(), np.uint8)})


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
