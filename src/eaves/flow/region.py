"""A region of points and the steps that it goes through; `eaves.pipeline` names them in their order."""

from __future__ import annotations

import json
import logging
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from eaves.blocks.points import FEW_PER_M2
from eaves.blocks.seams import REACH, Heights, compare_heights, shared_places
from eaves.buildings.building_file import NUMBERS, SavedBuildings
from eaves.buildings.gather import (
    OwnedBuildings,
    Seam,
    assign_footprints,
    blocks_beyond,
    join_regions,
    with_addresses,
)
from eaves.flow.refusals import remark_on_copies, remark_on_steps, warn_of_wrong_boxes
from eaves.flow.run import Progress, Run, no_progress, request_of
from eaves.flow.step import (
    BUILDINGS,
    FLOORS,
    POINTS,
    REGIONS,
    SHARPENED,
    SUPERSEDED,
    THINNED,
    Step,
    Work,
    ensure,
    inputs_in,
    read_key,
    results_of,
    squares_read,
    store_of,
)
from eaves.flow.tiles import (
    Area,
    GivenFootprints,
    TileRecord,
    bounds_by_tile,
    given_in,
    inputs_meeting,
    squares_of_area,
)
from eaves.formats import InputError
from eaves.formats.whole_files import DiskFullError, atomic
from eaves.model import GRID_STEP, Block, Bounds, CoordinateSystem, PointCloud
from eaves.model.block import ring
from eaves.recipe.recipe import Recipe
from eaves.run.keys import EDITED, NAMED, key_of
from eaves.run.memory import Budget
from eaves.run.points import (
    FileSlice,
    PartFacts,
    Window,
    file_slices,
    find_isolated_blocks,
    keys_of_points,
    load_inputs,
    load_window,
    number_of,
)
from eaves.run.store import Results, Store
from eaves.run.workers import Outcome, Workers, peak_memory_mb

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
    parts: dict[str, PartFacts] = field(default_factory=dict)
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
    ensured: dict[str, set[Any]] = field(default_factory=dict)
    """Step, by its name → the units whose results are there."""
    copies: dict[Block, tuple[int, ...]] = field(default_factory=dict)
    """Blocks with identical points: how many are copies, and the ids of one and of its copy."""
    heights: dict[Block, Heights] = field(default_factory=dict)
    """Blocks in which inputs overlap or adjoin: differences of their heights."""
    visits: dict[Block | None, TileRecord] = field(default_factory=dict)
    """Tile → what was found of it; None → of a run in one piece."""
    visited: dict[Block, str] = field(default_factory=dict)
    """Tile → the key of what it was found from."""
    unfinished: frozenset[Block] = frozenset()
    """The tiles that come later."""
    given: dict[Block, GivenFootprints] = field(default_factory=dict)
    """Tile → the given footprints that it owns."""

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

    @property
    def blocks_read(self) -> list[Block]:
        """The blocks that points were brought to, in order."""
        return self.store.blocks(self.run.side)

    def computes(self, step: Step, square: Block) -> bool:
        """True if a square is a unit of a step; a block is one if it has points."""
        return step.side is not None or square in (self.with_points if step.isolated else self.used)

    def points_read(self, blocks: Sequence[Block]) -> list[tuple[str, str]]:
        """The keys of the points of some blocks, of those that have any."""
        keys = self.points_keys
        more = "".join(f" {name}" for name in self.store.fields)
        fields = ("fields", f"{self.store.has_returns}{self.store.has_classes}{more}")
        return [fields, *((block.name, keys[block.name]) for block in blocks if block.name in keys)]

    @property
    def buildings(self) -> SavedBuildings:
        """The buildings as the files show them."""
        return SavedBuildings(self.store)

    @property
    def system(self) -> CoordinateSystem:
        """The reference system."""
        return self.store.system

    def results(self, step: Step, squares: Sequence[Block]) -> Results:
        """The results of a step in those of some squares that have one."""
        return results_of(step, self.store, squares)

    def array(self, step: Step, square: Block, name: str) -> NDArray[Any]:
        """An array of a result of a step."""
        return self.store.array(step.name, square, name)

    def inputs_of(self) -> Callable[[Step, Block], Any]:
        """What gives all that a step follows from in a block; picklable."""
        return partial(inputs_in, self.store, self.run)

    def window(self, block: Block, reach: float) -> PointCloud:
        """The points of a block and of its surroundings up to `reach` (m), about its corner."""
        return load_window(self.store, block, reach, names=self.store.fields).cloud

    def move_to(self, folder: Path) -> None:
        """Go on with the results that lie in a folder, or with none, and then without those there were."""
        if not folder.exists():
            self.store.discard()
        self.store = replace(self.store, folder=folder, persistent=True)
        self.store.prepare()

    def correct_boxes(self) -> None:
        """Widen the boxes of inputs to where their points were found."""
        self.run = replace(self.run, index=self.run.index.with_boxes(self.wrong_boxes))

    def remark(self, *remarks: str) -> None:
        """Say what the user must know of these inputs (`Run.with_remarks`)."""
        self.run = self.run.with_remarks(*remarks)

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
    shown = partial(show_tiles, progress) if run.by_tiles else progress
    region = Region(run, store_of(run), workers, shown, list(run.failed), points=run.index.points)
    if run.options["resume"]:
        region.store.prepare()
        region.store.drop_damaged()
        region.store.drop_records()  # nothing says that they are whole
        keep_whole_points(region)
    else:
        region.store.discard()
        region.store.prepare()
    return region


