"""Reading once: every point of every file goes to the block it lies in."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from eaves.formats import Source, iter_chunks
from eaves.model import Block, Bounds
from eaves.model.cloud import QUANTUM
from eaves.tiling.store import RECORD, Store


def scatter_points(
    sources: Sequence[Source],
    store: Store,
    side: float,
    bounds: Bounds | None = None,
    clip: BaseGeometry | None = None,
    tell: Callable[[int], None] = lambda points: None,
) -> int:
    """Append every usable point to its block's file; the number of points kept.

    `bounds` and `clip` are in world metres; points outside them, withheld points and points without a
    position stay
    out. `tell` hears how many points were read.
    """
    first, kept = 0, 0
    for source in sources:
        for chunk in iter_chunks(source, bounds):
            xyz = chunk.xyz
            usable = np.isfinite(xyz).all(axis=1)
            if bounds is not None:
                usable &= bounds.contains(xyz)
            if clip is not None:
                usable &= shapely.contains_xy(clip, xyz[:, 0], xyz[:, 1])
            index = np.floor(xyz[:, :2] / side)
            index[~usable] = 0
            column, row = index[:, 0].astype(np.int64), index[:, 1].astype(np.int64)
            records = np.zeros(len(xyz), RECORD)
            local = xyz.copy()
            local[~usable] = 0
            local[:, 0] -= column * side
            local[:, 1] -= row * side
            records["xyz"] = np.round(local / QUANTUM)
            records["point_id"] = chunk.position + first
            for name in ("return_number", "number_of_returns", "classification"):
                values = getattr(chunk, name)
                if values is not None:
                    records[name] = values
            order = np.flatnonzero(usable)
            order = order[np.lexsort((row[order], column[order]))]
            if len(order):
                changes = np.flatnonzero(np.diff(column[order]) | np.diff(row[order])) + 1
                for group in np.split(order, changes):
                    where = Block(int(column[group[0]]), int(row[group[0]]), side)
                    store.append_points(where, records[group])
            kept += len(order)
            tell(len(xyz))
        first += source.count
    return kept
