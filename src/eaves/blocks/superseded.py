"""Which points of a block later scans replace."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from eaves.model import GRID_STEP, NOISE_CLASSES, Block, Mask
from eaves.raster.blur import closed_by_square
from eaves.run.store import Records, join_records

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


class Scans(Protocol):
    """What decides which points are earlier ones."""

    @property
    def generations(self) -> Sequence[int]:
        """The number of the first input of each later scan."""


def inputs_of_superseded(
    block: Block, scans: Mapping[Block, list[tuple[int, Records]]], parameters: object
) -> dict[Block, list[tuple[int, Records]]]:
    """The points of a block, first, and of those around it, by the number of their input."""
    return {block: scans[block], **scans}


def find_superseded(
    view: Mapping[Block, list[tuple[int, Records]]], parameters: Scans
) -> dict[str, NDArray[np.int64]]:
    """The points of a block that are superseded: earlier points where later ones cover their place, but of
    two that agree the later one. Their ids (K,), ascending, those (G,) that went for the last scan, and
    how many of its points came, and of the earlier ones went.

    What is covered follows from the new points alone: not from the tiles they came in, nor from their order.
    """
    block = next(iter(view))
    records = join_records([points for _, points in view[block]])
    number = np.concatenate([np.full(len(points), scan, np.int64) for scan, points in view[block]])
    stays = np.ones(len(records), bool)
    came, gone = 0, np.zeros(0, np.int64)
    for first, end in pairwise((*parameters.generations, np.iinfo(np.int64).max)):
        old = np.flatnonzero(stays & (number < first))
        new = np.flatnonzero((number >= first) & (number < end))
        covered = old[covers_place(view, block, first, int(end), records[old])]
        same, again = pair_same(records[covered], records[new])
        came, gone = int((~again).sum()), covered[~same]
        stays[gone] = False
        stays[new[again]] = False
    ids = records["point_id"]
    return {"id": np.sort(ids[~stays]), "gone": ids[gone], "counts": np.array([came, len(gone)])}


def covers_place(
    scans: Mapping[Block, list[tuple[int, Records]]], block: Block, first: int, end: int, records: Records
) -> Mask:
    """Mask (N,) of a block's points in the area that points of some inputs cover: cells of `COVER_CELL` that
    hold points other than noise, closed."""
    corner = np.floor(np.array(block.origin) / COVER_CELL).astype(np.int64) - MARGIN
    count = int(np.ceil(block.side / COVER_CELL)) + 1 + 2 * MARGIN
    grid = np.zeros((count, count), bool)
    for square, files in scans.items():
        later = join_records([points for scan, points in files if first <= scan < end])
        place = scan_cells(later[~np.isin(later["classification"], NOISE_CLASSES)], square) - corner
        place = place[((place >= 0) & (place < count)).all(axis=1)]
        grid[place[:, 0], place[:, 1]] = True
    closed = closed_by_square(grid, MARGIN)
    place = scan_cells(records, block) - corner
    return np.asarray(closed[place[:, 0], place[:, 1]])


def pair_same(old: Records, new: Records) -> tuple[Mask, Mask]:
    """Masks of the old (N,) and of the new points (M,) that agree in all of `SAME`, paired one to one."""
    records = np.concatenate([old, new])
    is_new = np.arange(len(records)) >= len(old)
    x, y, z = records["xyz"].T
    names = records.dtype["fields"].names or () if "fields" in (records.dtype.names or ()) else ()
    fields = (records["fields"][name] for name in names)
    columns = [x, y, z, *(records[name] for name in SAME[3:]), *fields]
    order = np.lexsort((is_new, *columns))
    starts = np.ones(len(records), bool)
    if len(records):
        starts[1:] = np.any([column[order][1:] != column[order][:-1] for column in columns], axis=0)
    group = np.cumsum(starts) - 1
    count = np.bincount(group)
    fresh = np.bincount(group, weights=is_new[order]).astype(np.int64)
    pairs = np.minimum(fresh, count - fresh)[group]
    rank = np.arange(len(records)) - np.flatnonzero(starts)[group]
    rank = np.where(is_new[order], rank - (count - fresh)[group], rank)
    paired = np.zeros(len(records), bool)
    paired[order] = rank < pairs
    return paired[: len(old)], paired[len(old) :]


def scan_cells(records: Records, block: Block) -> NDArray[np.int64]:
    """World cells (N, 2; column, row) of a block's points."""
    world = records["xyz"][:, :2] * GRID_STEP + np.array(block.origin)
    return np.asarray(np.floor(world / COVER_CELL).astype(np.int64))
