"""A country tile by tile: each tile is computed on its own, and what they wrote is merged."""

from __future__ import annotations

import json
import logging
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, overload

import numpy as np
import shapely
from numpy.typing import NDArray

from eaves.footprints.read import as_box
from eaves.formats import InputError
from eaves.formats.atomic import DiskFullError
from eaves.model import Block, Bounds, Footprint
from eaves.model.summary import Summary
from eaves.run.ground_squares import seen_from
from eaves.run.index import Index
from eaves.run.join import assign_footprints
from eaves.run.manifest import MANIFEST, begin_manifest, check_folder, end_manifest
from eaves.run.outputs import write_map, write_run
from eaves.run.partition import BOX_TOLERANCE, Window
from eaves.run.region import Core, Region, TooNarrowError, warn_of_wrong_boxes
from eaves.run.review import REVIEW
from eaves.run.rows import BuildingRow
from eaves.run.run import Progress, Run, no_progress
from eaves.run.workers import Workers, peak_memory_mb
from eaves.run.world_squares import within

log = logging.getLogger("eaves")

TILE_BLOCKS = 16
"""Blocks a side of a tile: 3.84 km with blocks of 240 m. Neighbours' blocks are computed again only where a
building crosses over, files on the border are read again: a tenth to a third more work."""
BuildRegion = Callable[[Region, Core], Summary]
"""`eaves.pipeline.build_region`; handed in, for nothing here imports the flow."""
TILES_FOLDER = "tiles"
WANTED = ("footprints", "models", "rasters")
"""What a tile writes on its own; the mask needs the footprints of its neighbours and comes with the merge."""


@dataclass(frozen=True, order=True)
class Tile:
    """Square number (`column`, `row`) of the world grid of tiles."""

    column: int
    row: int
    block: float

    @property
    def side(self) -> float:
        return TILE_BLOCKS * self.block

    @property
    def bounds(self) -> Bounds:
        """World metres."""
        west, south = self.column * self.side, self.row * self.side
        return Bounds(west, south, west + self.side, south + self.side)

    @property
    def name(self) -> str:
        return f"{self.column}_{self.row}"

    def holds(self, block: Block) -> bool:
        """Whether a block is one of the tile's."""
        return block.column // TILE_BLOCKS == self.column and block.row // TILE_BLOCKS == self.row


@dataclass(frozen=True)
class TileDone:
    """What came of a tile."""

    run: dict[str, Any]
    wrong_boxes: dict[int, Bounds]
    """True boxes of inputs whose header lies, by number in the whole index."""


def plan_tiles(index: Index, block: float, bounds: Bounds | None = None) -> list[Tile]:
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
    return [Tile(int(column), int(row), block) for column, row in found]


@dataclass(frozen=True)
class TileTask:
    """A tile with the part of the run that concerns it."""

    tile: Tile
    run: Run
    numbers: tuple[int, ...]
    """The inputs' numbers in the whole index."""
    ring: int = 1
    """So many blocks around the tile can be computed with it."""


class TileTasks(Sequence[TileTask]):
    """The tasks of many tiles, each made when it is asked for: a country's would fill the memory."""

    def __init__(self, run: Run, tiles: Sequence[Tile]) -> None:
        self.run, self.tiles = run, tiles
        self._given = None if run.given is None else FootprintSearch(run.given)
        self._addresses = FootprintSearch(run.addresses)

    def __len__(self) -> int:
        return len(self.tiles)

    @overload
    def __getitem__(self, k: int) -> TileTask: ...
    @overload
    def __getitem__(self, k: slice) -> Sequence[TileTask]: ...
    def __getitem__(self, k: int | slice) -> TileTask | Sequence[TileTask]:
        if isinstance(k, slice):
            return [self[n] for n in range(len(self))[k]]
        return self._make(self.tiles[k])

    def _make(self, tile: Tile, ring: int = 1) -> TileTask:
        """A tile's part of the run: the inputs whose box comes near enough, the footprints likewise."""
        loaded = loaded_with(tile, ring, self.run.recipe.buffer)
        numbers = np.flatnonzero(self.run.index.meeting(seen_with(loaded, self.run).buffered(BOX_TOLERANCE)))
        index = self.run.index.subset(numbers)
        names = tuple(name for name in WANTED if name in ("footprints", *self.run.outputs))
        mine = replace(
            self.run.with_options(outputs=names),
            index=index,
            given=None if self._given is None else self._given.near(loaded),
            addresses=self._addresses.near(loaded),
            plan={**self.run.plan, **index.describe(), "tile": tile.name},
            lost=(),
            failed=(),
        )
        return TileTask(tile, mine, tuple(int(number) for number in numbers), ring)


