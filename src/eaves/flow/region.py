"""A region of points and the steps that it goes through; `eaves.pipeline` names them in their order."""

from __future__ import annotations

import json
import logging
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, NoReturn

import numpy as np

from eaves.buildings.join import (
    OwnedBuildings,
    Seam,
    assign_footprints,
    blocks_beyond,
    blocks_under,
    join_regions,
    with_addresses,
)
from eaves.flow.numbers import NUMBERS
from eaves.flow.refusals import copies_records
from eaves.flow.run import Progress, Run, no_progress, request_of
from eaves.flow.step import Step, bring, compute, results_of
from eaves.flow.steps import BUILDINGS, EDITED, FLOORS, REGIONS, SUPERSEDED
from eaves.formats import InputError
from eaves.formats.atomic import DiskFullError, atomic
from eaves.model import Block, Bounds
from eaves.raster.surfaces import CELL
from eaves.recipe.recipe import Recipe
from eaves.run.clock import Budget
from eaves.run.index import Index
from eaves.run.keys import NAMED, key_of
from eaves.run.partition import (
    FileSlice,
    file_slices,
    find_isolated_blocks,
    key_of_part,
    keys_of_points,
    known_parts,
    partition_slice,
)
from eaves.run.store import Store
from eaves.run.workers import Outcome, Workers, peak_memory_mb
from eaves.run.world_squares import ring

log = logging.getLogger("eaves")

LARGEST_RASTER = 10_000_000_000
"""Cells of a raster in one file: 50 km by 50 km. Empty ones cost time, too."""


REQUEST = "request.json"
"""Beside the results that are kept: what the run was asked for; run.json lacks it while files are written."""
EARLIER = "earlier"
"""Folder, beside the results of a run that is updated in its place, of those that it shows until then."""


class TooNarrowError(Exception):
    """A building of the core goes on beyond the blocks that were loaded."""


@dataclass(frozen=True)
class Core:
    """The blocks whose buildings and rasters are wanted, and where blocks can be computed."""

    holds: Callable[[Block], bool] = lambda block: True
    loaded: Bounds | None = None

    def reaches(self, block: Block) -> bool:
        """True if all points the block is computed from were loaded."""
        return self.loaded is None or self.loaded.union(block.bounds) == self.loaded


@dataclass(eq=False)
class Region:
    """A run's points, or a tile's, and what is noted as they go through the steps."""

    run: Run
    store: Store
    workers: Workers = field(default_factory=Workers)
    progress: Progress = no_progress
    core: Core = field(default_factory=Core)
    failed: list[str] = field(default_factory=list)
    peak: float = field(default_factory=peak_memory_mb)
    budget: Budget = field(default_factory=Budget)
    wrong_boxes: dict[int, Bounds] = field(default_factory=dict)
    points: int = 0
    """Of the inputs, without those that could not be read."""
    blocks: Sequence[Block] = ()
    """Those that have points, without those that hold nothing but isolated."""
    points_keys: Mapping[str, str] = field(default_factory=dict)
    """Block, by its name → the key of its points."""
    brought: dict[str, set[Block]] = field(default_factory=dict)
    """Step, by its name → the squares whose results are there."""

    @property
    def own_blocks(self) -> list[Block]:
        """The blocks of the core."""
        return [block for block in self.blocks if self.core.holds(block)]

    @cached_property
    def used(self) -> frozenset[Block]:
        """The blocks that are used."""
        return frozenset(self.blocks)

    @cached_property
    def with_points(self) -> frozenset[Block]:
        """The blocks that have points, also those that hold nothing but isolated."""
        return frozenset(self.store.blocks(self.run.side))

    def computes(self, step: Step, square: Block) -> bool:
        """True if a square is a unit of a step; a block is one if it has points."""
        return step.side is not None or square in (self.with_points if step.isolated else self.used)

    def points_read(self, blocks: Sequence[Block]) -> list[tuple[str, str]]:
        """The keys of the points of some blocks, of those that have any."""
        keys = self.points_keys
        others = "".join(f" {name}" for name in self.store.fields)
        fields = ("fields", f"{self.store.has_returns}{self.store.has_classes}{others}")
        return [fields, *((block.name, keys[block.name]) for block in blocks if block.name in keys)]

    def refuse(self, reason: str) -> NoReturn:
        """End the run for its inputs' sake; nothing of it stays."""
        self.store.discard()
        raise InputError(reason)

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


