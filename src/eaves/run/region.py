"""From files to files in one region: scatter, block pass, join, building pass, outputs."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NoReturn, Protocol

import numpy as np

from eaves.footprints.addresses import split_buildings
from eaves.formats import InputError
from eaves.formats.atomic import DiskFullError
from eaves.ground.toolkit.floor import COARSEST_M
from eaves.ground.toolkit.wide_objects import WideObjects
from eaves.model import Block, Bounds, Failure, Footprint, PointCloud
from eaves.model.results import BuildingPoints, BuildingResult
from eaves.raster.surfaces import CELL
from eaves.reconstruct.overhangs import LOD as OVERHANGS
from eaves.run.block import block_pass
from eaves.run.building import broken_result, building_pass, draw_footprints, find_doubtful
from eaves.run.building_file import SavedBuilding
from eaves.run.clock import Budget, Clock
from eaves.run.decks import Decks
from eaves.run.gather import AROUND, Gatherer
from eaves.run.ground_squares import classify_squares, group_squares
from eaves.run.index import Index
from eaves.run.join import (
    OwnedBuildings,
    Seam,
    assign_footprints,
    blocks_beyond,
    blocks_under,
    join_regions,
    with_addresses,
)
from eaves.run.mark import mark_of
from eaves.run.partition import FileSlice, earlier, file_slices, find_isolated_blocks, partition_slice
from eaves.run.recipe import Recipe
from eaves.run.run import Progress, Run
from eaves.run.store import COMPUTED, Store, link_file
from eaves.run.wide import keep_floor, keep_square, load_decks, load_wide
from eaves.run.workers import Outcome, Workers, peak_memory_mb
from eaves.run.world_squares import GROUND_SQUARE, WIDE_SQUARE, squares_of

log = logging.getLogger("eaves")

COPIED_POINTS = 200_000_000
"""Inputs of more points are decompressed a second time: copies of 34 bytes a point would fill the disk."""
LARGEST_RASTER = 10**10
"""Cells of a raster in one file: 50 km by 50 km. Empty ones cost time, too."""


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

    def __init__(self, run: Run, work_folder: Path, workers: Workers, progress: Progress) -> None:
        self.run, self.workers, self.progress = run, workers, progress
        self.failed: list[str] = list(run.failed)
        self.peak = peak_memory_mb()
        self.budget = Budget()
        self.wrong_boxes: dict[int, Bounds] = {}
        self.blocks: Sequence[Block] = ()
        self.points = run.index.points
        """Of the inputs, without those that could not be read."""
        self.store = store_of(run, work_folder)
        self.earlier: Store | None = None
        """Of the run that this one goes on from: what follows from the same is taken from there."""

    def open_store(self) -> None:
        """Keep the parts of an earlier run that match, or start anew."""
        if not (self.run.options["resume"] and self.store.matches(self.run.plan)):
            self.store.discard()
            self.store.prepare()
            self.store.keep_plan(self.run.plan)
        else:
            self.store.prepare()
            self.store.drop_damaged()
            self.store.drop_records()  # nothing tells that they are whole

    def partition(self) -> None:
        """Bring all points that are not yet there to their blocks."""
        parts = file_slices(self.run.index)
        before = {part.name: mark for part in parts if (mark := earlier(part, self.store))}
        todo = [part for part in parts if before.get(part.name, (0, "new"))[1] is not None]
        total, read = self.run.index.points, sum(mark[0] for mark in before.values() if mark[1] is None)

        def read_more(points: int) -> None:
            nonlocal read
            read += points
            self.progress("read", min(read, total), total)

        work = partial(
            partition_slice,
            store=self.store,
            side=self.run.side,
            window=self.run.window,
            copied=self.copies_records,
        )
        workers = self.workers
        if workers.alone or len(todo) == 1:
            work, workers = partial(work, progress=read_more), Workers()
        unread: dict[int, str] = {}
        records = {name: mark[0] for name, mark in before.items()}
        changed = False
        for outcome in workers.run(work, todo):
            part: FileSlice = todo[outcome.index]
            self.budget.add("read", outcome.cpu)
            if outcome.answer is None:
                self.note(outcome, str(part.path))
                unread[part.number] = self.failed.pop()
                continue
            done = outcome.answer
            records[part.name] = done.records
            changed |= before.get(part.name) != (done.records, done.unread)
            if done.unread is not None and part.number not in unread:
                log.error("%s", done.unread)
                unread[part.number] = done.unread
            if done.box is not None:
                self.wrong_boxes[part.number] = self.wrong_boxes.get(part.number, done.box).union(done.box)
            if workers is self.workers:
                read_more(done.records)
        for number in unread:
            mine = [part.name for part in parts if part.number == number]
            self.points -= self.run.index.count(number) - sum(records.get(name, 0) for name in mine)
        if changed:  # what was computed of fewer points no longer holds
            for kind in COMPUTED:
                self.store.forget(kind)
        if unread and len(unread) == len(self.run.index):
            self.refuse(next(iter(unread.values())))
        self.failed += unread.values()

    @property
    def copies_records(self) -> bool:
        """Whether the inputs are kept decompressed for the classified points."""
        run = self.run
        small = run.index.points <= COPIED_POINTS
        return "classified" in run.outputs and small and not (run.by_tiles or run.options["keep"])

    def used_blocks(self) -> list[Block]:
        """The blocks that have points, without those that hold nothing but isolated."""
        blocks = self.store.blocks(self.run.side)
        isolated = find_isolated_blocks(self.store, blocks)
        if isolated:
            log.warning(
                "%d points in %d blocks far from all others are left out; where they are a survey, check its "
                "coordinates",
                sum(isolated.values()),
                len(isolated),
            )
        return [block for block in blocks if block not in isolated]

    def check_points(self) -> None:
        """Refuse a run of the whole inputs that leaves no point."""
        window = self.run.window
        if (
            self.run.index.points
            and not self.store.blocks(self.run.side)
            and window.bounds is None
            and window.clip is None
        ):
            self.refuse(
                f"{self.run.index.path(0)}: none of {self.run.index.points:,} points can be used, all are "
                "withheld or without coordinates; export the points again"
            )

    def check_rasters(self, blocks: Sequence[Block]) -> None:
        """Refuse the run when its rasters would be too large."""
        if not blocks or not {"rasters", "mask"} & set(self.run.outputs):
            return
        spans = np.ptp([(block.column, block.row) for block in blocks], axis=0) + 1
        width, height = (spans * self.run.side / CELL).round().astype(int).tolist()
        if width * height > LARGEST_RASTER:
            self.refuse(
                f"{self.run.folder}: the rasters would have {width:,} by {height:,} cells; check the "
                "coordinates of the inputs, or build their regions apart with --per-tile or --bounds"
            )

    def refuse(self, reason: str) -> NoReturn:
        """End the run for its inputs' sake; nothing of it stays."""
        self.store.discard()
        raise InputError(reason)

    def join(self, blocks: Sequence[Block], core: Core) -> list[OwnedBuildings]:
        """Compute the blocks of the core, and others as its buildings go on into them; the buildings."""
        self.blocks = blocks
        there, tried = set(blocks), set[Block]()
        todo = [block for block in blocks if core.holds(block)]
        while todo:
            self.compute_blocks(todo)
            tried |= set(todo)
            if core.loaded is None:  # all blocks are the core's
                break
            seams = self.seams(sorted(tried))
            beyond = blocks_beyond(seams, core.holds)
            if self.run.given is not None:
                beyond |= blocks_under(self.run.given, self.run.side, core.holds)
            if not all(map(core.reaches, beyond - tried)):
                raise TooNarrowError
            todo = sorted((beyond & there) - tried)
        if self.run.given is not None:
            return assign_footprints(self.run.given, blocks, self.run.side, self.run.lost)
        return with_addresses(join_regions(self.seams(sorted(tried))), self.run.addresses)

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
        self.find_ground(left)
        left = self.workers.heaviest_first(left, self.store.count_points)
        work = partial(
            compute_block,
            store=self.store,
            recipe=self.run.recipe,
            earlier=self.earlier,
            marked=self.run.options["keep"],
        )
        for done, outcome in enumerate(self.workers.run(work, left), 1):
            self.note(outcome, f"block {left[outcome.index].name}")
            self.budget.add("blocks", outcome.cpu)
            self.progress("blocks", done, len(left))

    def find_ground(self, blocks: Sequence[Block]) -> None:
        """The ground of some blocks and of what the detector sees around them, in squares not yet done."""
        recipe, store, side = self.run.recipe, self.store, self.run.side
        seen = [block.bounds.buffered(recipe.scene_buffer) for block in blocks]
        held = set(squares_of([block.bounds for block in store.blocks(side)], GROUND_SQUARE))
        squares = [square for square in squares_of(seen, GROUND_SQUARE) if square in held]
        squares = [square for square in squares if not store.has("ground", square)]
        self.find_wide(squares)
        groups = group_squares(squares, self.run.options["block"])
        work = partial(classify_squares, store=store, recipe=recipe, side=side)
        for outcome in self.workers.run(work, groups):
            self.note(outcome, f"ground of square {groups[outcome.index][0].name}")
            self.budget.add("blocks", outcome.cpu)

    def find_wide(self, grounds: Sequence[Block]) -> None:
        """What stands over the terrain of some squares of the ground, in squares that have not been looked
        at.
        """
        recipe, store, side = self.run.recipe, self.store, self.run.side
        if not recipe.sees_wide:
            return
        near_grounds = [square.bounds.buffered(recipe.ground.buffer) for square in grounds]
        squares = squares_of(near_grounds, WIDE_SQUARE)
        squares = [square for square in squares if not store.has("squares", square)]
        seen = [square.bounds.buffered(recipe.ground.wide_buffer) for square in squares]
        near = [block for block in self.blocks if any(map(block.bounds.intersects, seen))]
        floors = [block for block in near if not store.has("floors", block)]
        for outcome in self.workers.run(partial(keep_floor, store=store), floors):
            self.note(outcome, f"floor of block {floors[outcome.index].name}")
            self.budget.add("wide", outcome.cpu)
        work = partial(keep_square, store=store, side=side, ground=recipe.ground, earlier=self.earlier)
        for outcome in self.workers.run(work, squares):
            self.note(outcome, f"square {squares[outcome.index].name}")
            self.budget.add("wide", outcome.cpu)

    def model(self, plans: Sequence[OwnedBuildings]) -> None:
        """The building pass for those owner blocks that have not been computed."""
        left = [plan for plan in plans if not self.store.has("buildings", plan.owner_block)]
        left = self.workers.heaviest_first(left, lambda plan: len(plan.buildings))
        work = partial(
            compute_buildings,
            store=self.store,
            recipe=self.run.recipe,
            snap=self.run.options["snap_footprints"],
        )
        for done, outcome in enumerate(self.workers.run(work, left), 1):
            self.note(outcome, f"buildings of block {left[outcome.index].owner_block.name}")
            self.budget.add("buildings", outcome.cpu)
            self.progress("buildings", done, len(left))

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


