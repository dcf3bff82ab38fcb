"""What new points change: squares and blocks computed again, from the ground up, as far as results differ.

Each step reaches as far as `ARCHITECTURE.md` states: what is wide by the method's `wide_buffer`, the ground
by its `buffer`, detection by the recipe's `scene_buffer`. Within that, what decks and detection take has a
mark (`eaves.run.mark`): where it is as it was, their result is taken over. Where a step finds what it found
before, it ends.
"""

from __future__ import annotations

import filecmp
import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.change.points import apart, extents_of
from eaves.footprints.read import as_box
from eaves.model import Block, Bounds
from eaves.run.part_file import load_value, open_part
from eaves.run.region import Region
from eaves.run.store import Store, link_file
from eaves.run.wide import TYPES
from eaves.run.world_squares import GROUND_SQUARE, WIDE_SQUARE, squares_of

ROUNDING = 1.0
"""Added to each reach (m): more than any rounding of places, less than matters."""


def link_tree(source: Path, target: Path) -> None:
    """The files of a folder under other names, without taking room where the disk can do that. Parts are
    never written in place, so neither run sees what the other does."""
    for folder, _, names in os.walk(source):
        place = target / Path(folder).relative_to(source)
        place.mkdir(parents=True, exist_ok=True)
        for name in names:
            if not name.startswith("."):
                link_file(Path(folder) / name, place / name)


def compute_stale(
    region: Region, before: Store, places: Mapping[Block, Sequence[Bounds]], blocks: Sequence[Block]
) -> int:
    """Compute again what follows from changed points, and nothing else; how many blocks were.

    Parameters
    ----------
    region
        Its store holds the new points, and everything that was computed of the earlier ones.
    before
        The store of the earlier run.
    places
        World metres of the points that came or went, by block.
    blocks
        The blocks that are used now.
    """
    store, recipe, side = region.store, region.run.recipe, region.run.side
    region.blocks, region.earlier = blocks, before
    touched, changed = set(places), [one for some in places.values() for one in some]
    remove(store, "floors", touched)
    if recipe.sees_wide:
        changed += renew_wide(region, before, changed)
    known = squares_in(store, "ground", GROUND_SQUARE)
    stale = near(known, changed, recipe.ground.buffer)
    stale |= set(squares_of([block.bounds for block in touched], GROUND_SQUARE))
    remove(store, "ground", stale)
    region.find_ground(blocks)
    for square in stale & set(known):
        changed += ground_differences(before, store, square, side)
    again = near(blocks, changed, recipe.scene_buffer) | touched
    remove(store, "blocks", again)
    region.compute_blocks(blocks)
    return sum(not is_same_file(before, store, block) for block in again & set(blocks))


def is_same_file(before: Store, after: Store, block: Block) -> bool:
    """Whether the results of a block were taken over."""
    old, new = before.path("blocks", block), after.path("blocks", block)
    return old.exists() and new.exists() and filecmp.cmp(old, new)


def renew_wide(region: Region, before: Store, places: Sequence[Bounds]) -> list[Bounds]:
    """What is wide, looked for again where it sees changed points; where something else was found."""
    store, recipe = region.store, region.run.recipe
    stale = near(squares_in(store, "squares", WIDE_SQUARE), places, recipe.ground.wide_buffer)
    remove(store, "squares", stale)
    remove(store, "decks", stale)
    region.find_wide(squares_of([block.bounds for block in store.blocks(region.run.side)], GROUND_SQUARE))
    return [
        place
        for square in sorted(stale)
        for kind in ("squares", "decks")
        for place in wide_differences(before.path(kind, square), store.path(kind, square), square)
    ]


def near(squares: Iterable[Block], places: Sequence[Bounds], reach: float) -> set[Block]:
    """The squares that lie within `reach` (m) of some places."""
    some = list(squares)
    if not some or not places:
        return set()
    tree = shapely.STRtree([as_box(place.buffered(reach + ROUNDING)) for place in places])
    return {some[k] for k in np.unique(tree.query([as_box(square.bounds) for square in some])[0])}


def squares_in(store: Store, kind: str, side: float) -> list[Block]:
    """The squares or blocks of a side (m) that a store has results of a kind for."""
    names = sorted(path.stem.split("_") for path in (store.folder / kind).glob("*.npz"))
    return sorted(Block(int(column), int(row), side) for column, row in names)


def remove(store: Store, kind: str, squares: Iterable[Block]) -> None:
    """Remove the results of a kind."""
    for square in squares:
        store.path(kind, square).unlink(missing_ok=True)


def wide_differences(old: Path, new: Path, square: Block) -> list[Bounds]:
    """Where in a square what is wide differs (world metres)."""
    if not old.exists() and not new.exists():
        return []
    if not (old.exists() and new.exists()):
        return [square.bounds]
    if filecmp.cmp(old, new, shallow=False):
        return []
    pair = [load_value(path, TYPES) for path in (old, new)]
    grids = [one[0] if isinstance(one, tuple) and len(one) == 1 else one for one in pair]
    facts = [(one.west, one.north, one.cell) if hasattr(one, "cell") else None for one in grids]
    if facts[0] is None or facts[0] != facts[1]:
        return [square.bounds]
    names = ("ceiling", "terrain", "reached") if hasattr(grids[0], "ceiling") else ("level", "base", "water")
    arrays = [[getattr(one, name) for name in names] for one in grids]
    if any(a.shape != b.shape for a, b in zip(*arrays, strict=True)) or grids[0].doubts != grids[1].doubts:
        return [square.bounds]
    differs = np.zeros(arrays[0][0].shape, bool)
    for a, b in zip(*arrays, strict=True):
        differs |= ~((a == b) | (np.isnan(a) & np.isnan(b)))
    rows, columns = np.nonzero(differs)
    west, north, cell = facts[0]
    corners = np.column_stack([west + columns, north - rows]) * cell
    groups = (corners[some] for some in apart(corners))
    return [Bounds(*(one.min(axis=0)), *(one.max(axis=0) + cell)) for one in groups]


def ground_differences(before: Store, after: Store, square: Block, side: float) -> list[Bounds]:
    """Where in a square points that stayed are another class now (world metres), block by block."""
    found = []
    for block in squares_of([square.bounds], side):
        old, new = ground_of(before, square, block), ground_of(after, square, block)
        _, i, j = np.intersect1d(old[0]["point_id"], new[0]["point_id"], True, return_indices=True)
        differs = (old[1][i] != new[1][j]).any(axis=1)
        found += extents_of(new[0]["xyz"][j[differs]], block)
    return found


def ground_of(store: Store, square: Block, block: Block) -> tuple[NDArray[Any], NDArray[np.uint8]]:
    """The points (N,) of a block in a square, with class and part (N, 2) that the ground stage gave them."""
    records = store.read_points(block)
    with suppress(FileNotFoundError), open_part(store.path("ground", square)) as file:
        if f"class-{block.name}" in file:
            some = records[file[f"number-{block.name}"]]
            parts = f"part-{block.name}"
            part = file[parts] if parts in file else np.zeros(len(some), np.uint8)
            return some, np.column_stack([file[f"class-{block.name}"], part])
    return records[:0], np.zeros((0, 2), np.uint8)
