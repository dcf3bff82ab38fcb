"""Squares fixed to the world: what is found in them is the same whatever the blocks, tiles and files are."""

from __future__ import annotations

from functools import lru_cache
from itertools import product
from math import ceil

from eaves.model import Block, Bounds

WIDE_SQUARE = 480.0
"""Side of the squares (m) in which what is wide is looked for: a whole multiple of all cells."""


@lru_cache(maxsize=4096)
def squares_of(bounds: Bounds, side: float) -> tuple[Block, ...]:
    """The squares of a side (m) that meet bounds (world metres, half-open), in order."""
    first = Block.at(bounds.west, bounds.south, side)
    columns = range(first.column, max(first.column + 1, ceil(bounds.east / side)))
    rows = range(first.row, max(first.row + 1, ceil(bounds.north / side)))
    return tuple([Block(column, row, side) for column, row in product(columns, rows)])


def squares_touching(bounds: Bounds, side: float) -> list[Block]:
    """The squares of a side (m) that bounds (world metres) with their east and north sides reach into."""
    first, last = Block.at(bounds.west, bounds.south, side), Block.at(bounds.east, bounds.north, side)
    columns, rows = range(first.column, last.column + 1), range(first.row, last.row + 1)
    return [Block(column, row, side) for column, row in product(columns, rows)]


def ring(square: Block) -> list[Block]:
    """A square and the eight around it, in order."""
    return [
        Block(square.column + right, square.row + up, square.side)
        for right, up in product((-1, 0, 1), repeat=2)
    ]


def within(bounds: Bounds, limits: Bounds | None) -> Bounds:
    """The intersection of two rectangles; empty where they do not meet."""
    if limits is None:
        return bounds
    west, south = max(bounds.west, limits.west), max(bounds.south, limits.south)
    return Bounds(
        west, south, max(west, min(bounds.east, limits.east)), max(south, min(bounds.north, limits.north))
    )
