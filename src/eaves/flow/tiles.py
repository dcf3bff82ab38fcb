"""A country tile by tile: each tile is computed on its own, and what they wrote is merged."""

from __future__ import annotations

import json
import logging
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.blocks.ground import seen_from
from eaves.buildings.join import assign_footprints
from eaves.figures.rows import BuildingRow
from eaves.flow.outputs import COUNTED, summary_of, write_map, write_run
from eaves.flow.review import REVIEW
from eaves.flow.run import Progress, Run
from eaves.footprints.read import as_box
from eaves.formats import InputError
from eaves.model import Block, Bounds, Footprint, Mask
from eaves.model.summary import Summary
from eaves.run.code import package_sources
from eaves.run.index import Index
from eaves.run.keys import modules_of
from eaves.run.manifest import MANIFEST, check_folder, read_facts
from eaves.run.partition import BOX_TOLERANCE, Window
from eaves.run.workers import Outcome, Workers, peak_memory_mb
from eaves.run.world_squares import within

log = logging.getLogger("eaves")

TILE_BLOCKS = 16
"""Blocks a side of a tile: 3.84 km with blocks of 240 m. Neighbours' blocks are computed again only where a
building crosses over, files on the border are read again: a tenth to a third more work."""
TILES_FOLDER = "tiles"
WANTED = ("footprints", "models", "rasters")
"""Outputs that a tile writes on its own; the mask needs the footprints of its neighbours and comes with the
merge."""


TileDone = tuple[dict[str, Any], dict[int, Bounds]]
"""The facts of a tile's run, and true boxes of inputs whose header is wrong, by number in the whole index."""