def show_tiles(progress: Progress, step: str, done: int, total: int) -> None:
    """The `Progress` of a run by tiles, of which each goes through the other steps."""
    if step in ("tiles", "write"):
        progress(step, done, total)


def drop_upkeep(region: Region) -> None:
    """Remove what an earlier update left: names, edits and numbers, of which a build has none."""
    folder = region.store.folder
    for name in (NAMED, EDITED, EARLIER):
        shutil.rmtree(folder / name, ignore_errors=True)
    (folder / NUMBERS).unlink(missing_ok=True)


def ensure_points(region: Region, step: Step = REGIONS, units: Iterable[Any] = ()) -> None:
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
    compare_inputs(region)
    replace_points(region)
    thin_points(region)
    sharpen_points(region)
    use_blocks(region)


def squares_to_read(region: Region) -> set[Block] | None:
    """The blocks whose points were asked for, and those around them, which tell what is isolated; None for
    all."""
    return None if region.within is None else {square for block in region.within for square in ring(block)}


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
    # a file that cannot be read is not tried again
    parts = [part for part in file_slices(index, numbers) if part.number not in region.unread]
    names = None if squares is None else {square.name for square in squares}
    for part in parts:
        blocks = region.parts[part.name].blocks if part.name in region.parts else ()
        if not store.has_points(part.name, (name for name in blocks if names is None or name in names)):
            store.remove(POINTS.name, part)
    failed = len(region.failed)
    ensure(region, POINTS, parts)
    broken, region.failed[failed:] = region.failed[failed:], []
    for part in parts:
        note_part(region, part, broken)
    for number in numbers.tolist():
        if number in region.unread:
            region.failed.append(region.unread[number])
    if region.unread and len(region.unread) == len(index):
        region.refuse(next(iter(region.unread.values())))
    lost = sum(index.count(number) for number in region.unread)
    read = (facts.records for name, facts in region.parts.items() if number_of(name) in region.unread)
    region.points = index.points - lost + sum(read)
    region.points_keys = keys_of_points(region.parts)
    region.run = replace(region.run, index=index.without_records())
    region.budget.step(POINTS.name)