class FootprintSearch:
    """Footprints (world metres) by place: a country's are too many to look through for every tile."""

    def __init__(self, footprints: Sequence[Footprint]) -> None:
        self._footprints = footprints
        self._tree = shapely.STRtree([footprint.polygon for footprint in footprints])

    def near(self, loaded: Bounds) -> list[Footprint]:
        """Those in or near the bounds of the points loaded, in their order."""
        found = self._tree.query(as_box(loaded.buffered(BOX_TOLERANCE)))
        return [self._footprints[k] for k in np.sort(found)]


def loaded_with(tile: Tile, ring: int, reach: float) -> Bounds:
    """World metres of the points a tile is computed from."""
    return tile.bounds.buffered(ring * tile.block + reach)


def seen_with(loaded: Bounds, run: Run) -> Bounds:
    """World metres of the points that are read for it: the ground is found in squares, from farther away."""
    return seen_from(loaded, run.recipe)


def compute_tile(task: TileTask, folder: Path, build_region: BuildRegion) -> TileDone:
    """One tile with its files in its folder; an earlier run's where it matches."""
    place = folder / TILES_FOLDER / task.tile.name
    earlier = place / "run.json"
    if task.run.options["resume"] and is_whole(place):
        run: dict[str, Any] = json.loads(earlier.read_text(encoding="utf-8"))
        told = json.loads(json.dumps(task.run.plan))
        if not run["incomplete"] and all(run.get(key) == value for key, value in told.items()):
            return TileDone(run, {})
    earlier.unlink(missing_ok=True)
    place.mkdir(parents=True, exist_ok=True)
    ring = task.ring
    while True:
        loaded = loaded_with(task.tile, ring, task.run.recipe.buffer)
        seen = seen_with(loaded, task.run)
        window = Window(within(seen, task.run.window.bounds), task.run.window.clip)
        mine = replace(task.run, folder=place, window=window)
        region = Region(mine, place / ".eaves-work", Workers(), no_progress)
        try:
            summary = build_region(region, Core(task.tile.holds, loaded))
            break
        except TooNarrowError:
            ring += 1
            region.store.discard()
            log.info("tile %s: a building goes on far beyond it; it is computed again", task.tile.name)
    end_manifest(place, summary.files, summary.about, summary.complete)
    run = json.loads((place / "run.json").read_text(encoding="utf-8"))
    assert summary.found == run["found"]
    return TileDone(run, {task.numbers[number]: box for number, box in region.wrong_boxes.items()})


def is_whole(place: Path) -> bool:
    """Whether an earlier run wrote a tile and every file is as it was; one that is not is named."""
    if not (place / MANIFEST).exists():
        return False
    try:
        wrong = check_folder(place)
    except InputError as error:
        wrong = [str(error)]
    for reason in wrong:
        log.warning("%s; the tile is computed again", reason)
    return not wrong


