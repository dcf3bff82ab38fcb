"""The points of a later scan take the place of earlier ones in the area that they cover."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eaves.formats.atomic import atomic
from eaves.geometry.components import members
from eaves.model import Block, Bounds, Mask
from eaves.model.cloud import GRID_STEP, NOISE_CLASSES
from eaves.raster.squares import closed_by_square
from eaves.run.store import RECORD, SUPERSEDED, Store, extent_of
from eaves.run.world_squares import ring

Records = NDArray[Any]

COVER_CELL = 1.0
"""Cells (m), fixed to the world, in which the new points' area is decided: as fine as a border of tiles
needs, and wide enough that a scan of one point a square metre fills most of them."""

GAP_CELLS = 2
"""Gaps between new points up to twice so many cells wide are covered, too: missing scan lines, dark roofs. In
wider ones (water, the shadow of a tower) nothing new is known, and the earlier points stay."""

APART = 30.0
"""Places that changed are looked at in squares of so much (m): what lies between two is not touched."""

SAME = ("x", "y", "z", "return_number", "number_of_returns", "classification")
"""Two points that agree in these are one: a tile delivered again changes only what differs in it."""


class Replacement:
    """What became of the points of a store when new ones came in; see `replace_points`."""

    def __init__(self) -> None:
        self.places: dict[Block, Sequence[Bounds]] = {}
        """World metres of the points that came or went, by block."""
        self.cells: list[NDArray[np.int64]] = [np.zeros((0, 2), np.int64)]
        """Their cells (K, 2; column, row)."""
        self.superseded: list[NDArray[np.int64]] = []
        self.came = self.went = 0

    def note(self, block: Block, records: Iterable[Records]) -> None:
        """Take down the place of points that came or went."""
        some = [one for one in records if len(one)]
        if some:
            whole = np.concatenate(some)
            self.places[block] = extents_of(whole["xyz"], block)
            self.cells.append(np.unique(cells_of(whole, block), axis=0))


def replace_points(store: Store, first_new: int, side: float) -> Replacement:
    """Remove from a store the points that new ones take the place of; where both agree the earlier one stays.

    What is covered follows from the new points alone: not from the tiles they came in, nor from their order.

    Parameters
    ----------
    store
        With the points of earlier and of new inputs.
    first_new
        Number of the first new input.
    side
        Side of its blocks (m).
    """
    cover = Cover(store, first_new, side)
    done = Replacement()
    near = {one for block in cover.blocks for one in ring(block)}
    for block in sorted(near & set(store.blocks(side))):
        if block not in cover.blocks and not cover.meets(block):
            continue
        files = {path: read_records(path) for path in sorted(store.points_path(block).glob("*.bin"))}
        kept = {path: np.ones(len(records), bool) for path, records in files.items()}
        old = [path for path in files if number_of(path) < first_new]
        new = [path for path in files if number_of(path) >= first_new]
        before, after = joined(files, old), joined(files, new)
        gives_way = cover.holds(before, block)
        same, again = pair_same(before[gives_way], after)
        goes = gives_way.copy()
        goes[gives_way] = ~same
        spread(kept, old, ~goes)
        spread(kept, new, ~again)
        came, went = after[~again], before[goes]
        done.came, done.went = done.came + len(came), done.went + len(went)
        done.note(block, (came, went))
        done.superseded += [went["point_id"], after[again]["point_id"]]
        for path, records in files.items():
            keep_some(path, records, kept[path])
        if not any(store.points_path(block).iterdir()):
            store.points_path(block).rmdir()
    gone = np.sort(np.concatenate([store.superseded(), *done.superseded]))
    with atomic(store.folder / SUPERSEDED) as temporary:
        np.save(temporary, gone)
    return done


class Cover:
    """The area that new points cover: cells of `COVER_CELL` with new points that are not noise, closed."""

    def __init__(self, store: Store, first_new: int, side: float) -> None:
        self._store, self._first_new, self._side = store, first_new, side
        self._cells: dict[Block, NDArray[np.int64]] = {}

    @cached_property
    def blocks(self) -> list[Block]:
        """The blocks that have new points."""
        return [block for block in self._store.blocks(self._side) if self._new_files(block)]

    def _new_files(self, block: Block) -> list[Path]:
        files = self._store.points_path(block).glob("*.bin")
        return sorted(path for path in files if number_of(path) >= self._first_new)

    def cells(self, block: Block) -> NDArray[np.int64]:
        """World cells (K, 2; column, row) of a block's new points."""
        if block not in self._cells:
            found = [np.zeros((0, 2), np.int64)]
            for path in self._new_files(block):
                records = read_records(path)
                found.append(cells_of(records[~np.isin(records["classification"], NOISE_CLASSES)], block))
            self._cells[block] = np.unique(np.concatenate(found), axis=0)
        return self._cells[block]

    def meets(self, block: Block) -> bool:
        """Whether some of a block lies in the area."""
        margin = 2 * GAP_CELLS + 1
        return bool(self._grid(block)[0][margin:-margin, margin:-margin].any())

    def holds(self, records: Records, block: Block) -> Mask:
        """Which of a block's points (N,) lie in the area."""
        closed, first = self._grid(block)
        place = cells_of(records, block) - first
        return np.asarray(closed[place[:, 0], place[:, 1]])

    def _grid(self, block: Block) -> tuple[Mask, NDArray[np.int64]]:
        """The cells of a block and of a margin that lie in the area, and the first of them."""
        margin = 2 * GAP_CELLS + 1
        first = np.floor(np.array(block.origin) / COVER_CELL).astype(np.int64) - margin
        count = int(np.ceil(block.side / COVER_CELL)) + 1 + 2 * margin
        grid = np.zeros((count, count), bool)
        for one in ring(block):
            place = self.cells(one) - first
            place = place[((place >= 0) & (place < count)).all(axis=1)]
            grid[place[:, 0], place[:, 1]] = True
        wide = 2 * GAP_CELLS + 1
        return np.asarray(closed_by_square(grid, wide)), first