def note_part(region: Region, part: FileSlice, broken: Sequence[str]) -> None:
    """Note what is known of a part of an input that was read, or of which lines say what broke it."""
    if not region.store.has(POINTS.name, part):
        region.parts.pop(part.name, None)
        reasons = (line for line in broken if line.startswith(f"{part.label}: "))
        region.unread.setdefault(part.number, next(reasons, f"{part.label}: could not be read"))
        return
    facts: PartFacts = POINTS.result(region.store, part)
    region.parts[part.name] = facts
    if facts.unread is not None and part.number not in region.unread:
        log.error("%s", facts.unread)
        region.unread[part.number] = facts.unread
    if facts.extent is not None:
        widened = region.wrong_boxes.get(part.number, facts.extent).union(facts.extent)
        region.wrong_boxes[part.number] = widened


def keep_whole_points(region: Region) -> None:
    """Remove the points that are not those of parts of the inputs, as they were left; what was read of an
    input to some damage is read again."""
    store, work = region.store, Work.of(POINTS, region.run)
    numbers = set(map(number_of, store.names(POINTS.name)))
    places = sorted(number for number in numbers if number < len(region.run.index))
    for part in file_slices(region.run.index, places):
        mark = store.mark(POINTS.name, part)
        if mark is not None and mark.read == read_key(region, work, part):
            facts: PartFacts = POINTS.result(store, part)
            if facts.unread is None and store.are_whole(part.name, facts.blocks):
                region.parts[part.name] = facts
    store.keep_points(list(map(Path, region.parts)))


def compare_inputs(region: Region) -> None:
    """Measure by how much the heights of inputs differ where these overlap or adjoin."""
    store, index = region.store, region.run.index
    if len(index) < 2:
        return
    index = index.with_boxes(region.wrong_boxes)
    asked = store.blocks(region.run.side) if region.within is None else sorted(region.within)
    for block in (block for block in asked if block not in region.heights):
        boxes = index.entries["box"][index.meeting(block.bounds.buffered(REACH))]
        place = shared_places(boxes, block)
        region.heights[block] = (
            {} if place is None else compare_heights(block, load_inputs(store, block, place))
        )


def replace_points(region: Region) -> None:
    """Leave out the points that those of later scans take the place of."""
    store, generations = region.store, region.run.generations
    blocks = store.blocks(region.run.side) if generations else []
    later = set[Block]()
    for block in blocks:
        newest = max(scan for scan, _ in store.scan_files(block))
        later |= set(ring(block)) if newest >= generations[0] else set()
    choose_points(region, SUPERSEDED, [block for block in blocks if block in later])


def thin_points(region: Region) -> None:
    """Let one point stand for its neighbours where a scan is dense, and for its copies."""
    store, side, squares = region.store, region.run.side, squares_to_read(region)
    blocks = [block for block in store.blocks(side) if squares is None or block in squares]
    units = [
        block
        for block in blocks
        if store.count_points(block) > FEW_PER_M2 * side**2 or may_hold_copies(region, block)
    ]
    choose_points(region, THINNED, units)
    for block in units:
        part = store.thinned(block)
        copies = part["copies"].tolist() if part else [0]
        if copies[0]:
            region.copies[block] = tuple(copies)


def sharpen_points(region: Region) -> None:
    """Sharpen the heights of a scan whose walls were smoothed, and smooth those of a rough one."""
    squares, store = squares_to_read(region), region.store
    blocks = store.blocks(region.run.side) if region.run.sharpened else []
    choose_points(region, SHARPENED, [block for block in blocks if squares is None or block in squares])


def may_hold_copies(region: Region, block: Block) -> bool:
    """True if a part of an input has identical points in a block, several parts of one input have points
    there, or the boxes of several inputs overlap or touch in it: points of others cannot be at one place."""
    names = [path.stem for _, path in region.store.scan_files(block)]
    if any(block.name in region.parts[name].repeated for name in names if name in region.parts):
        return True
    numbers = list(map(number_of, names))
    if len(set(numbers)) < len(numbers) or not region.wrong_boxes.keys().isdisjoint(numbers):
        return True
    west, south, east, north = region.run.index.entries["box"][numbers].T
    limits = block.bounds
    width = np.minimum.outer(east, east).clip(max=limits.east) - np.maximum.outer(west, west).clip(
        limits.west
    )
    height = np.minimum.outer(north, north).clip(max=limits.north) - np.maximum.outer(south, south).clip(
        limits.south
    )
    return bool(np.triu((width > -GRID_STEP) & (height > -GRID_STEP), 1).any())