def build_tiles(run: Run, workers: Workers, progress: Progress, build_region: BuildRegion) -> Summary:
    """The whole run, tile by tile: folders `tiles/<column>_<row>`, and over them one footprints.gpkg and one
    virtual raster each of terrain, surface and mask.

    An input whose header puts it elsewhere than its points is found out by the first tile that reads it; the
    tiles it does lie in are then computed with it.
    """
    from eaves.run.merge import merge_footprints, merge_masks, merge_rasters  # late: few runs need rasterio

    folder = run.folder
    if "classified" in run.outputs:
        log.warning("classified points are not written tile by tile; run eaves build --bounds for a part")
    done: dict[Tile, TileDone] = {}
    failed: dict[Tile, str] = {}
    wrong_boxes: dict[int, Bounds] = {}
    work = partial(compute_tile, folder=folder, build_region=build_region)
    peak, index = peak_memory_mb(), run.index
    begin_manifest(folder)
    todo = plan_tiles(index, run.side, run.window.bounds)
    while todo:
        tasks = TileTasks(replace(run, index=index), todo)
        new: dict[int, Bounds] = {}
        for count, outcome in enumerate(workers.run(work, tasks), 1):
            tile = todo[outcome.index]
            peak = max(peak, outcome.peak_mb)
            if outcome.full:
                raise DiskFullError(outcome.error)
            if outcome.answer is None:
                failed[tile] = f"tile {tile.name}: {outcome.error}"
                log.error("%s", failed[tile])
            else:
                done[tile] = outcome.answer
                new |= {k: box for k, box in outcome.answer.wrong_boxes.items() if k not in wrong_boxes}
            progress("tiles", count, len(todo))
        wrong_boxes |= new
        old, index = index, index.with_boxes(new)
        tiles = plan_tiles(index, run.side, run.window.bounds) if new else []
        known = done.keys() | failed.keys()
        todo = [tile for tile in tiles if tile not in known or differs(tile, run, old, index)]
    warn_of_wrong_boxes(run.index, wrong_boxes)
    tiles = [tile for tile in sorted(done) if (folder / TILES_FOLDER / tile.name / "dtm.tif").exists()]
    places = [folder / TILES_FOLDER / tile.name for tile in tiles]
    files = [folder / "footprints.gpkg", folder / REVIEW]
    lost = rows_of_no_tile(run, {*done, *failed})
    doubts = merge_footprints(files[0], places, run.index.system, lost, run.side, run.provenance)
    progress("merge", 1, 3)
    if places:
        merge_masks(files[0], places, run.index.system, workers, run.provenance)
        progress("merge", 2, 3)
        files += merge_rasters(folder, places, run.provenance)
    files.append(write_map(folder, files, run.index.system))
    progress("merge", 3, 3)
    runs = [done[tile].run for tile in sorted(done)]
    reasons = [*run.failed, *failed.values(), *(reason for one in runs for reason in one["incomplete"])]
    files += [folder / TILES_FOLDER / tile.name / MANIFEST for tile in sorted(done)]
    files.append(folder / "run.json")
    missing = Counter(row.code for row in lost)
    runs.append({"found": len(lost), "failures": missing, **{name: {} for name in COUNTED}})
    summary = total_of(runs, run, folder, files, tuple(dict.fromkeys(reasons)), peak)
    summary = replace(summary, run={**summary.run, "doubts": doubts})
    write_run(summary)
    return summary


COUNTED = ("by_lod", "fallbacks", "stage_cpu_seconds")
"""What the sums over all tiles hold, beside the failures."""


def rows_of_no_tile(run: Run, tiles: set[Tile]) -> list[BuildingRow]:
    """The rows of the given footprints that no tile owns: they lie where no input has points."""
    if run.given is None:
        return []
    plans = assign_footprints(run.given, [], run.side, run.lost)
    unowned = set(run.lost)
    return [
        BuildingRow.of(plan.failure, {})
        for one in plans
        for plan in one.buildings
        if plan.failure is not None
        and (plan.failure in unowned or not any(tile.holds(one.owner_block) for tile in tiles))
    ]


def differs(tile: Tile, run: Run, old: Index, new: Index) -> bool:
    """Whether a tile meets other inputs when boxes are corrected."""
    loaded = seen_with(loaded_with(tile, 1, run.recipe.buffer), run).buffered(BOX_TOLERANCE)
    return bool((new.meeting(loaded) & ~old.meeting(loaded)).any())


def total_of(
    runs: Sequence[dict[str, Any]],
    run: Run,
    folder: Path,
    files: Sequence[Path],
    failed: tuple[str, ...],
    peak: float,
) -> Summary:
    """The sums over all tiles."""
    counts: dict[str, Counter[str]] = {name: Counter() for name in ("failures", *COUNTED)}
    for one in runs:
        for name, counter in counts.items():
            counter.update(one[name])
    found = sum(one["found"] for one in runs)
    return Summary(
        folder=folder,
        points=run.index.points,
        found=found,
        modelled=sum(one.get("modelled", 0) for one in runs),
        by_lod=dict(sorted(counts["by_lod"].items(), reverse=True)),
        failures=dict(sorted(counts["failures"].items())),
        fallbacks=dict(sorted(counts["fallbacks"].items())),
        seconds={name: round(value, 3) for name, value in counts["stage_cpu_seconds"].items()},
        elapsed=time.time() - run.started,
        files=tuple(files),
        failed=failed,
        run={
            **run.plan,
            "crs": run.index.system.code,
            "peak_memory_mb": round(peak),
            "tiles": len(runs) - 1,
        },
    )
