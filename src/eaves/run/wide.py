"""What stands over the terrain, found in squares fixed to the world: blocks are too narrow for halls."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eaves.ground import GroundMethod
from eaves.ground.toolkit.floor import Floor
from eaves.ground.toolkit.wide_objects import Patch, WideObjects
from eaves.model import Block, Bounds
from eaves.model.cloud import GRID_STEP, NOISE_CLASSES
from eaves.model.doubt import Doubt
from eaves.run.decks import Decks, decks_of
from eaves.run.part_file import load_value, save_value
from eaves.run.store import Store

SQUARE = 480.0
"""Side of a square (m), a whole multiple of all cells. What is found in it, with `GroundMethod.wide_buffer`
around it in view, is the same whatever the blocks, tiles and files are."""
TYPES = {cls.__name__: cls for cls in (Floor, Patch, Doubt, Decks)}
"""The classes of the parts kept here."""


def squares_of(bounds: Sequence[Bounds]) -> list[Block]:
    """The squares that meet some bounds (world metres), in order."""
    found = set()
    for one in bounds:
        first, last = Block.at(one.west, one.south, SQUARE), Block.at(one.east, one.north, SQUARE)
        for column in range(first.column, last.column + 1):
            found |= {Block(column, row, SQUARE) for row in range(first.row, last.row + 1)}
    return sorted(found)


def seen_from(bounds: Bounds, ground: GroundMethod) -> Bounds:
    """World metres of the points that decide what is wide within `bounds`."""
    if not ground.wide_buffer:
        return bounds
    squares = squares_of([bounds])
    return squares[0].bounds.union(squares[-1].bounds).buffered(ground.wide_buffer)


def keep_floor(block: Block, store: Store) -> None:
    """The floor of a block's points, kept in the store; what the file calls noise stays out."""
    records = store.read_points(block)
    if store.has_classes:
        records = records[~np.isin(records["classification"], NOISE_CLASSES)]
    floor = Floor.empty(block.bounds)
    floor.add(records["xyz"], 1.0, [round(value / GRID_STEP) for value in block.origin])
    save_value(store.path("floors", block), floor)


def keep_square(square: Block, store: Store, side: float, ground: GroundMethod) -> None:
    """What stands over the terrain in a square, kept in the store; `side` is that of the blocks."""
    seen = square.bounds.buffered(ground.wide_buffer)
    floor = Floor.empty(seen)
    first, last = Block.at(seen.west, seen.south, side), Block.at(seen.east, seen.north, side)
    for column in range(first.column, last.column + 1):
        for row in range(first.row, last.row + 1):
            path = store.path("floors", Block(column, row, side))
            if path.exists():
                floor.merge(load_value(path, TYPES))
    patch = ground.find_wide_objects(floor)
    patches = () if patch is None else (patch.cropped(square.bounds),)
    save_value(store.path("decks", square), decks_of(floor, square.bounds, patch))
    save_value(store.path("squares", square), patches)


def load_wide(store: Store, bounds: Bounds) -> WideObjects:
    """What stands over the terrain within `bounds`, world metres."""
    patches = []
    for square in squares_of([bounds]):
        path = store.path("squares", square)
        if path.exists():
            patches += load_value(path, TYPES)
    return WideObjects(tuple(patches))


def load_decks(store: Store, bounds: Bounds) -> tuple[Decks, ...]:
    """The decks of bridges within `bounds`, world metres."""
    paths = [store.path("decks", square) for square in squares_of([bounds])]
    return tuple(load_value(path, TYPES) for path in paths if path.exists())