def choose_points(region: Region, step: Step, units: Sequence[Block]) -> None:
    """Bring the results of a step that says which of some blocks' points are used, and no others of it."""
    region.store.evict_others(step.name, units)
    ensure(region, step, units)
    results = dict(region.store.found(step.name, units))
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
    remark_on_copies(region)
    remark_on_steps(region)
    region.store.evict_others(BUILDINGS.name, region.owners)
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
        ensure_points(region)
        return region.blocks
    squares = squares_of_area(region, area)
    ensure_points(region, REGIONS, squares)
    return sorted(squares & region.used)


def find_regions(region: Region, blocks: Sequence[Block]) -> None:
    """Large objects, the ground, rasters and regions of buildings of some blocks, and what these take of the
    blocks around."""
    ensure(region, REGIONS, region.workers.heaviest_first(blocks, region.store.count_points))


def blocks_ahead(region: Region, area: Area, done: Sequence[Block]) -> list[Block]:
    """The blocks into which buildings of an area go on from those that are done."""
    if not area.tiles or region.run.given is not None:
        return []
    beyond = blocks_beyond(seams(region, done), area.holds) - set(done)
    ensure_points(region, REGIONS, beyond)
    return sorted(beyond & region.used)


def join_buildings(region: Region, area: Area, done: Sequence[Block]) -> list[OwnedBuildings]:
    """The buildings of an area, from the regions of the blocks that are done, or from given footprints."""
    run = region.run
    if run.given is not None:
        owned = given_in(region, area)
        plans = assign_footprints(owned.footprints, region.blocks, run.first_block, owned.lost)
    else:
        plans = with_addresses(join_regions(seams(region, done)), run.addresses)
    region.budget.step(REGIONS.name)
    return [plan for plan in plans if area.holds(plan.owner_block)]


def seams(region: Region, blocks: Sequence[Block]) -> list[Seam]:
    """The results that the join needs, of all blocks that could be computed."""
    return [Seam.read(result) for result in results_of(REGIONS, region.store, sorted(blocks)).values()]


def model_plans(region: Region, plans: Sequence[OwnedBuildings]) -> None:
    """Outlines, units, roofs and solids of the buildings of some owner blocks."""
    ensure_points(region, BUILDINGS, plans)
    ensure(region, BUILDINGS, region.workers.heaviest_first(plans, partial(size_of, region)))
    region.budget.step(BUILDINGS.name)


def size_of(region: Region, plan: OwnedBuildings) -> float:
    """Number of points of an owner block's buildings, or the area (m²) of given ones: a hall may take longer
    than a street."""
    outlines = [building.given for building in plan.buildings if building.given is not None]
    if outlines:
        return float(sum(footprint.polygon.area for footprint in outlines))
    labels = {block: region.store.array(REGIONS.name, block, "label") for block in plan.blocks}
    parts = [part for building in plan.buildings for part in building.regions]
    return float(sum(int((labels[block] == label).sum()) for block, label in parts))


def end_region(region: Region, complete: bool) -> None:
    """Leave of the results what is to be kept: none of a complete run, but those of this one where they are
    asked for."""
    store = region.store
    store.drop_records()
    if region.run.options["keep"]:
        request = {**request_of(region.run), "plan": region.run.plan}
        with atomic(store.folder / REQUEST) as temporary:
            temporary.write_text(json.dumps(request), encoding="utf-8")
    elif complete:
        store.discard()


def import_methods(recipe: Recipe) -> None:
    """No-op; unpickling it makes a worker import the methods."""