def open_region(run: Run, workers: Workers, progress: Progress, core: Core | None = None) -> Region:
    """The region of a run, or of a tile with its core, with the results that an earlier run left where they
    are to be kept."""
    store = store_of(run)
    if run.options["resume"]:
        store.prepare()
        store.drop_damaged()
        store.drop_records()  # nothing says that they are whole
    else:
        store.discard()
        store.prepare()
    return Region(run, store, workers, progress, core or Core(), list(run.failed), points=run.index.points)


def drop_upkeep(region: Region) -> None:
    """Remove what an earlier update left: names, edits and numbers, of which a build has none."""
    folder = region.store.folder
    for name in (NAMED, EDITED.name, EARLIER):
        shutil.rmtree(folder / name, ignore_errors=True)
    (folder / NUMBERS).unlink(missing_ok=True)


def store_of(run: Run) -> Store:
    """The store of a run's results."""
    return Store(
        run.work_folder,
        has_returns=run.index.has_field("return_number"),
        has_classes=run.index.has_field("classification"),
        system=run.index.system,
        fields=run.recipe.needs,
        outlasts=bool(run.options["keep"]),
    )


def read_points(region: Region) -> None:
    """Bring all points that are not yet there to their blocks.

    Raises
    ------
    InputError
        When no input can be read.
    """
    run, store = region.run, region.store
    parts = {part.name: part for part in file_slices(run.index)}
    keys = {name: key_of_part(part, store, run.side, run.window) for name, part in parts.items()}
    before = known_parts(store, keys)
    todo = [part for name, part in parts.items() if name not in before or before[name].unread is not None]
    records = {name: mark.records for name, mark in before.items()}
    read = sum(mark.records for mark in before.values() if mark.unread is None)

    def read_more(points: int) -> None:
        nonlocal read
        read += points
        region.progress("read", min(read, run.index.points), run.index.points)

    tasks = [(part, keys[part.name]) for part in todo]
    work, workers = partial(read_part, store=store, run=run, copied=copies_records(run)), region.workers
    if workers.alone or len(todo) == 1:
        work, workers = partial(work, progress=read_more), Workers()
    unread: dict[int, str] = {}
    for outcome in workers.run(work, tasks):
        part = todo[outcome.index]
        region.budget.add("read", outcome.cpu)
        if outcome.answer is None:
            region.note(outcome, str(part.path))
            unread[part.number] = region.failed.pop()
            continue
        done, box = outcome.answer
        records[part.name] = done.records
        if done.unread is not None and part.number not in unread:
            log.error("%s", done.unread)
            unread[part.number] = done.unread
        if box is not None:
            region.wrong_boxes[part.number] = region.wrong_boxes.get(part.number, box).union(box)
        if workers is region.workers:
            read_more(done.records)
    for number in unread:
        own = [name for name, part in parts.items() if part.number == number]
        region.points -= run.index.count(number) - sum(records.get(name, 0) for name in own)
    if unread and len(unread) == len(run.index):
        region.refuse(next(iter(unread.values())))
    region.failed += unread.values()
    region.points_keys = keys_of_points(store)
    region.budget.step("read")


def read_part(
    task: tuple[FileSlice, str],
    store: Store,
    run: Run,
    copied: bool,
    progress: Callable[[int], None] = lambda points: None,
) -> Any:
    """A part of an input, brought to its blocks, with the key that its mark bears."""
    part, key = task
    return partition_slice(part, store, run.side, run.window, progress, copied, key)


def replace_points(region: Region) -> None:
    """Leave out the points that those of later scans take the place of."""
    store, generations = region.store, region.run.generations
    blocks = store.blocks(region.run.side) if generations else []
    later = set[Block]()
    for block in blocks:
        newest = max(scan for scan, _ in store.scan_files(block))
        later |= set(ring(block)) if newest >= generations[0] else set()
    units = [block for block in blocks if block in later]
    store.keep_only(SUPERSEDED.name, units)
    compute(region, SUPERSEDED, units)
    results = dict(store.found(SUPERSEDED.name, units))
    region.points_keys = {
        name: key_of(key, results[name]) if name in results else key
        for name, key in region.points_keys.items()
    }


