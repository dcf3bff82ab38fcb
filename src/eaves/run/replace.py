"""The points of a later scan take the place of earlier ones in the area that they cover."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.model import Block, Mask
from eaves.model.cloud import GRID_STEP, NOISE_CLASSES
from eaves.raster.squares import closed_by_square
from eaves.run.keys import GONE
from eaves.run.store import RECORD, Store, Task, join_records, map_records
from eaves.run.world_squares import ring

Records = NDArray[Any]

COVER_CELL = 1.0
"""Cells (m), fixed to the world, in which the new points' area is decided: as fine as a border of tiles
needs, and wide enough that a scan of one point a square metre fills most of them."""

GAP_CELLS = 2
"""Gaps between new points up to twice so many cells wide are covered, too: missing scan lines, dark roofs. In
wider ones (water, the shadow of a tower) nothing new is known, and the earlier points stay."""

MARGIN = 2 * GAP_CELLS + 1
"""Cells around a block that decide what of it is covered."""

SAME = ("x", "y", "z", "return_number", "number_of_returns", "classification")
"""Two points that agree in these are one: a tile delivered again changes only what differs in it."""


def keep_gone(task: Task, store: Store, generations: Sequence[int]) -> None:
    """The points of a block that are gone, kept in the store."""
    gone, counts = replace_in(store, task.unit, generations)
    store.save(GONE, task.unit, {"id": gone, "counts": np.array(counts)}, task.read)


def replace_in(
    store: Store, block: Block, generations: Sequence[int]
) -> tuple[NDArray[np.int64], tuple[int, int]]:
    """The points of a block that are replaced: earlier points where later ones cover their place, but of two
    that agree the later one. Their ids (K,), ascending, and how many of the last scan's points came, and of
    the earlier ones went.

    What is covered follows from the new points alone: not from the tiles they came in, nor from their order.

    Parameters
    ----------
    store
        With the points of all inputs.
    block
        The block.
    generations
        Numbers of the first inputs of each later scan, rising.
    """
    paths = files_of(store, block)
    records = join_records(map_records(paths))
    numbers = [scan_number(path) for path in paths]
    sizes = [path.stat().st_size // RECORD.itemsize for path in paths]
    number = np.repeat(np.array(numbers, np.int64), sizes)
    stays = np.ones(len(records), bool)
    came = went = 0
    for first, end in pairwise((*generations, np.iinfo(np.int64).max)):
        old = np.flatnonzero(stays & (number < first))
        new = np.flatnonzero((number >= first) & (number < end))
        covered = old[covers_place(store, block, first, int(end), records[old])]
        same, again = pair_same(records[covered], records[new])
        stays[covered[~same]] = False
        stays[new[again]] = False
        came, went = int((~again).sum()), int((~same).sum())
    return np.sort(records["point_id"][~stays]), (came, went)


def covers_place(store: Store, block: Block, first: int, end: int, records: Records) -> Mask:
    """Which of a block's points (N,) lie in the area that points of some inputs cover: cells of `COVER_CELL`
    that hold some that are not noise, closed."""
    corner = np.floor(np.array(block.origin) / COVER_CELL).astype(np.int64) - MARGIN
    count = int(np.ceil(block.side / COVER_CELL)) + 1 + 2 * MARGIN
    grid = np.zeros((count, count), bool)
    for one in ring(block):
        newer = [path for path in files_of(store, one) if first <= scan_number(path) < end]
        later = join_records(map_records(newer))
        place = scan_cells(later[~np.isin(later["classification"], NOISE_CLASSES)], one) - corner
        place = place[((place >= 0) & (place < count)).all(axis=1)]
        grid[place[:, 0], place[:, 1]] = True
    closed = closed_by_square(grid, MARGIN)
    place = scan_cells(records, block) - corner
    return np.asarray(closed[place[:, 0], place[:, 1]])


def pair_same(old: Records, new: Records) -> tuple[Mask, Mask]:
    """Which old points (N,) and which new ones (M,) agree in all of `SAME`, each with one of the other."""
    both = np.concatenate([old, new])
    is_new = np.arange(len(both)) >= len(old)
    x, y, z = both["xyz"].T
    columns = [x, y, z, *(both[name] for name in SAME[3:])]
    order = np.lexsort((is_new, *columns))
    starts = np.ones(len(both), bool)
    if len(both):
        starts[1:] = np.any([column[order][1:] != column[order][:-1] for column in columns], axis=0)
    group = np.cumsum(starts) - 1
    count = np.bincount(group)
    fresh = np.bincount(group, weights=is_new[order]).astype(np.int64)
    pairs = np.minimum(fresh, count - fresh)[group]
    rank = np.arange(len(both)) - np.flatnonzero(starts)[group]
    rank = np.where(is_new[order], rank - (count - fresh)[group], rank)
    paired = np.zeros(len(both), bool)
    paired[order] = rank < pairs
    return paired[: len(old)], paired[len(old) :]


def files_of(store: Store, block: Block) -> list[Path]:
    """The files of a block's points, in their order."""
    return sorted(store.points_path(block).glob("*.bin"))


def scan_number(path: Path) -> int:
    """The number of the input that a file's points are from."""
    return int(path.stem.split("-")[0])


def scan_cells(records: Records, block: Block) -> NDArray[np.int64]:
    """World cells (N, 2; column, row) of a block's points."""
    world = records["xyz"][:, :2] * GRID_STEP + np.array(block.origin)
    return np.asarray(np.floor(world / COVER_CELL).astype(np.int64))
