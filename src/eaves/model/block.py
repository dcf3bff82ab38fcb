"""The unit of computing: squares fixed to the world."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from math import ceil
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from eaves.kernels import kernel
from eaves.model.checks import Mask, Points

Scalar = TypeVar("Scalar", bound=np.generic)
BLOCK_SIDE = 240.0
"""Side of a block (m): a whole multiple of the 0.5, 1 and 1.5 m cells."""
SEAM = 1.5
"""Points this near (m) to a block's border are labelled by both blocks; shared labels join regions."""


@dataclass(frozen=True)
class Bounds:
    """An axis-parallel rectangle in metres, half-open towards east and north.

    Parameters
    ----------
    west, south, east, north : float
        Its sides (m), in the world or about a local origin; west ≤ east and south ≤ north.

    Examples
    --------
    >>> from eaves import Bounds
    >>> west, south, east, north = Bounds(0.0, 0.0, 10.0, 5.0).buffered(1.0)
    >>> west, north
    (-1.0, 6.0)
    """

    west: float
    south: float
    east: float
    north: float

    def __iter__(self) -> Iterator[float]:
        return iter((self.west, self.south, self.east, self.north))

    @property
    def width(self) -> float:
        """Metres from west to east."""
        return self.east - self.west

    @property
    def height(self) -> float:
        """Metres from south to north."""
        return self.north - self.south

    def buffered(self, distance: float) -> Bounds:
        """The rectangle moved outwards by `distance` (m) on every side."""
        return Bounds(
            self.west - distance, self.south - distance, self.east + distance, self.north + distance
        )

    def translated(self, east: float, north: float) -> Bounds:
        """The rectangle shifted by (`east`, `north`) metres."""
        return Bounds(self.west + east, self.south + north, self.east + east, self.north + north)

    def contains(self, xyz: Points) -> Mask:
        """Mask (N,) of the points of `xyz` (N, 2 or 3) that lie inside."""
        x, y = xyz[:, 0], xyz[:, 1]
        return (x >= self.west) & (x < self.east) & (y >= self.south) & (y < self.north)

    def intersects(self, other: Bounds) -> bool:
        """True if the two rectangles share more than a border."""
        return (
            self.west < other.east
            and other.west < self.east
            and self.south < other.north
            and other.south < self.north
        )

    def union(self, other: Bounds) -> Bounds:
        """The smallest rectangle holding both."""
        return Bounds(
            min(self.west, other.west),
            min(self.south, other.south),
            max(self.east, other.east),
            max(self.north, other.north),
        )

    @classmethod
    def of(cls, xyz: Points) -> Bounds:
        """The bounding rectangle of points (N, 2 or 3), N > 0."""
        low, high = extremes(xyz)
        return cls(float(low[0]), float(low[1]), float(high[0]), float(high[1]))


def extremes(xyz: NDArray[Scalar]) -> tuple[NDArray[Scalar], NDArray[Scalar]]:
    """The lowest and the highest value (C,) of each column of an array (N, C), N > 0."""
    low, high = xyz[0].copy(), xyz[0].copy()
    widen_kernel(xyz, low, high)
    return low, high


@kernel
def widen_kernel(xyz: NDArray[Any], low: NDArray[Any], high: NDArray[Any]) -> None:
    """Widen `low` and `high` (C,) to the values (N, C) of their columns; one that is no number stays."""
    for i in range(len(xyz)):
        for k in range(xyz.shape[1]):
            value = xyz[i, k]
            if low[k] <= value <= high[k]:  # as most are
                continue
            if value < low[k] or value != value:
                low[k] = value
            if value > high[k] or value != value:
                high[k] = value


@dataclass(frozen=True, order=True)
class Block:
    """A square of the world grid.

    Parameters
    ----------
    column, row : int
        Its number, counted eastwards and northwards from world (0, 0).
    side : float
        Its side (m, > 0).

    Examples
    --------
    >>> from eaves import Block
    >>> Block.at(500.0, 100.0).origin
    (480.0, 0.0)
    """

    column: int
    row: int
    side: float = BLOCK_SIDE

    @property
    def bounds(self) -> Bounds:
        """World metres."""
        west, south = self.column * self.side, self.row * self.side
        return Bounds(west, south, west + self.side, south + self.side)

    @property
    def origin(self) -> tuple[float, float]:
        """World metres of the south-west corner, the local origin of everything computed in the block."""
        return self.column * self.side, self.row * self.side

    @property
    def name(self) -> str:
        """A word for file names, the same for the same block."""
        return f"{self.column}_{self.row}"

    def rng(self) -> np.random.Generator:
        """The block's own random numbers: the same in every run and every process."""
        return np.random.default_rng([self.column & 0xFFFFFFFF, self.row & 0xFFFFFFFF])

    @classmethod
    def at(cls, x: float, y: float, side: float = BLOCK_SIDE) -> Block:
        """The block that holds world point (x, y)."""
        return cls(int(np.floor(x / side)), int(np.floor(y / side)), side)


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
