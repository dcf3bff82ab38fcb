"""From files to files in one region: scatter, block pass, join, building pass, outputs."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from eaves.formats import InputError
from eaves.formats.disk import DiskFullError
from eaves.model import Block, Bounds, Failure, Footprint
from eaves.pipeline import (
    CELL,
    BuildingPoints,
    BuildingResult,
    Clock,
    Recipe,
    block_pass,
    building_pass,
    draw_footprints,
)
from eaves.tiling.addresses import split_buildings, with_addresses
from eaves.tiling.gather import Gatherer
from eaves.tiling.index import Index
from eaves.tiling.join import HomePlan, Seam, assign_footprints, blocks_beyond, blocks_under, join_regions
from eaves.tiling.outputs import EVERYTHING, Summary, write_outputs
from eaves.tiling.point_labels import Listener
from eaves.tiling.runners import Outcome, Workers, peak_memory_mb
from eaves.tiling.scatter import Part, Window, earlier, parts_of, scatter_part
from eaves.tiling.store import Store
from eaves.tiling.strays import stray_blocks

log = logging.getLogger("eaves")

LARGEST_RASTER = 10**10
"""Cells of a raster in one file: 50 km by 50 km. Empty ones cost time, too."""
Tell = Callable[[str, int, int], None]
"""Hears progress: stage, done, total."""


@dataclass(frozen=True, eq=False)
class Job:
    """What is to be computed: picklable, so that a worker can do a tile on its own."""

    index: Index
    recipe: Recipe
    side: float
    window: Window
    plan: dict[str, Any]
    """What decides the result (build.describe)."""
    given: Sequence[Footprint] | None = None
    snap: bool = False
    addresses: Sequence[Footprint] = ()
    """What lies between known party walls; detected blocks are split into them."""
    resume: bool = False
    formats: tuple[str, ...] = ()
    outputs: tuple[str, ...] = EVERYTHING
    classified: Path | None = None
    failed: tuple[str, ...] = ()
    started: float = 0.0


class TooNarrowError(Exception):
    """A building of the core goes on beyond the blocks that were loaded."""


@dataclass(frozen=True)
class Core:
    """The blocks whose buildings and rasters are wanted, and where blocks can be computed."""

    holds: Callable[[Block], bool]
    loaded: Bounds | None = None

    def reaches(self, block: Block) -> bool:
        """Whether all points the block is computed from were loaded."""
        if self.loaded is None:
            return True
        bounds = block.bounds
        return self.loaded.union(bounds) == self.loaded


class Region:
    """A run over the points of a job; failures, peak memory and boxes that lie are noted on the way."""

    def __init__(self, job: Job, folder: Path, work_folder: Path, workers: Workers, tell: Tell) -> None:
        self.job, self.folder, self.workers, self.tell = job, folder, workers, tell
        self.failed: list[str] = list(job.failed)
        self.peak = peak_memory_mb()
        self.lying: dict[int, Bounds] = {}
        self.store = Store(
            work_folder,
            has_returns=job.index.has_field("return_number"),
            has_classes=job.index.has_field("classification"),
            system=job.index.system,
        )

    def compute(self, core: Core, listener: Listener | None = None) -> Summary:
        """Everything, up to the files; the working folder goes when nothing failed. `listener` hears
        the classified points.

        Raises
        ------
        TooNarrowError
            When the bounds loaded do not hold the core's buildings.
        """
        self.open_store()
        self.scatter()
        blocks = self.used_blocks()
        self.check_rasters(blocks)
        if not any(map(core.holds, blocks)):
            log.warning("no points left to use: see the bounds, the clip area and the files")
        homes = self.join(blocks, core)
        self.model([home for home in homes if core.holds(home.home)])
        summary = write_outputs(
            self.store,
            self.job.index,
            [block for block in blocks if core.holds(block)],
            [home.home for home in homes if core.holds(home.home)],
            self.folder,
            run={
                **self.job.plan,
                "crs": self.job.index.system.code,
                "peak_memory_mb": round(max(self.peak, peak_memory_mb())),
            },
            failed=self.failed,
            wanted=self.job.outputs,
            formats=self.job.formats,
            classified=self.job.classified,
            started=self.job.started,
            tell=self.tell,
            workers=self.workers,
            listener=listener,
        )
        if summary.complete:
            self.store.discard()
        return summary

    def open_store(self) -> None:
        """Keep the parts of an earlier run that match, or start anew."""
        if not (self.job.resume and self.store.matches(self.job.plan)):
            self.store.discard()
            self.store.prepare()
            self.store.keep_plan(self.job.plan)

    def scatter(self) -> None:
        """Bring all points that are not yet there to their blocks."""
        parts = parts_of(self.job.index)
        before = {part.name: mark for part in parts if (mark := earlier(part, self.store))}
        todo = [part for part in parts if before.get(part.name, (0, "new"))[1] is not None]
        total, read = self.job.index.points, sum(mark[0] for mark in before.values() if mark[1] is None)

        def read_more(points: int) -> None:
            nonlocal read
            read += points
            self.tell("read", min(read, total), total)

        work = partial(scatter_part, store=self.store, side=self.job.side, window=self.job.window)
        workers = self.workers
        if workers.alone or len(todo) == 1:
            work, workers = partial(work, tell=read_more), Workers()
        unread: dict[int, str] = {}
        changed = False
        for outcome in workers.run(work, todo):
            part: Part = todo[outcome.index]
            if outcome.answer is None:
                self.note(outcome, str(part.path))
                unread[part.number] = self.failed.pop()
                continue
            done = outcome.answer
            changed |= before.get(part.name) != (done.records, done.unread)
            if done.unread is not None and part.number not in unread:
                log.error("%s", done.unread)
                unread[part.number] = done.unread
            if done.box is not None:
                self.lying[part.number] = self.lying.get(part.number, done.box).union(done.box)
            if workers is self.workers:
                read_more(done.records)
        if changed:  # what was computed of fewer points no longer holds
            self.store.forget("blocks")
            self.store.forget("buildings")
        if unread and len(unread) == len(self.job.index):
            self.refuse(next(iter(unread.values())))
        self.failed += unread.values()

    def used_blocks(self) -> list[Block]:
        """The blocks that have points, without those that hold nothing but strays."""
        blocks = self.store.blocks(self.job.side)
        strays = stray_blocks(self.store, blocks)
        if strays:
            log.warning(
                "%d points in %d blocks far from all others are left out as strays; where they are a survey, "
                "check its coordinates",
                sum(strays.values()),
                len(strays),
            )
        return [block for block in blocks if block not in strays]

    def check_rasters(self, blocks: Sequence[Block]) -> None:
        """Refuse the run when its rasters would be too large."""
        if not blocks or not {"rasters", "mask"} & set(self.job.outputs):
            return
        spans = np.ptp([(block.column, block.row) for block in blocks], axis=0) + 1
        width, height = (spans * self.job.side / CELL).round().astype(int).tolist()
        if width * height > LARGEST_RASTER:
            self.refuse(
                f"{self.folder}: the rasters would have {width:,} by {height:,} cells; check the "
                "coordinates of the inputs, or build their regions apart with --per-tile or --bounds"
            )

    def refuse(self, reason: str) -> NoReturn:
        """End the run for its inputs' sake; nothing of it stays."""
        self.store.discard()
        raise InputError(reason)

    def join(self, blocks: Sequence[Block], core: Core) -> list[HomePlan]:
        """Compute the blocks of the core, and others as its buildings go on into them; the buildings."""
        there, tried = set(blocks), set[Block]()
        todo = [block for block in blocks if core.holds(block)]
        while todo:
            self.compute_blocks(todo)
            tried |= set(todo)
            if core.loaded is None:  # all blocks are the core's
                break
            seams = self.seams(sorted(tried))
            beyond = blocks_beyond(seams, core.holds)
            if self.job.given is not None:
                beyond |= blocks_under(self.job.given, self.job.side, core.holds)
            if not all(map(core.reaches, beyond - tried)):
                raise TooNarrowError
            todo = sorted((beyond & there) - tried)
        if self.job.given is not None:
            homes = assign_footprints(self.job.given, blocks) if blocks else []
            left_out = len(self.job.given) - sum(len(home.buildings) for home in homes)
            if left_out and core.loaded is None:  # of a tile's some are its neighbours'
                log.warning("%d footprints lie far from all points, left out", left_out)
            return homes
        return with_addresses(join_regions(self.seams(sorted(tried))), self.job.addresses)

    def seams(self, blocks: Sequence[Block]) -> list[Seam]:
        """What the join needs of all blocks that could be computed."""
        seams = []
        for block in blocks:
            if self.store.has("blocks", block):
                with self.store.open_block(block) as file:
                    seams.append(Seam.read(file))
        return seams

    def compute_blocks(self, blocks: Sequence[Block]) -> None:
        """The block pass for those blocks that have not been computed."""
        left = [block for block in blocks if not self.store.has("blocks", block)]
        if left:  # what was joined without them no longer holds
            self.store.forget("buildings")
        left = self.workers.heaviest_first(left, self.store.count_points)
        work = partial(compute_block, store=self.store, recipe=self.job.recipe)
        for done, outcome in enumerate(self.workers.run(work, left), 1):
            self.note(outcome, f"block {left[outcome.index].name}")
            self.tell("blocks", done, len(left))

    def model(self, homes: Sequence[HomePlan]) -> None:
        """The building pass for those home blocks that have not been computed."""
        left = [home for home in homes if not self.store.has("buildings", home.home)]
        left = self.workers.heaviest_first(left, lambda home: len(home.buildings))
        work = partial(compute_home, store=self.store, recipe=self.job.recipe, snap=self.job.snap)
        for done, outcome in enumerate(self.workers.run(work, left), 1):
            self.note(outcome, f"buildings of block {left[outcome.index].home.name}")
            self.tell("buildings", done, len(left))

    def note(self, outcome: Outcome, what: str) -> None:
        """Remember the peak memory of a task, and its error for the report.

        Raises
        ------
        DiskFullError
            When that was the error: there is no use in going on.
        """
        self.peak = max(self.peak, outcome.peak_mb)
        if outcome.full:
            raise DiskFullError(outcome.error)
        if outcome.error:
            self.failed.append(f"{what}: {outcome.error}")
            log.error("%s", self.failed[-1])


