"""Large raised objects and decks of bridges, in squares fixed to the world: a hall is wider than a block."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.ground.toolkit.floor import COARSEST_M, Floor
from eaves.ground.toolkit.wide_objects import Patch, WideObjects
from eaves.model import Block, Bounds, Mask
from eaves.model.block import extremes
from eaves.model.cloud import GRID_STEP, NOISE_CLASSES
from eaves.model.doubt import Doubt
from eaves.run.world_squares import within
from eaves.surroundings.decks import RULES, Decks, decks_of, look_around

TYPES = {cls.__name__: cls for cls in (Floor, Patch, Doubt, Decks)}
"""The classes of the results."""
EMPTY_RIM = 24 * COARSEST_M
"""Margin (m) around the data that is looked at, as far as decks are followed: more, being empty, changes
nothing."""
DECK_REACH = 4.0 * RULES.widest + COARSEST_M
"""Distance (m) from a square within which large objects decide its decks."""

Records = NDArray[Any]


@dataclass(frozen=True, eq=False)
class SquareFloor:
    """A square and the floor of its surroundings, None where no point lies in them."""

    square: Block
    floor: Floor | None


def see_points(block: Block, points: Mapping[Block, tuple[Records, bool]], parameters: Any) -> Any:
    """A block with its points (N,), in quanta about its corner; what the file calls noise stays out."""
    records, classified = points[block]
    if classified:
        chosen = np.flatnonzero(~np.isin(records["classification"], NOISE_CLASSES))
        records = records if len(chosen) == len(records) else records.take(chosen)
    return block, records["xyz"]


def find_floor(seen: tuple[Block, NDArray[np.int32]], parameters: Any) -> Floor:
    """The floor of a block's points."""
    block, quanta = seen
    floor = Floor.empty(stored_extent(quanta, block) or Bounds(*block.origin, *block.origin))
    floor.add(quanta, 1.0, [round(value / GRID_STEP) for value in block.origin])
    return floor


def see_floors(square: Block, floors: Mapping[Block, Floor], parameters: Any) -> SquareFloor:
    """A square and the floor of its surroundings, of the floors of the blocks there."""
    pieces = list(floors.values())
    if not pieces:
        return SquareFloor(square, None)
    extent = reduce(Bounds.union, (piece.bounds for piece in pieces))
    window = square.bounds.buffered(parameters.wide_buffer)
    floor = Floor.empty(within(window, extent.buffered(EMPTY_RIM)))  # cost follows the data's area
    for piece in pieces:
        floor.merge(piece)
    return SquareFloor(square, floor)


def find_large(seen: SquareFloor, parameters: Any) -> tuple[Patch, ...]:
    """Patch of the large objects over the terrain in a square and around it, as far as decks need; empty for
    none."""
    patch = None if seen.floor is None else parameters.ground.find_wide_objects(seen.floor)
    return () if patch is None else (patch.cropped(seen.square.bounds.buffered(DECK_REACH)),)


def see_decks(
    square: Block, floors: Mapping[Block, Floor], large: Mapping[Block, tuple[Patch, ...]], parameters: Any
) -> tuple[Block, tuple[Decks, Mask] | None]:
    """A square and all that decides the decks in it."""
    floor = see_floors(square, floors, parameters).floor
    raised = next(iter(large[square]), None)
    return square, None if floor is None else look_around(floor, square.bounds, raised)


def find_square_decks(seen: tuple[Block, tuple[Decks, Mask] | None], parameters: Any) -> tuple[Decks, ...]:
    """The decks of bridges in a square."""
    square, around = seen
    return () if around is None else (decks_of(*around, square.bounds),)


def large_objects(large: Mapping[Block, tuple[Patch, ...]]) -> WideObjects:
    """The large objects over the terrain in some squares."""
    patches = (patch.cropped(square.bounds) for square in large for patch in large[square])
    return WideObjects(tuple(patches))


def stored_extent(quanta: NDArray[np.int32], block: Block) -> Bounds | None:
    """World metres (half-open) of points (N, 3) in quanta about a block's corner; None for no points."""
    if len(quanta) == 0:
        return None
    low, high = extremes(quanta[:, :2])
    return Bounds(*map(float, (*low * GRID_STEP, *(high + 1) * GRID_STEP))).translated(*block.origin)