def warn_of_wrong_boxes(index: Index, wrong_boxes: dict[int, Bounds]) -> None:
    """One warning for all files whose points lie outside the box their header states."""
    if wrong_boxes:
        first = min(wrong_boxes)
        log.warning(
            "%d files have points outside the bounding box of their header (the first: %s); the points are "
            "used where they are",
            len(wrong_boxes),
            index.path(first),
        )


def store_of(run: Run, work_folder: Path) -> Store:
    """The store of a run's parts in a folder."""
    return Store(
        work_folder,
        has_returns=run.index.has_field("return_number"),
        has_classes=run.index.has_field("classification"),
        system=run.index.system,
    )


def import_methods(recipe: Recipe) -> None:
    """Nothing: what a worker needs is imported by the time it knows this function and the methods."""


def compute_block(
    block: Block, store: Store, recipe: Recipe, earlier: Store | None = None, marked: bool = False
) -> None:
    """The block pass for one block, kept in the store, `marked` where a later run may go on from it; what an
    earlier run found of the same is taken."""
    taken = load_block(block, store, recipe)
    mark = mark_of_block(*taken) if marked else ""
    if earlier is not None and earlier.has("blocks", block):
        with earlier.open_block(block) as file:
            known = file.about.get("inputs")
        if known == mark:
            link_file(earlier.path("blocks", block), store.path("blocks", block))
            return
    result = block_pass(*taken)
    result.seconds["ground"] = store.ground_seconds(block)
    store.save_block(replace(result, inputs=mark))