def warn_of_boxes(index: Index, lying: dict[int, Bounds]) -> None:
    """One warning for all files whose points lie outside the box their header states."""
    if lying:
        first = min(lying)
        log.warning(
            "%d files have points outside the bounding box of their header (the first: %s); the points are "
            "used where they are",
            len(lying),
            index.path(first),
        )


def get_ready(recipe: Recipe) -> None:
    """Nothing: what a worker needs is imported by the time it knows this function and the methods."""


def compute_block(block: Block, store: Store, recipe: Recipe) -> None:
    """The block pass for one block, kept in the store."""
    store.save_block(block_pass(store.load_cloud(block, recipe.reach), block, recipe))


def compute_home(plan: HomePlan, store: Store, recipe: Recipe, snap: bool = False) -> None:
    """The building pass for the buildings at home in one block, kept in the store."""
    gatherer = Gatherer(store)
    if snap:
        plan = gatherer.snapped(plan)
    gathered = [gatherer.gather(plan.home, building) for building in plan.buildings]
    results = [BuildingResult.without_points(none) for none in gathered if isinstance(none, Failure)]
    buildings = [building for building in gathered if not isinstance(building, Failure)]
    clock = Clock()
    footprints = draw_all(buildings, recipe)
    buildings, footprints = split_buildings(buildings, footprints, plan.addresses, recipe.units)
    clock.lap("outline")
    for building, footprint in zip(buildings, footprints, strict=True):
        try:
            results.append(building_pass(building, footprint, recipe))
        except Exception as error:  # one building must not take the others of its block with it
            log.warning("a building of block %s failed: %s: %s", plan.home.name, type(error).__name__, error)
            log.debug("traceback", exc_info=True)
            results.append(BuildingResult.broken(building, error))
    if results:
        results[0].seconds.update(clock.laps)
    store.save_buildings(plan.home, results)


def draw_all(buildings: list[BuildingPoints], recipe: Recipe) -> list[Footprint | Failure]:
    """The footprints of a block's buildings together; one by one where one of them breaks the others."""
    try:
        return draw_footprints(buildings, recipe)
    except Exception as error:  # as in compute_home: the others must not go with it
        if len(buildings) == 1:
            log.debug("traceback", exc_info=True)
            return [Failure("internal_error", f"{type(error).__name__}: {error}", "outline")]
        return [draw_all([building], recipe)[0] for building in buildings]


def everywhere(
    job: Job, folder: Path, workers: Workers, tell: Tell, listener: Listener | None = None
) -> Summary:
    """The whole job as one region; `listener` hears the classified points."""
    name = ".eaves-work" if job.classified is None else f".eaves-work-{job.classified.stem}"
    if job.index.spans_blocks(job.side, job.window.bounds):
        workers.start(partial(get_ready, job.recipe))
    region = Region(job, folder, folder / name, workers, tell)
    summary = region.compute(Core(holds=lambda block: True), listener)
    warn_of_boxes(job.index, region.lying)
    return summary
