"""Which points of a block count: heights before images smoothed them, and one point for its neighbours in a
dense scan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.geometry.neighbours import thin_kernel
from eaves.kernels import kernel
from eaves.model import GRID_STEP, Block, Points
from eaves.model.cloud import PER_METRE, canonical_order
from eaves.raster.blur import cell_of, gridded, without_blur
from eaves.run.points import IDENTITY, first_kernel, tied_kernel
from eaves.run.store import Records, join_records

SHARPENED_MARGIN = 30.0
"""Width (m) of the surroundings of a block that are sharpened with it: ten times a blur of 3 m."""


@dataclass(frozen=True, eq=False)
class Smoothed:
    """The points (N, 3) of a block, in metres about its corner, and those around it (M, 3)."""

    own: Points
    around: Points


def inputs_of_sharpened(block: Block, points: Mapping[Block, NDArray[Any]], parameters: object) -> Smoothed:
    """The points of a block and of its surroundings, as they were read."""
    own, around = np.zeros((0, 3)), list[Points]()
    limits = np.array([-SHARPENED_MARGIN, block.side + SHARPENED_MARGIN])
    for square in sorted(points, key=lambda block: (block.row, block.column)):
        xyz = points[square]["xyz"] * GRID_STEP + [*np.subtract(square.origin, block.origin), 0.0]
        if square == block:
            own = xyz
        near = ((xyz[:, :2] >= limits[0]) & (xyz[:, :2] < limits[1])).all(axis=1)
        around.append(xyz[near])
    return Smoothed(own, np.concatenate([own[:0], *around]))


def find_sharpened(view: Smoothed, parameters: SimpleNamespace) -> dict[str, NDArray[Any]]:
    """Heights (N,) of the points of a block, in quanta, by `without_blur` of the surface that they and those
    around show, in cells of one spacing; copies stay copies, for points of a cell are moved alike."""
    if not len(view.own):
        return {}
    cell = cell_of(view.around)
    side = int(np.ceil((np.ptp(view.around[:, :2], axis=0).max() + cell) / cell))
    corner = view.around[:, :2].min(axis=0)
    surface, _ = gridded(view.around, cell, (side, side), (float(corner[0]), float(corner[1])))
    change = without_blur(surface, parameters.blur, cell) - surface
    column, row = np.floor((view.own[:, :2] - corner) / cell).astype(np.int64).T
    quanta = np.round((view.own[:, 2] + change[row, column]) / GRID_STEP)
    return {"z": quanta.astype(np.int32)}


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
AREA_CELL = 0.5
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
    cells = np.zeros((int(np.ceil(block.side / AREA_CELL)),) * 2, np.bool_)
    for records in files:
        cover_kernel(records["xyz"], round(AREA_CELL / GRID_STEP), cells)
    places = np.empty(sum(map(len, files)), np.uint32)
    kept = list[Records]()
    starts = np.cumsum([0, *map(len, files)])[:-1]
    bands = int(np.ceil(block.side / BAND))
    limits = [bands_kernel(records["xyz"], BAND * PER_METRE, bands) for records in files]
    filled = np.flatnonzero(np.diff(np.reshape(limits, (len(files), -1)).sum(axis=0))).tolist()

    def records_in(band: int) -> Records:
        return join_records(
            [file[slice(*rows[band : band + 2])] for file, rows in zip(files, limits, strict=True)]
        )

    def places_in(band: int) -> NDArray[np.int64]:
        return np.concatenate(
            [first + np.arange(*rows[band : band + 2]) for first, rows in zip(starts, limits, strict=True)]
        )

    copies = list[tuple[NDArray[np.int64], NDArray[np.int64]]]()
    example = np.zeros(0, np.int64)
    for band in filled:
        records = records_in(band)
        order = (
            canonical_order(records["xyz"] * GRID_STEP, records["return_number"])
            if len(files) > 1
            else np.arange(len(records))  # those of one file are in canonical order
        )
        places[places_in(band)] = order
        again, original = copies_in(records, order)
        if len(again) and not len(example):
            example = records["point_id"][[original[0], again[0]]]
        copies.append((again, original))
    copied = sum(len(again) for again, _ in copies)
    distinct = len(places) - copied
    dense = distinct > max(ENOUGH_PER_M2 * AREA_CELL**2 * cells.sum(), FEW_PER_M2 * block.side**2)
    if not dense and not copied:
        return {}
    for band, (again, original) in zip(filled, copies, strict=True):
        records = records_in(band)
        here = places_in(band)
        chosen, stands = thin(records, places[here].astype(np.int64), again, original, dense)
        places[here] = stands + sum(map(len, kept))
        kept.append(chosen)
    return {
        "records": join_records(kept).view(np.uint8),
        "stands": places,
        "copies": np.array([copied, *example], np.int64),
    }


def thin(
    records: Records,
    order: NDArray[np.int64],
    again: NDArray[np.int64],
    original: NDArray[np.int64],
    dense: bool,
) -> tuple[Records, NDArray[np.int64]]:
    """Those of some points (N,) that stand for all, in canonical order, and the number (N,) of the one that
    stands for each: `original` (K,) for its copies `again`, and for its neighbours where they are `dense`.
    The canonical `order` is that of all."""
    stands = np.arange(len(records))
    stands[again] = original
    if dense:
        quanta = np.ascontiguousarray(records["xyz"])
        own = np.flatnonzero(stands == np.arange(len(stands)))
        rank = np.searchsorted(own, stands)
        stands = own[thin_kernel(quanta[own], records["return_number"][own], round(SIDE / GRID_STEP))][rank]
    chosen = order[(stands == np.arange(len(stands)))[order]]
    place = np.empty(len(stands), np.int64)
    place[chosen] = np.arange(len(chosen))
    return records.take(chosen), place[stands]


def copies_in(records: Records, order: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The numbers (K,) of those of some points (N,) that are copies, and of what each is a copy of: of
    identical ones (`IDENTITY`) the one with the largest class, for a copy may be classified, then the least
    id. The canonical `order` (N,) is that of all."""
    tied = tied_kernel(records["xyz"], order)
    rows = order[np.union1d(tied, tied + 1)]
    columns = [*records["xyz"][rows].T, *(records[name][rows] for name in IDENTITY)]
    by = np.lexsort((records["point_id"][rows], -records["classification"][rows].astype(int), *columns))
    starts = np.ones(len(rows), bool)
    starts[1:] = np.any([column[by][1:] != column[by][:-1] for column in columns], axis=0)
    first = np.maximum.accumulate(np.where(starts, np.arange(len(rows)), 0))
    again = np.sort(rows[by][~starts])
    originals = np.empty(len(records), np.int64)
    originals[rows[by]] = rows[by][first]
    return again, originals[again]


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
