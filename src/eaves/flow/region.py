"""A region of points and the steps that it goes through; `eaves.pipeline` names them in their order."""

from __future__ import annotations

import json
import logging
import shutil
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from eaves.blocks.seams import REACH, compare_heights, find_steps, shared_places
from eaves.blocks.thinned import FEW_PER_M2
from eaves.buildings.building_file import NUMBERS
from eaves.buildings.edited import OwnedOrders
from eaves.buildings.join import (
    OwnedBuildings,
    Seam,
    assign_footprints,
    blocks_beyond,
    join_regions,
    with_addresses,
)
from eaves.flow.run import Progress, Run, request_of
from eaves.flow.step import Region, Step, Work, ensure, read_key, results_of, squares_read, store_of
from eaves.flow.steps import (
    BUILDINGS,
    EDITED,
    FLOORS,
    POINTS,
    REGIONS,
    SHARPENED,
    SUPERSEDED,
    THINNED,
)
from eaves.flow.tiles import (
    Area,
    bounds_by_tile,
    by_tile,
    evict,
    given_in,
    inputs_meeting,
    squares_of_area,
)
from eaves.formats.whole_files import atomic
from eaves.model import GRID_STEP, Block
from eaves.recipe.recipe import Recipe
from eaves.run.keys import NAMED, key_of
from eaves.run.partition import (
    FileSlice,
    PartFacts,
    Window,
    file_slices,
    find_isolated_blocks,
    keys_of_points,
    number_of,
)
from eaves.run.points import load_inputs
from eaves.run.workers import Workers
from eaves.run.world_squares import ring

log = logging.getLogger("eaves")

REQUEST = "request.json"
"""Beside the results that are kept: what the run was asked for; run.json lacks it while files are written."""
EARLIER = "earlier"
"""Folder, beside the results of a run that is updated in its place, of those that it shows until then."""


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
    for name in (NAMED, EDITED.name, EARLIER):
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
    region.budget.step("read")


def note_part(region: Region, part: FileSlice, broken: Sequence[str]) -> None:
    """Note what is known of a part of an input that was read, or of which lines say what broke it."""
    if not region.store.has(POINTS.name, part):
        region.parts.pop(part.name, None)
        reasons = (line for line in broken if line.startswith(part.label))
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


def remark_on_copies(region: Region) -> None:
    """Say how many points are copies of others, and of which inputs the first ones are."""
    if not region.copies:
        return
    index, count = region.run.index, sum(copies[0] for copies in region.copies.values())
    ids = region.copies[min(region.copies)][1:]
    numbers = np.searchsorted(index.starts, ids, side="right") - 1
    files = " and ".join(dict.fromkeys(index.path(int(number)).name for number in numbers))
    region.remark(
        f"{count:,} of {region.points:,} points are identical to others (the first: in {files}) and count "
        "once: a file given twice, tiles with a buffer, or a strip copied"
    )


def remark_on_steps(region: Region) -> None:
    """Say which two inputs differ most in height where they meet, and by how much."""
    found = find_steps([region.heights[block] for block in sorted(region.heights)])
    if not found:
        return
    step, *numbers, places = found[0]
    low, high = (region.run.index.path(number).name for number in (numbers if step > 0 else numbers[::-1]))
    others = f"; {len(found) - 1} more pairs of files differ" if len(found) > 1 else ""
    facts = f"{abs(step):.2f} m higher than {low} where they meet (median of {places:,} places{others})"
    region.remark(
        f"{high} lies {facts}: a vertical step between files, as of two height systems; heights of "
        "the results follow each file"
    )


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
    region.budget.step("blocks")
    return [plan for plan in plans if area.holds(plan.owner_block)]


def seams(region: Region, blocks: Sequence[Block]) -> list[Seam]:
    """The results that the join needs, of all blocks that could be computed."""
    return [Seam.read(result) for result in results_of(REGIONS, region.store, sorted(blocks)).values()]


def model_plans(region: Region, plans: Sequence[OwnedBuildings]) -> None:
    """Outlines, units, roofs and solids of the buildings of some owner blocks."""
    ensure_points(region, BUILDINGS, plans)
    ensure(region, BUILDINGS, region.workers.heaviest_first(plans, partial(size_of, region)))
    region.budget.step("buildings")


def model_edits(region: Region, units: Sequence[OwnedOrders]) -> None:
    """The buildings of some owner blocks after a person's edits."""
    for group in by_tile(region, units):
        ensure_points(region, EDITED, group)
        ensure(region, EDITED, group)
        if region.run.by_tiles:
            evict(region)


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