def mark_of_block(
    cloud: PointCloud, block: Block, recipe: Recipe, wide: WideObjects | None, decks: tuple[Decks, ...]
) -> str:
    """The mark of what `load_block` gives; of the recipe nothing, for runs of one store have one."""
    seen = block.bounds.buffered(recipe.scene_buffer)
    taken: list[object] = [cloud.xyz, cloud.point_id, cloud.classification, cloud.part]
    taken += [cloud.return_number, cloud.number_of_returns]
    if wide is not None:
        taken += [wide.terrain_beneath(seen.translated(-block.origin[0], -block.origin[1]), block.origin)]
        taken += [wide.doubts_in(block.bounds)]
    for one in decks:
        part = one.cropped(seen.buffered(COARSEST_M))
        taken += [part.west, part.north, part.cell, part.level, part.base, part.water, part.doubts]
    return mark_of(*taken)


def load_block(
    block: Block, store: Store, recipe: Recipe
) -> tuple[PointCloud, Block, Recipe, WideObjects | None, tuple[Decks, ...]]:
    """What `block_pass` takes, from the store."""
    seen = block.bounds.buffered(recipe.scene_buffer)
    wide = load_wide(store, seen) if recipe.sees_wide else None
    decks = load_decks(store, seen) if recipe.sees_wide and recipe.marks_others else ()
    cloud, _ = store.load_points(seen, block.origin, block.side, classified=True)
    return cloud, block, recipe, wide, decks