def tile_of(block: Block) -> Block:
    """The square of the world grid of tiles that a block lies in."""
    return Block(block.column // TILE_BLOCKS, block.row // TILE_BLOCKS, TILE_BLOCKS * block.side)


def plan_tiles(index: Index, block: float, bounds: Bounds | None = None) -> list[Block]:
    """The tiles that the inputs' boxes meet, and the bounds where given, in order."""
    side = TILE_BLOCKS * block
    west, south, east, north = (index.entries["box"][index.entries["count"] > 0]).T
    if bounds is not None:
        west, south = np.maximum(west, bounds.west), np.maximum(south, bounds.south)
        east, north = np.minimum(east, bounds.east), np.minimum(north, bounds.north)
        meets = (west <= east) & (south <= north)
        west, south, east, north = west[meets], south[meets], east[meets], north[meets]
    first = np.floor(np.column_stack([west, south]) / side).astype(np.int64)
    last = np.floor(np.column_stack([east, north]) / side).astype(np.int64)
    found: NDArray[np.int64] = np.zeros((0, 2), np.int64)
    across = (last - first).max(axis=0, initial=0)
    for column in range(int(across[0]) + 1):
        for row in range(int(across[1]) + 1):
            here = first + [column, row]
            found = np.unique(np.concatenate([found, here[(here <= last).all(axis=1)]]), axis=0)
    return [Block(int(column), int(row), side) for column, row in found]


@dataclass(frozen=True)
class TileTask:
    """A tile with the part of the run that concerns it."""

    tile: Block
    run: Run
    numbers: tuple[int, ...]
    """The inputs' numbers in the whole index."""
    window: Window
    """Of the whole run."""
    ring: int = 1
    """Number of rings of blocks around the tile that can be computed with it."""

    def holds(self, block: Block) -> bool:
        """True if a block is one of the tile's."""
        return tile_of(block) == self.tile

    @property
    def loaded(self) -> Bounds:
        """World metres of the points that it is computed from."""
        return loaded_with(self.tile, self.ring, self.run.recipe.buffer)

    def done(self, wrong_boxes: Mapping[int, Bounds]) -> TileDone:
        """Its result, with the true boxes of inputs, by number in its own index."""
        return read_facts(self.run.folder), {self.numbers[number]: box for number, box in wrong_boxes.items()}


def with_ring(task: TileTask, ring: int) -> TileTask:
    """A task with so many blocks around its tile, and the points that these need."""
    task = replace(task, ring=ring)
    bounds = within(seen_from(task.loaded, task.run.recipe, task.run.side), task.window.bounds)
    return replace(task, run=replace(task.run, window=Window(bounds, task.window.clip)))


def widened(task: TileTask) -> TileTask:
    """A task with one more ring of blocks: a building goes on beyond those that it had."""
    log.info("tile %s: a building goes on far beyond it; it is computed again", task.tile.name)
    return with_ring(task, task.ring + 1)


class TileTasks(Sequence[TileTask]):
    """The tasks of many tiles, each made when it is asked for: a country's would fill the memory."""

    def __init__(self, run: Run, tiles: Sequence[Block]) -> None:
        self.run, self.tiles = run, tiles
        self._given = None if run.given is None else FootprintSearch(run.given)
        self._addresses = FootprintSearch(run.addresses)
        self.code = package_sources().digest(["eaves.pipeline", *modules_of(run.recipe)])

    def __len__(self) -> int:
        return len(self.tiles)

    def __getitem__(self, k: Any) -> Any:
        """A tile's part of the run: the inputs whose box comes near enough, the footprints likewise."""
        tile = self.tiles[k]
        loaded = loaded_with(tile, 1, self.run.recipe.buffer)
        numbers = np.flatnonzero(inputs_near(loaded, self.run, self.run.index))
        index = self.run.index.subset(numbers)
        names = tuple(name for name in WANTED if name in ("footprints", *self.run.outputs))
        own = replace(
            self.run.with_options(outputs=names),
            folder=self.run.folder / TILES_FOLDER / tile.name,
            index=index,
            given=None if self._given is None else self._given.near(loaded),
            addresses=self._addresses.near(loaded),
            plan={**self.run.plan, **index.describe(), "code": self.code, "tile": tile.name},
            lost=(),
            failed=(),
        )
        task = TileTask(tile, own, tuple(int(number) for number in numbers), self.run.window)
        return with_ring(task, 1)


class FootprintSearch:
    """Footprints (world metres) by place: a country's are too many to look through for every tile."""

    def __init__(self, footprints: Sequence[Footprint]) -> None:
        self._footprints = footprints
        self._tree = shapely.STRtree([footprint.polygon for footprint in footprints])

    def near(self, loaded: Bounds) -> list[Footprint]:
        """Those in or near the bounds of the points loaded, in their order."""
        found = self._tree.query(as_box(loaded.buffered(BOX_TOLERANCE)))
        return [self._footprints[k] for k in np.sort(found)]


def loaded_with(tile: Block, ring: int, reach: float) -> Bounds:
    """World metres of the points a tile is computed from."""
    return tile.bounds.buffered(ring * tile.side / TILE_BLOCKS + reach)


def inputs_near(loaded: Bounds, run: Run, index: Index) -> Mask:
    """Mask (F,) of the inputs that may hold points that a tile is computed from: the ground is found in
    squares, from farther away."""
    return index.meeting(seen_from(loaded, run.recipe, run.side).buffered(BOX_TOLERANCE))


def known_tile(task: TileTask) -> TileDone | None:
    """The files that an earlier run wrote of a tile, where it matches; None where it is to be computed."""
    place = task.run.folder
    if task.run.options["resume"] and is_whole(place):
        run = read_facts(place)
        words = json.loads(json.dumps(task.run.plan))
        if not run["incomplete"] and all(run.get(key) == value for key, value in words.items()):
            return run, {}
    place.mkdir(parents=True, exist_ok=True)
    return None


def is_whole(place: Path) -> bool:
    """True if an earlier run wrote a tile and every file is unchanged; warns of one that is not."""
    if not (place / MANIFEST).exists():
        return False
    try:
        wrong = check_folder(place)
    except InputError as error:
        wrong = [str(error)]
    for reason in wrong:
        log.warning("%s; the tile is computed again", reason)
    return not wrong


class Tiles:
    """The tiles of a run on their way: which are to be computed, and what came of the others."""

    def __init__(self, run: Run) -> None:
        self.run, self.index = run, run.index
        self.done: dict[Block, dict[str, Any]] = {}
        self.failed: dict[Block, str] = {}
        self.wrong_boxes: dict[int, Bounds] = {}
        self.peak = peak_memory_mb()
        self.todo = plan_tiles(self.index, run.side, run.window.bounds)
        self._new: dict[int, Bounds] = {}
        if "classified" in run.outputs:
            log.warning("classified points are not written tile by tile; run eaves build --bounds for a part")

    def tasks(self) -> TileTasks:
        """Those to be computed, with all that they need."""
        return TileTasks(replace(self.run, index=self.index), self.todo)

    def note(self, outcome: Outcome) -> None:
        """Take down what came of a tile."""
        tile = self.todo[outcome.index]
        self.peak = max(self.peak, outcome.peak_mb)
        if outcome.answer is None:
            self.failed[tile] = f"tile {tile.name}: {outcome.error}"
            log.error("%s", self.failed[tile])
        else:
            self.done[tile], boxes = outcome.answer
            self._new |= {number: box for number, box in boxes.items() if number not in self.wrong_boxes}

    def look_again(self) -> None:
        """Find the tiles that meet other inputs now that the true boxes of some are known."""
        new, self._new = self._new, {}
        self.wrong_boxes |= new
        old, self.index = self.index, self.index.with_boxes(new)
        tiles = plan_tiles(self.index, self.run.side, self.run.window.bounds) if new else []
        known = self.done.keys() | self.failed.keys()
        self.todo = [one for one in tiles if one not in known or differs(one, self.run, old, self.index)]

    def merge(self, workers: Workers, progress: Progress) -> Summary:
        """Put together what the tiles wrote."""
        from eaves.flow.merge import merge_footprints, merge_masks, merge_rasters  # late: needs rasterio

        run, folder = self.run, self.run.folder
        files = [folder / "footprints.gpkg", folder / REVIEW]
        places = [folder / TILES_FOLDER / tile.name for tile in sorted(self.done)]
        with_terrain = [place for place in places if (place / "dtm.tif").exists()]
        lost = rows_of_no_tile(run, {*self.done, *self.failed})
        doubts = merge_footprints(files[0], with_terrain, run.index.system, lost, run.side, run.provenance)
        progress("merge", 1, 3)
        if with_terrain:
            merge_masks(files[0], with_terrain, run.index.system, workers, run.provenance)
            progress("merge", 2, 3)
            files += merge_rasters(folder, with_terrain, run.provenance)
        files.append(write_map(folder, files, run.index.system))
        progress("merge", 3, 3)
        files += [place / MANIFEST for place in places]
        files.append(folder / MANIFEST)
        summary = self._summary(lost, files)
        summary = replace(summary, run={**summary.run, "doubts": doubts})
        write_run(summary)
        return summary

    def _summary(self, lost: Sequence[BuildingRow], files: Sequence[Path]) -> Summary:
        """The sums over all tiles, and the buildings of none."""
        runs = [self.done[tile] for tile in sorted(self.done)]
        failed = [*self.run.failed, *self.failed.values()]
        failed += [reason for one in runs for reason in one["incomplete"]]
        counts = {name: Counter[str]() for name in (*COUNTED, "seconds")}
        counts["trust"]["low"] += len(lost)
        counts["failures"].update(row.code for row in lost if row.code)
        for one in runs:
            for name, counter in counts.items():
                counter.update(one["stage_cpu_seconds" if name == "seconds" else name])
        counts["seconds"] = Counter({name: round(value, 3) for name, value in counts["seconds"].items()})
        return summary_of(
            self.run,
            counts,
            points_used=sum(one["points_used"] for one in runs),
            found=sum(one["found"] for one in runs) + len(lost),
            files=tuple(files),
            failed=tuple(dict.fromkeys(failed)),
            words={"peak_memory_mb": round(self.peak), "tiles": len(runs)},
        )


def rows_of_no_tile(run: Run, tiles: set[Block]) -> list[BuildingRow]:
    """The rows of the given footprints that no tile owns: they lie where no input has points."""
    if run.given is None:
        return []
    plans = assign_footprints(run.given, [], run.side, run.lost)
    unowned = set(run.lost)
    return [
        BuildingRow.of(plan.failure, {})
        for one in plans
        for plan in one.buildings
        if plan.failure is not None and (plan.failure in unowned or tile_of(one.owner_block) not in tiles)
    ]


def differs(tile: Block, run: Run, old: Index, new: Index) -> bool:
    """True if a tile meets other inputs when boxes are corrected."""
    loaded = loaded_with(tile, 1, run.recipe.buffer)
    return bool((inputs_near(loaded, run, new) & ~inputs_near(loaded, run, old)).any())
