"""The points of a dense scan, and points that were delivered several times: one stands for its neighbours or
its copies where anything is decided; all are classified."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.geometry.neighbours import thin_kernel
from eaves.kernels import kernel
from eaves.model import GRID_STEP, Block
from eaves.model.cloud import PER_METRE, canonical_order
from eaves.run.partition import IDENTITY
from eaves.run.points import first_kernel
from eaves.run.store import join_records

Records = NDArray[Any]

ENOUGH_PER_M2 = 40.0
"""Points per m² of a surface that decide a building: of a denser scan (overlapping strips, drones, images)
one stands for its neighbours. Twice the density of national surveys, which the methods' numbers are for; from
there on neither time nor memory grow."""
FEW_PER_M2 = 10.0
"""So few points per m² of a whole block cost little, wherever in it they lie."""
SIDE = 0.16
"""Side (m) of the cells, and height of their levels, in which one point stands for the others: of a surface
no more than `ENOUGH_PER_M2` stay. Whole cells fill a block."""
BAND = 4
"""Rows of 1 m cells that are thinned at a time; whole cells of `SIDE` fill them."""
COVER_CELL = 0.5
"""Side (m) of the cells in which is counted how much of a block has points."""


def inputs_of_thinned(
    block: Block, points: Mapping[Block, list[Records]], parameters: object
) -> tuple[Block, list[Records]]:
    """A block with its points, those of each file in canonical order."""
    return block, points[block]


def find_thinned(view: tuple[Block, Sequence[Records]], parameters: object) -> dict[str, NDArray[Any]]:
    """The points that stand for all of a block, in canonical order, as bytes; of all its points, file by
    file, the number (N,) of the one that stands for each; how many are copies of others, with the ids of one
    and of its copy. Nothing where they are not dense, and none is a copy.

    Cells, fixed to the world, hold the points of all files: how these cut the area changes nothing. Memory
    follows the rows in work and what is kept.
    """
    block, files = view
    cells = np.zeros((int(np.ceil(block.side / COVER_CELL)),) * 2, np.bool_)
    for records in files:
        cover_kernel(records["xyz"], round(COVER_CELL / GRID_STEP), cells)
    places = np.empty(sum(map(len, files)), np.uint32)
    kept, count = list[Records](), 0
    places_of_files = np.split(places, np.cumsum([len(records) for records in files])[:-1])
    bands = int(np.ceil(block.side / BAND))
    limits = [bands_kernel(records["xyz"], BAND * PER_METRE, bands) for records in files]

    def band_of(band: int) -> tuple[list[slice], Records]:
        ranges = [slice(*starts[band : band + 2]) for starts in limits]
        return ranges, join_records([file[rows] for file, rows in zip(files, ranges, strict=True)])

    copies, example = 0, np.zeros(0, np.int64)
    ordered = len(files) == 1
    for band in range(bands):
        _, records = band_of(band)
        original = originals_of(records, ordered)
        again = np.flatnonzero(original != np.arange(len(original)))
        if len(again) and not copies:
            example = records["point_id"][[original[again[0]], again[0]]]
        copies += len(again)
    distinct = len(places) - copies
    dense = distinct > max(ENOUGH_PER_M2 * COVER_CELL**2 * cells.sum(), FEW_PER_M2 * block.side**2)
    if not dense and not copies:
        return {}
    for band in range(bands):
        ranges, records = band_of(band)
        if not len(records):
            continue
        chosen, stands = thin(records, copies > 0, dense, ordered)
        pieces = np.split(stands + count, np.cumsum([rows.stop - rows.start for rows in ranges])[:-1])
        for target, rows, piece in zip(places_of_files, ranges, pieces, strict=True):
            target[rows] = piece
        kept.append(chosen)
        count += len(chosen)
    return {
        "records": join_records(kept).view(np.uint8),
        "stands": places,
        "copies": np.array([copies, *example], np.int64),
    }


def thin(records: Records, copied: bool, dense: bool, ordered: bool) -> tuple[Records, NDArray[np.int64]]:
    """Those of some points (N,) that stand for all, in canonical order, and the number (N,) of the one that
    stands for each: for its copies where some are `copied`, for its neighbours where they are `dense`;
    `ordered` as of `originals_of`."""
    quanta = np.ascontiguousarray(records["xyz"])
    stands = originals_of(records, ordered) if copied else np.arange(len(records))
    if dense:
        own = np.flatnonzero(stands == np.arange(len(stands)))
        rank = np.searchsorted(own, stands)
        stands = own[thin_kernel(quanta[own], records["return_number"][own], round(SIDE / GRID_STEP))][rank]
    chosen = np.flatnonzero(stands == np.arange(len(stands)))
    chosen = chosen[canonical_order(quanta[chosen] * GRID_STEP, records["return_number"][chosen])]
    place = np.empty(len(stands), np.int64)
    place[chosen] = np.arange(len(chosen))
    return records.take(chosen), place[stands]


def originals_of(records: Records, ordered: bool) -> NDArray[np.int64]:
    """Of each of some points (N,) the number of the one that it is a copy of, itself where it is none: of
    identical ones (`IDENTITY`) the one with the largest class, for a copy may be classified, then the least
    id. Points of one file are in canonical order, `ordered`."""
    numbers = order = np.arange(len(records))
    if not ordered:
        order = canonical_order(records["xyz"] * GRID_STEP, records["return_number"])
    x, y, z = (column if ordered else column[order] for column in records["xyz"].T)
    tied = np.flatnonzero((x[1:] == x[:-1]) & (y[1:] == y[:-1]) & (z[1:] == z[:-1]))
    if not len(tied):
        return numbers
    rows = order[np.union1d(tied, tied + 1)]
    columns = [*records["xyz"][rows].T, *(records[name][rows] for name in IDENTITY)]
    by = np.lexsort((records["point_id"][rows], -records["classification"][rows].astype(int), *columns))
    starts = np.ones(len(rows), bool)
    starts[1:] = np.any([column[by][1:] != column[by][:-1] for column in columns], axis=0)
    first = np.maximum.accumulate(np.where(starts, np.arange(len(rows)), 0))
    numbers[rows[by]] = rows[by][first]
    return numbers


@kernel
def cover_kernel(quanta: NDArray[np.int32], side: int, cells: NDArray[np.bool_]) -> None:
    """Mark the cells of a side (quanta) that hold any of the points (N, 3) of a block."""
    for i in range(len(quanta)):
        cells[quanta[i, 1] // side, quanta[i, 0] // side] = True


@kernel
def bands_kernel(quanta: NDArray[np.int32], height: int, count: int) -> NDArray[np.int64]:
    """Where each of `count` bands of a height (quanta) begins among points (N, 3) in canonical order, and
    where the last one ends, (count + 1,)."""
    starts = np.empty(count + 1, np.int64)
    for band in range(count + 1):
        starts[band] = first_kernel(quanta, 1, band * height, 0, len(quanta))
    return starts