class Earlier(Protocol):
    """What an earlier run found of the buildings of one owner block."""

    def take(
        self, buildings: Sequence[BuildingPoints]
    ) -> tuple[list[SavedBuilding], list[BuildingPoints], list[bool]]:
        """The results that stay as they are, the gathered buildings to draw, and which of these to model."""

    def result_of(self, building: BuildingPoints, footprint: Footprint | Failure) -> SavedBuilding | None:
        """The earlier result of a building with its footprint; None where there is none of just that."""


def compute_buildings(
    plan: OwnedBuildings,
    store: Store,
    recipe: Recipe,
    snap: bool = False,
    earlier: Earlier | None = None,
) -> list[bool]:
    """The building pass for the buildings owned by one block, kept in the store; which were `earlier`'s."""
    gatherer = Gatherer(store, around=AROUND if recipe.lod == OVERHANGS else None)
    if snap:
        plan = gatherer.snapped(plan)
    gathered = [gatherer.gather(plan.owner_block, building) for building in plan.buildings]
    results: list[BuildingResult | SavedBuilding] = [
        BuildingResult.without_points(none) for none in gathered if isinstance(none, Failure)
    ]
    buildings = [building for building in gathered if not isinstance(building, Failure)]
    known = [False] * len(results)
    if earlier is not None:
        kept, buildings, wanted = earlier.take(buildings)
        results += kept
        known += [True] * len(kept)
    clock = Clock()
    footprints = draw_all(buildings, recipe)
    clock.lap("outline")
    if earlier is not None:
        footprints = [one for one, is_wanted in zip(footprints, wanted, strict=True) if is_wanted]
        buildings = [one for one, is_wanted in zip(buildings, wanted, strict=True) if is_wanted]
    buildings, footprints = split_buildings(buildings, footprints, plan.addresses, recipe.units)
    clock.lap("units")
    made: dict[int, BuildingResult] = {}
    for number, (building, footprint) in enumerate(zip(buildings, footprints, strict=True)):
        found = None if earlier is None else earlier.result_of(building, footprint)
        known.append(found is not None)
        if found is None:
            made[number] = try_building(building, footprint, recipe, store, check=False)
            results.append(made[number])
        else:
            results.append(found)
    checking = Clock()
    todo, before = list(made), len(results) - len(buildings)
    for number in recheck(list(made.values()), recipe, store):
        place = todo[number]
        results[before + place] = try_building(buildings[place], footprints[place], recipe, store)
    checking.lap("validate")
    if results and isinstance(results[0], BuildingResult):
        spent = results[0].seconds
        spent.update(clock.laps, validate=spent.get("validate", 0.0) + checking.laps["validate"])
    store.save_buildings(plan.owner_block, results)
    return known


def try_building(
    building: BuildingPoints, footprint: Footprint | Failure, recipe: Recipe, store: Store, check: bool = True
) -> BuildingResult:
    """What `building_pass` answers, or what is left of a building where it raises: one must not take the
    others of its block with it."""
    try:
        return building_pass(building, footprint, recipe, store.system.horizontal_unit_m, False, check)
    except Exception as error:
        name = building.owner_block.name
        log.warning("a building of block %s failed: %s: %s", name, type(error).__name__, error)
        log.debug("traceback", exc_info=True)
        return broken_result(building, error)


def recheck(results: list[BuildingResult], recipe: Recipe, store: Store) -> Iterable[int]:
    """The numbers of unchecked results to be made again with a check; all where one of them breaks it."""
    try:
        return find_doubtful(results, recipe.lod, store.system.horizontal_unit_m)
    except Exception:  # as in try_building
        log.debug("traceback", exc_info=True)
        return range(len(results))


def draw_all(buildings: list[BuildingPoints], recipe: Recipe) -> list[Footprint | Failure]:
    """The footprints of a block's buildings together; one by one where one of them breaks the others."""
    try:
        return draw_footprints(buildings, recipe)
    except Exception as error:  # as in compute_buildings: the others must not go with it
        if len(buildings) == 1:
            log.debug("traceback", exc_info=True)
            return [Failure("internal_error", f"{type(error).__name__}: {error}", "outline")]
        return [draw_all([building], recipe)[0] for building in buildings]
