"""A region of points and the steps that it goes through; `eaves.pipeline` names them in their order."""

from __future__ import annotations

import json
import logging
import shutil
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, NoReturn

import numpy as np

from eaves.buildings.edited import OwnedOrders
from eaves.buildings.join import (
    OwnedBuildings,
    Seam,
    assign_footprints,
    blocks_beyond,
    join_regions,
    with_addresses,
)
from eaves.flow.numbers import NUMBERS
from eaves.flow.refusals import copies_records
from eaves.flow.run import Progress, Run, no_progress, request_of
from eaves.flow.step import Step, bring, bring_inputs, compute, results_of, squares_read
from eaves.flow.steps import BUILDINGS, EDITED, FLOORS, REGIONS, SUPERSEDED
from eaves.flow.tiles import (
    Area,
    ByTile,
    Visit,
    bounds_by_tile,
    by_tile,
    inputs_meeting,
    let_go,
    squares_of_area,
)
from eaves.formats import InputError
from eaves.formats.atomic import DiskFullError, atomic
from eaves.model import Block, Bounds, Failure, Footprint
from eaves.recipe.recipe import Recipe
from eaves.run.clock import Budget
from eaves.run.keys import NAMED, key_of
from eaves.run.partition import (
    FileSlice,
    PartMark,
    Window,
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

REQUEST = "request.json"
"""Beside the results that are kept: what the run was asked for; run.json lacks it while files are written."""
EARLIER = "earlier"
"""Folder, beside the results of a run that is updated in its place, of those that it shows until then."""


@dataclass(eq=False)
class Region:
    """A run's points, and what is noted as they go through the steps."""

    run: Run
    store: Store
    workers: Workers = field(default_factory=Workers)
    progress: Progress = no_progress
    failed: list[str] = field(default_factory=list)
    peak: float = field(default_factory=peak_memory_mb)
    budget: Budget = field(default_factory=Budget)
    wrong_boxes: dict[int, Bounds] = field(default_factory=dict)
    points: int = 0
    """Of the inputs, without those that could not be read."""
    unread: dict[int, str] = field(default_factory=dict)
    """Inputs that could not be read to their end, by number, with the reason."""
    parts: dict[str, PartMark] = field(default_factory=dict)
    """The parts of inputs that were read, by name."""
    within: set[Block] | None = None
    """The blocks whose points were asked for; None for all."""
    with_points: frozenset[Block] = frozenset()
    """Of these, those that have points, also those that hold nothing but isolated."""
    used: frozenset[Block] = frozenset()
    """Those that have points, without those that hold nothing but isolated."""
    isolated: dict[Block, int] = field(default_factory=dict)
    """Blocks left out, with the number of their points."""
    points_keys: Mapping[str, str] = field(default_factory=dict)
    """Block, by its name → the key of its points."""
    brought: dict[str, set[Block]] = field(default_factory=dict)
    """Step, by its name → the squares whose results are there."""
    visits: dict[Block | None, Visit] = field(default_factory=dict)
    """Tile → what was found of it; None → of a run in one piece."""
    unfinished: frozenset[Block] = frozenset()
    """The tiles that come later."""

    @property
    def blocks(self) -> list[Block]:
        """The blocks that are used, in order."""
        return sorted(self.used)

    @property
    def shown(self) -> list[Block]:
        """The blocks that the files show, in order."""
        return sorted(block for visit in self.visits.values() for block in visit.blocks)

    @property
    def owners(self) -> list[Block]:
        """The blocks that own buildings, in order."""
        return sorted(owner for visit in self.visits.values() for owner in visit.owners)

    @cached_property
    def given(self) -> ByTile[Footprint]:
        """The given footprints."""
        return ByTile(self.run.given or (), self.run)

    @cached_property
    def lost(self) -> ByTile[Failure]:
        """The given footprints that cannot be modelled."""
        return ByTile(self.run.lost, self.run)

    def computes(self, step: Step, square: Block) -> bool:
        """True if a square is a unit of a step; a block is one if it has points."""
        return step.side is not None or square in (self.with_points if step.isolated else self.used)

    def points_read(self, blocks: Sequence[Block]) -> list[tuple[str, str]]:
        """The keys of the points of some blocks, of those that have any."""
        keys = self.points_keys
        others = "".join(f" {name}" for name in self.store.fields)
        fields = ("fields", f"{self.store.has_returns}{self.store.has_classes}{others}")
        return [fields, *((block.name, keys[block.name]) for block in blocks if block.name in keys)]

    def correct_boxes(self) -> None:
        """Widen the boxes of inputs to where their points were found."""
        self.run = replace(self.run, index=self.run.index.with_boxes(self.wrong_boxes))

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


def open_region(run: Run, workers: Workers, progress: Progress) -> Region:
    """The region of a run, with the results that an earlier run left where they are to be kept."""
    store, parts = store_of(run), dict[str, PartMark]()
    if run.options["resume"]:
        store.prepare()
        store.drop_damaged()
        store.drop_records()  # nothing says that they are whole
        parts = known_parts(store, run.index, run.side, run.window)
    else:
        store.discard()
        store.prepare()
    shown = partial(show_tiles, progress) if run.by_tiles else progress
    return Region(run, store, workers, shown, list(run.failed), points=run.index.points, parts=parts)


def show_tiles(progress: Progress, step: str, done: int, total: int) -> None:
    """The `Progress` of a run by tiles, of which each goes through the other steps."""
    if step in ("tiles", "write"):
        progress(step, done, total)


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


def bring_points(region: Region, step: Step = REGIONS, units: Iterable[Any] = ()) -> None:
    """The points of all blocks; in a run by tiles those that decide the results of a step for some units."""
    if region.within is None:
        if region.used or region.isolated:
            return
    else:
        squares = squares_read(region.run, step, units)
        if squares <= region.within:
            return
        region.within |= squares
    read_points(region)
    replace_points(region)
    use_blocks(region)


def squares_to_read(region: Region) -> set[Block] | None:
    """The blocks whose points were asked for, and those around them, which tell what is isolated; None for
    all."""
    return None if region.within is None else {near for block in region.within for near in ring(block)}


def read_points(region: Region) -> None:
    """Bring the points that were asked for to their blocks, where they are not there.

    Raises
    ------
    InputError
        When no input can be read.
    """
    run, store, squares = region.run, region.store, squares_to_read(region)
    index, numbers = run.index, np.arange(len(run.index))
    if squares is not None:
        numbers = inputs_meeting(index, bounds_by_tile(squares, run.tile_side))
    parts = {part.name: part for part in file_slices(index, numbers)}
    names = None if squares is None else {square.name for square in squares}
    todo = [part for part in parts.values() if not is_in_place(region, part, names)]
    read = sum(mark.records for mark in region.parts.values() if mark.unread is None)

    def read_more(points: int) -> None:
        nonlocal read
        read += points
        region.progress("read", min(read, index.points), index.points)

    tasks = [(part, key_of_part(part, store, run.side, run.window)) for part in todo]
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
        mark, box = outcome.answer
        region.parts[part.name] = mark
        if mark.unread is not None and part.number not in unread:
            log.error("%s", mark.unread)
            unread[part.number] = mark.unread
        if box is not None:
            region.wrong_boxes[part.number] = region.wrong_boxes.get(part.number, box).union(box)
        if workers is region.workers:
            read_more(mark.records)
    for number in unread.keys() - region.unread.keys():
        names_of = [name for name, part in parts.items() if part.number == number]
        records = sum(region.parts[name].records for name in names_of if name in region.parts)
        region.points -= index.count(number) - records
    region.unread |= unread
    if region.unread and len(region.unread) == len(index):
        region.refuse(next(iter(region.unread.values())))
    region.failed += [region.unread[number] for number in map(int, numbers) if number in region.unread]
    region.points_keys = keys_of_points(region.parts)
    region.budget.step("read")


def is_in_place(region: Region, part: FileSlice, names: Collection[str] | None) -> bool:
    """True if the points of a part of an input are there, in the blocks of some names, or in all."""
    mark, store = region.parts.get(part.name), region.store
    if mark is None:
        return part.number in region.unread  # a file that cannot be read is not tried again
    if mark.unread is not None and part.number not in region.unread:
        return False
    blocks = [name for name in mark.blocks if names is None or name in names]
    return all((store.folder / "points" / name / f"{part.name}.bin").exists() for name in blocks)


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
    """Find the blocks that are used: those with points, without those that hold nothing but isolated."""
    store, squares = region.store, squares_to_read(region)
    blocks = [block for block in store.blocks(region.run.side) if squares is None or block in squares]
    isolated = find_isolated_blocks(store, blocks)
    inside = blocks if region.within is None else [block for block in blocks if block in region.within]
    region.with_points = frozenset(inside)
    region.used = region.with_points - isolated.keys()
    region.isolated |= {block: isolated[block] for block in inside if block in isolated}
    for step in (FLOORS, REGIONS):
        for block in store.units(step.name, region.run.side):
            if block not in region.used and (region.within is None or block in region.within):
                store.remove(step.name, block)


def check_blocks(region: Region) -> None:
    """Say what was left out, and what lies elsewhere than its header says.

    Raises
    ------
    InputError
        When the whole inputs leave no point.
    """
    run = region.run
    if region.isolated:
        log.warning(
            "%d points in %d blocks far from all others are left out; where they are a survey, check its "
            "coordinates",
            sum(region.isolated.values()),
            len(region.isolated),
        )
    warn_of_wrong_boxes(region)
    if region.shown:
        return
    if run.index.points and not region.isolated and run.window == Window():
        region.refuse(
            f"{run.index.path(0)}: none of {run.index.points:,} points can be used, all are withheld or "
            "without coordinates; export the points again"
        )
    log.warning("no points left to use: see the bounds, the clip area and the files")


def blocks_of(region: Region, area: Area) -> list[Block]:
    """The blocks of an area that are used, and in a run by tiles those around them."""
    if not area.tiles:
        bring_points(region)
        return region.blocks
    squares = squares_of_area(region, area)
    bring_points(region, REGIONS, squares)
    return sorted(squares & region.used)


def find_regions(region: Region, blocks: Sequence[Block]) -> None:
    """Large objects, the ground, rasters and regions of buildings of some blocks, and what these take of the
    blocks around."""
    bring(region, REGIONS, region.workers.heaviest_first(blocks, region.store.count_points))


def blocks_ahead(region: Region, area: Area, done: Sequence[Block]) -> list[Block]:
    """The blocks into which buildings of an area go on from those that are done."""
    if not area.tiles or region.run.given is not None:
        return []
    beyond = blocks_beyond(seams(region, done), area.holds) - set(done)
    bring_points(region, REGIONS, beyond)
    return sorted(beyond & region.used)


def join_buildings(region: Region, area: Area, done: Sequence[Block]) -> list[OwnedBuildings]:
    """The buildings of an area, from the regions of the blocks that are done, or from given footprints."""
    run = region.run
    if run.given is not None:
        first = run.first_block
        plans = assign_footprints(region.given.of(area), region.blocks, first, region.lost.of(area))
    else:
        plans = with_addresses(join_regions(seams(region, done)), run.addresses)
    region.budget.step("blocks")
    return [plan for plan in plans if area.holds(plan.owner_block)]


def seams(region: Region, blocks: Sequence[Block]) -> list[Seam]:
    """The results that the join needs, of all blocks that could be computed."""
    found = []
    for result in results_of(REGIONS, region.store, sorted(blocks)).values():
        with result as file:
            found.append(Seam.read(file))
    return found


def model_buildings(region: Region, plans: Sequence[OwnedBuildings]) -> None:
    """Outlines, units, roofs and solids of the buildings of some owner blocks."""
    bring_points(region, BUILDINGS, plans)
    bring_inputs(region, BUILDINGS, plans)
    compute(region, BUILDINGS, region.workers.heaviest_first(plans, partial(size_of, store=region.store)))
    region.budget.step("buildings")


def model_edits(region: Region, units: Sequence[OwnedOrders]) -> None:
    """The buildings of some owner blocks after a person's edits."""
    for group in by_tile(region, units):
        bring_points(region, EDITED, group)
        bring_inputs(region, EDITED, group)
        compute(region, EDITED, group)
        if region.run.by_tiles:
            let_go(region)


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


def warn_of_wrong_boxes(region: Region) -> None:
    """One warning for all files whose points lie outside the box their header states."""
    boxes = region.wrong_boxes
    if boxes:
        log.warning(
            "%d files have points outside the bounding box of their header (the first: %s); the points are "
            "used where they are",
            len(boxes),
            region.run.index.path(min(boxes)),
        )


def import_methods(recipe: Recipe) -> None:
    """No-op; unpickling it makes a worker import the methods."""
