"""Tiles: the order in which the blocks of a large run are visited, and what stays of those that are finished.

A tile's blocks are computed by the steps of any run, from the one store. What no unfinished tile can reach is
then removed but for the buildings and what the files show of each block; where a long building needs a block
again, its points are read again. So a run by tiles differs from another in its order alone.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eaves.buildings.gather import OwnedBuildings, block_of
from eaves.flow.run import TILE_SIDE, Run
from eaves.flow.step import BUILDINGS, POINTS, REGIONS, SHOWN, STEPS, ensure, squares_read
from eaves.model import Block, Bounds, Failure, Footprint
from eaves.model.block import WIDE_SQUARE, ring, squares_of, squares_touching
from eaves.run.index import Index
from eaves.run.keys import VISITED, code_digest, key_of
from eaves.run.points import BOX_TOLERANCE, number_of
from eaves.run.store import as_arrays, load_part

if TYPE_CHECKING:
    from eaves.flow.region import Region

INPUT_FACTS = ("files", "inputs", "inputs_sha256", "scan")
"""What the plan says of all inputs; a tile follows from those near it."""


def tile_of(block: Block, side: float = TILE_SIDE) -> Block:
    """The tile of a side (m), a whole multiple of the block's, that a block lies in."""
    blocks = round(side / block.side)
    return Block(block.column // blocks, block.row // blocks, side)


@dataclass(frozen=True)
class TileRecord:
    """Record of a finished tile, or of a whole run that has one tile."""

    owners: tuple[Block, ...]
    blocks: tuple[Block, ...]
    """Blocks that the outputs cover."""
    points: int = 0
    read: tuple[Bounds, ...] = ()
    """Extents of everything that was read for it (world metres)."""


@dataclass(frozen=True, eq=False)
class GivenFootprints:
    """Given footprints (world metres), and the ones that cannot be modelled."""

    footprints: Sequence[Footprint] = ()
    lost: Sequence[Failure] = ()


def given_by_tile(run: Run) -> dict[Block, GivenFootprints]:
    """The given footprints that each tile owns, in their order."""
    owned: dict[Block, tuple[list[Footprint], list[Failure]]] = {}

    def lists(place: Footprint | None) -> tuple[list[Footprint], list[Failure]]:
        return owned.setdefault(tile_of(block_of(place, run.first_block), run.tile_side), ([], []))

    for footprint in run.given or ():
        lists(footprint)[0].append(footprint)
    for failure in run.lost:
        lists(failure.footprint)[1].append(failure)
    return {tile: GivenFootprints(*lists) for tile, lists in owned.items()}


def given_in(region: Region, area: Area) -> GivenFootprints:
    """The given footprints that an area owns."""
    if not area.tiles:
        return GivenFootprints(region.run.given or (), region.run.lost)
    parts = [region.given[tile] for tile in area.tiles if tile in region.given]
    return GivenFootprints(
        [footprint for part in parts for footprint in part.footprints],
        [footprint for part in parts for footprint in part.lost],
    )


def plan_tiles(index: Index, side: float, bounds: Bounds | None = None) -> list[Block]:
    """The tiles of a side (m) that the inputs' boxes meet, and the bounds where given, in order."""
    boxes = index.entries["box"][index.entries["count"] > 0]
    if bounds is not None:
        limits = list(bounds)
        boxes = np.hstack([np.maximum(boxes[:, :2], limits[:2]), np.minimum(boxes[:, 2:], limits[2:])])
        boxes = boxes[(boxes[:, :2] <= boxes[:, 2:]).all(axis=1)]
    places = set[tuple[int, int]]()
    for west, south, east, north in np.unique(np.floor(boxes / side).astype(np.int64), axis=0).tolist():
        places.update(product(range(west, east + 1), range(south, north + 1)))
    return [Block(column, row, side) for column, row in sorted(places)]


@dataclass(frozen=True)
class Area:
    """The blocks whose buildings are found together: those of some tiles, or all."""

    tiles: tuple[Block, ...] = ()
    """None in a run in one piece, whose blocks are all in it."""
    failures: int = 0
    """Number of the run's failures before it."""

    def holds(self, block: Block) -> bool:
        """True if a block is in it."""
        return not self.tiles or tile_of(block, self.tiles[0].side) in self.tiles


WHOLE = Area()
"""The area of a run in one piece."""


def areas(region: Region) -> Iterator[Area]:
    """The areas of a run in the order of its work, without the tiles whose buildings are in the store.

    An input whose header puts it elsewhere than its points is found out when it is read; the tiles that its
    points do lie in are then computed with it.
    """
    if not region.run.by_tiles:
        yield WHOLE
        return
    region.within, region.given = set(), given_by_tile(region.run)
    while True:
        tiles = tiles_of_run(region)
        todo = [tile for tile in tiles if not is_visited(region, tile)]
        if not todo:
            return
        step = region.workers.width
        for first in range(0, len(todo), step):
            last = first + step
            region.unfinished = frozenset(todo[last:])
            yield Area(tuple(todo[first:last]), len(region.failed))
            finished = len(tiles) - len(region.unfinished)
            region.progress("tiles", finished, len(tiles))
        region.correct_boxes()


def tiles_of_run(region: Region) -> list[Block]:
    """The tiles that inputs or given footprints lie in, in order."""
    run = region.run
    tiles = set(plan_tiles(run.index, run.tile_side, run.window.bounds))
    return sorted(tiles | region.given.keys())


def squares_of_area(region: Region, area: Area) -> set[Block]:
    """The blocks of an area by tiles, those around them, and those under given footprints that it owns."""
    side = region.run.side
    squares = {square for tile in area.tiles for square in squares_of(tile.bounds.buffered(side), side)}
    for footprint in given_in(region, area).footprints:
        squares |= set(squares_touching(Bounds(*footprint.polygon.bounds), side))
    return squares


def bounds_by_tile(squares: set[Block], side: float) -> list[Bounds]:
    """World metres of some blocks, tile by tile: what lies far apart is no reason to read all between."""
    bounds: dict[Block, Bounds] = {}
    for square in squares:
        tile = tile_of(square, side)
        bounds[tile] = square.bounds.union(bounds.get(tile, square.bounds))
    return [bounds[tile] for tile in sorted(bounds)]


def inputs_meeting(index: Index, places: Sequence[Bounds]) -> NDArray[np.int64]:
    """Numbers of the inputs that may have points in some rectangles (world metres), rising."""
    masks = [index.meeting(bounds.buffered(BOX_TOLERANCE)) for bounds in places]
    return np.flatnonzero(np.any([np.zeros(len(index), bool), *masks], axis=0))


def finish_area(region: Region, area: Area, plans: Sequence[OwnedBuildings]) -> None:
    """Remember what was found of an area, and let go of what no unfinished one can reach."""
    store = region.store
    for tile in area.tiles or [None]:
        part = WHOLE if tile is None else Area((tile,))
        owners = tuple(sorted(plan.owner_block for plan in plans if part.holds(plan.owner_block)))
        blocks = tuple(block for block in region.blocks if part.holds(block))
        region.visits[tile] = TileRecord(owners, blocks, sum(map(store.count_points, blocks)))
    if not area.tiles:
        return
    shown = [block for block in region.blocks if area.holds(block) and store.has(REGIONS.name, block)]
    ensure(region, SHOWN, shown)
    read = tuple(bounds_by_tile(region.within or set(), region.run.tile_side))
    for tile in area.tiles:
        region.visits[tile] = replace(region.visits[tile], read=read)
        region.visited[tile] = key_of_tile(region, tile, read)
        if len(region.failed) == area.failures:
            store.save(VISITED, tile, as_arrays(region.visits[tile]), region.visited[tile])
    evict(region)


VISITING = ("pipeline.py", "flow/region.py", "flow/step.py", "flow/tiles.py")
"""The code that takes a tile through its steps."""


def key_of_tile(region: Region, tile: Block, read: Sequence[Bounds]) -> str:
    """The key of all that the buildings of a tile follow from, of the inputs those near what was read."""
    run = region.run
    code = [code_digest(VISITING), *(step.key(run) for step in STEPS)]
    plan = {name: value for name, value in run.plan.items() if name not in INPUT_FACTS}
    starts = run.index.starts
    inputs = [
        (int(number), int(starts[number]), run.index.mark(int(number)))
        for number in inputs_meeting(run.index, read)
    ]
    return key_of(code, json.dumps(plan, sort_keys=True), tile.name, run.side, run.window, inputs)


def is_visited(region: Region, tile: Block) -> bool:
    """True if the buildings of a tile are known: visited by this run, or by one that was broken off."""
    store, mark = region.store, region.store.mark(VISITED, tile)
    if tile not in region.visited and mark is not None:
        visit: TileRecord = load_part(store.path(VISITED, tile))
        units = {BUILDINGS.name: visit.owners, SHOWN.name: visit.blocks}
        if all(store.has(name, unit) for name, places in units.items() for unit in places):
            region.visits[tile], region.visited[tile] = visit, mark.read
    key = region.visited.get(tile)
    return key is not None and key == key_of_tile(region, tile, region.visits[tile].read)


def evict(region: Region) -> None:
    """Remove points and results that no unfinished tile can reach, but what stays of finished ones; what is
    asked for from then on is brought anew where it is not there."""
    store, side, run = region.store, region.run.side, region.run
    reach = reach_of(run)

    def is_reached(bounds: Bounds) -> bool:
        tiles = squares_of(bounds.buffered(reach), run.tile_side)
        return any(tile in region.unfinished for tile in tiles)

    for step in STEPS:
        if not (step.persistent or step is POINTS):
            for unit in store.units(step.name, step.side or side):
                if not is_reached(unit.bounds):
                    store.remove(step.name, unit)
    for block in store.blocks(side):
        if not is_reached(block.bounds):
            store.remove_points(block)
    for name in list(region.parts):
        if not is_reached(run.index.bounds(number_of(name))):
            store.remove(POINTS.name, Path(name))
            del region.parts[name]
    region.within, region.ensured = set(), {}


def reach_of(run: Run) -> float:
    """Distance (m) beyond a tile of the points that its buildings follow from, but for long ones."""
    squares = squares_of(Block(0, 0, run.tile_side).bounds.buffered(run.side), run.side)
    read = {block for square in squares_read(run, REGIONS, squares) for block in ring(square)}
    return WIDE_SQUARE - min(min(square.bounds.west, square.bounds.south) for square in read)


def by_tile(region: Region, units: Sequence[Any]) -> list[list[Any]]:
    """Units with owner blocks in groups that are computed one after the other: those of a tile, or all."""
    if not region.run.by_tiles:
        return [list(units)]
    groups: dict[Block, list[Any]] = {}
    for unit in units:
        groups.setdefault(tile_of(unit.owner_block, region.run.tile_side), []).append(unit)
    return [groups[tile] for tile in sorted(groups)]