def cells_of(records: Records, block: Block) -> NDArray[np.int64]:
    """World cells (N, 2; column, row) of a block's points."""
    world = records["xyz"][:, :2] * GRID_STEP + np.array(block.origin)
    return np.asarray(np.floor(world / COVER_CELL).astype(np.int64))


def extents_of(quanta: NDArray[np.int32], block: Block) -> list[Bounds]:
    """World metres of points (N, 3) in quanta about a block's corner, for each square of `APART`."""
    some = (extent_of(quanta[one], block) for one in apart(quanta * GRID_STEP))
    return [extent for extent in some if extent is not None]


def apart(places: NDArray[np.floating]) -> list[NDArray[np.int64]]:
    """The numbers of places (N, 2 or 3; m) in groups, one for each square of `APART` that holds some."""
    if not len(places):
        return []
    _, group = np.unique(np.floor(places[:, :2] / APART), axis=0, return_inverse=True)
    return members(group.ravel(), int(group.max()) + 1)


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


def number_of(path: Path) -> int:
    """The number of the input that a file of points is of."""
    return int(path.stem.split("-")[0])


def read_records(path: Path) -> Records:
    """The points of a file."""
    return np.fromfile(path, RECORD)


def joined(files: dict[Path, Records], some: Sequence[Path]) -> Records:
    """The points of some files."""
    return np.concatenate([np.zeros(0, RECORD), *(files[path] for path in some)])


def spread(kept: dict[Path, Mask], some: Sequence[Path], values: Mask) -> None:
    """Set the masks of some files from one of all their points."""
    ends = np.cumsum([len(kept[path]) for path in some])[:-1]
    for path, part in zip(some, np.split(values, ends), strict=True) if some else ():
        kept[path] = part


def keep_some(path: Path, records: Records, kept: Mask) -> None:
    """Write some of a file's points in place of all; never into the file itself, which may be another run's
    by a link."""
    if kept.all():
        return
    if not kept.any():
        path.unlink()
        return
    with atomic(path) as temporary:
        temporary.write_bytes(records[kept].tobytes())
