"""Reading once: every point of every file goes to the block it lies in."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from eaves.formats import Chunk, InputError, Source, iter_chunks
from eaves.model import Block, Bounds
from eaves.model.cloud import QUANTUM
from eaves.tiling.store import RECORD, Store

log = logging.getLogger("eaves")


def scatter_points(
    sources: Sequence[Source],
    store: Store,
    side: float,
    bounds: Bounds | None = None,
    clip: BaseGeometry | None = None,
    tell: Callable[[int], None] = lambda points: None,
) -> list[str]:
    """Append every usable point to its block's file; why files could not be read to their end, one line each.

    `bounds` and `clip` are in world metres; points outside them, withheld points and points without a
    position stay out. `tell` hears how many points were read.
    """
    first, unread = 0, []
    for source in sources:
        try:
            for chunk in iter_chunks(source, bounds):
                scatter_chunk(chunk, first, store, side, bounds, clip)
                tell(len(chunk))
        except InputError as error:
            log.error("%s", error)
            unread.append(str(error))
        first += source.count
    return unread


def scatter_chunk(
    chunk: Chunk, first: int, store: Store, side: float, bounds: Bounds | None, clip: BaseGeometry | None
) -> None:
    """Append a chunk's usable points to the files of their blocks; `first` is the id its file begins with."""
    xyz = chunk.xyz
    usable = np.isfinite(xyz).all(axis=1)
    if bounds is not None:
        usable &= bounds.contains(xyz)
    if clip is not None:
        usable &= shapely.contains_xy(clip, xyz[:, 0], xyz[:, 1])
    kept = np.flatnonzero(usable)
    if len(kept) == 0:
        return
    index = np.floor(xyz[kept, :2] / side).astype(np.int64)
    column, row = index.T
    records = np.zeros(len(kept), RECORD)
    local = xyz[kept] - np.column_stack([index * side, np.zeros(len(kept))])
    records["xyz"] = np.round(local / QUANTUM)
    records["point_id"] = chunk.position[kept] + first
    for name, missing in (("return_number", 1), ("number_of_returns", 1), ("classification", 0)):
        values = getattr(chunk, name)
        records[name] = missing if values is None else values[kept]
    order = np.lexsort((row, column))
    changes = np.flatnonzero(np.diff(column[order]) | np.diff(row[order])) + 1
    for group in np.split(order, changes):
        block = Block(int(column[group[0]]), int(row[group[0]]), side)
        store.append_points(block, records[group])