def use_blocks(region: Region) -> None:
    """Find the blocks that are used: those with points, without those that hold nothing but isolated.

    Raises
    ------
    InputError
        When the whole inputs leave no point, or their rasters would be too large.
    """
    run, window = region.run, region.run.window
    blocks = region.store.blocks(run.side)
    whole = region.core.loaded is None and window.bounds is None and window.clip is None
    if run.index.points and not blocks and whole:
        region.refuse(
            f"{run.index.path(0)}: none of {run.index.points:,} points can be used, all are withheld or "
            "without coordinates; export the points again"
        )
    isolated = find_isolated_blocks(region.store, blocks)
    if isolated:
        log.warning(
            "%d points in %d blocks far from all others are left out; where they are a survey, check its "
            "coordinates",
            sum(isolated.values()),
            len(isolated),
        )
    region.blocks = [block for block in blocks if block not in isolated]
    if region.blocks and {"rasters", "mask"} & set(run.outputs):
        spans = np.ptp([(block.column, block.row) for block in region.blocks], axis=0) + 1
        width, height = (spans * run.side / CELL).round().astype(int).tolist()
        if width * height > LARGEST_RASTER:
            region.refuse(
                f"{run.folder}: the rasters would have {width:,} by {height:,} cells; check the coordinates "
                "of the inputs, or build their regions apart with --per-tile or --bounds"
            )
    region.store.keep_only(FLOORS.name, region.blocks)
    if not region.own_blocks:
        log.warning("no points left to use: see the bounds, the clip area and the files")


def find_regions(region: Region, blocks: Sequence[Block]) -> None:
    """Large objects, the ground, rasters and regions of buildings of some blocks, and what these take of the
    blocks around."""
    bring(region, REGIONS, region.workers.heaviest_first(blocks, region.store.count_points))


def blocks_ahead(region: Region, done: Sequence[Block]) -> list[Block]:
    """The blocks into which buildings of the core go on from those that are done.

    Raises
    ------
    TooNarrowError
        When they lie beyond what was loaded.
    """
    run, core = region.run, region.core
    if core.loaded is None:  # all blocks are the core's
        return []
    beyond = blocks_beyond(seams(region, done), core.holds)
    if run.given is not None:
        beyond |= blocks_under(run.given, run.side, core.holds)
    beyond -= set(done)
    if not all(map(core.reaches, beyond)):
        raise TooNarrowError
    return sorted(beyond & set(region.blocks))


def join_buildings(region: Region, done: Sequence[Block]) -> list[OwnedBuildings]:
    """The buildings of the core, from the regions of the blocks that are done, or from given footprints."""
    run = region.run
    region.store.keep_only(REGIONS.name, done)
    if run.given is not None:
        plans = assign_footprints(run.given, region.blocks, run.side, run.lost)
    else:
        plans = with_addresses(join_regions(seams(region, done)), run.addresses)
    region.budget.step("blocks")
    return [plan for plan in plans if region.core.holds(plan.owner_block)]


def seams(region: Region, blocks: Sequence[Block]) -> list[Seam]:
    """The results that the join needs, of all blocks that could be computed."""
    found = []
    for result in results_of(REGIONS, region.store, sorted(blocks)).values():
        with result as file:
            found.append(Seam.read(file))
    return found


def model_buildings(region: Region, plans: Sequence[OwnedBuildings]) -> None:
    """Outlines, units, roofs and solids of the buildings of some owner blocks."""
    plans = region.workers.heaviest_first(plans, partial(size_of, store=region.store))
    region.store.keep_only(BUILDINGS.name, [plan.owner_block for plan in plans])
    compute(region, BUILDINGS, plans)
    region.budget.step("buildings")


def size_of(plan: OwnedBuildings, store: Store) -> float:
    """Number of points of an owner block's buildings, or the area (m²) of given ones: a hall may take longer
    than a street."""
    given = [building.given for building in plan.buildings if building.given is not None]
    if given:
        return float(sum(footprint.polygon.area for footprint in given))
    labels = {block: store.array(REGIONS.name, block, "label") for block in plan.blocks}
    parts = [part for building in plan.buildings for part in building.regions]
    return float(sum(int((labels[block] == label).sum()) for block, label in parts))


def end_region(region: Region, complete: bool) -> None:
    """Leave of the results what is to be kept: none of a complete run, but those of this one where they are
    asked for."""
    store = region.store
    store.drop_records()
    if region.run.options["keep"]:
        stated = {**request_of(region.run), "plan": region.run.plan}
        with atomic(store.folder / REQUEST) as temporary:
            temporary.write_text(json.dumps(stated), encoding="utf-8")
    elif complete:
        store.discard()


def warn_of_wrong_boxes(index: Index, wrong_boxes: Mapping[int, Bounds]) -> None:
    """One warning for all files whose points lie outside the box their header states."""
    if wrong_boxes:
        first = min(wrong_boxes)
        log.warning(
            "%d files have points outside the bounding box of their header (the first: %s); the points are "
            "used where they are",
            len(wrong_boxes),
            index.path(first),
        )


def import_methods(recipe: Recipe) -> None:
    """No-op; unpickling it makes a worker import the methods."""
