"""A later scan of a part of a run's area: only what its points change is computed again."""

from __future__ import annotations

import datetime
import logging
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import laspy
import numpy as np

from eaves.change.edits import EDITS, Order, read_edits, settle, write_edits
from eaves.change.kept import (
    MODELS,
    Request,
    frame_of,
    open_kept,
    ordered,
    read_request,
    recipe_of,
    write_request,
)
from eaves.change.points import Replacement, number_of, replace_points
from eaves.change.rebuild import (
    LAYER,
    ORIGINALS,
    REMEMBERED,
    RememberingStore,
    State,
    changed_in_layer,
    is_edited,
)
from eaves.change.reuse import (
    changed_keys,
    goes_on,
    model_again,
    near_gatherer,
    plans_to_model,
    touched_blocks,
)
from eaves.change.stale import compute_stale, link_tree
from eaves.change.versions import Versions, known_ids, name_versions, write_history
from eaves.formats import InputError
from eaves.formats.atomic import report_full_disk
from eaves.formats.inputs import LAS_SUFFIXES, list_inputs
from eaves.model import Block
from eaves.model.summary import Summary
from eaves.run.classified_points import EarlierPoints
from eaves.run.collisions import is_same_place
from eaves.run.earlier_lines import EarlierLines
from eaves.run.join import OwnedBuildings
from eaves.run.lock import lock_folder
from eaves.run.manifest import begin_manifest, end_manifest
from eaves.run.numbers import keep_numbers, numbers_in
from eaves.run.outputs import write_outputs
from eaves.run.partition import file_slices, partition_slice
from eaves.run.region import Core, Region
from eaves.run.run import WORK, Progress, Run, no_progress, open_run
from eaves.run.store import COMPUTED, REQUEST, SUPERSEDED, Store, link_file
from eaves.run.workers import Workers
from eaves.run.world_squares import ring

log = logging.getLogger("eaves")

EARLIER = "earlier"
"""Folder, within the parts of an update under way, of those of the run that it goes on from."""

REMEMBERED_BLOCKS = 1000
"""The buildings of so many owner blocks are kept in memory while their files are written; of more they are
read again for each."""

FIELDS = "return_number", "classification"
"""Where the new files have one of these and the earlier ones had not, or the other way round, every block is
computed otherwise."""

AWAY_BLOCKS = 2
"""New points farther than so many blocks from all of the run's are of another place."""


@dataclass(frozen=True, eq=False)
class Updated:
    """What an update did."""

    summary: Summary
    date: str
    points: tuple[int, int]
    """How many came, and how many went."""
    blocks: tuple[int, int]
    """How many blocks were computed again, of how many."""
    versions: Versions
    conflicts: tuple[str, ...] = ()
    """Among the edits, and edits whose building is no more."""
    beside: tuple[str, ...] = ()
    """Ids of buildings that are as they were but for the walls they share: a neighbour changed. Their lines
    say the new areas; their version stays, for it is that of the building itself."""

    def as_text(self) -> str:
        """The closing lines."""
        came, went = self.points
        named, found = self.versions, self.summary.found
        new, again, gone = len(named.new), len(named.remodelled), len(named.gone)
        lines = [
            f"{came:,} points came, {went:,} gave way; "
            f"{self.blocks[0]:,} of {self.blocks[1]:,} blocks were computed again",
            f"{found:,} buildings: {found - new - again:,} as they were, {again:,} modelled again, "
            f"{new:,} new; {gone:,} are no more",
        ]
        if self.beside:
            lines.append(f"{len(self.beside):,} of those as they were share other walls with a neighbour")
        return "\n".join([*lines, *(f"conflict: {told}" for told in self.conflicts)])


def update(
    folder: Path,
    inputs: str | Path | Sequence[str | Path],
    out: Path,
    date: str | None = None,
    jobs: int = 1,
    progress: Progress = no_progress,
) -> Updated:
    """A run's results after a later scan of a part of its area, in a folder of their own.

    New points take the place of the earlier ones in the area that they cover (`eaves.change.points`). What
    follows from them is computed again as far as it differs; everything else is taken over, models byte for
    byte. Buildings keep their ids where half of their outline stays. Edits are kept.

    Parameters
    ----------
    folder
        What `eaves build --keep`, or an earlier update, wrote. It stays as it is.
    inputs
        The new points: files, folders or globs, in the run's reference system.
    out
        Folder for the results; another one.
    date
        `YYYY-MM-DD`, for the `creationDate` and `terminationDate` of what changes; by default the latest
        creation date in the headers of the new files.
    jobs
        Processes.
    progress
        Called with the step, how much of it is done, and how much there is.

    Raises
    ------
    InputError
        When the folder keeps no parts, or the new points do not fit it; nothing is written then.
    """
    folder, out = Path(folder), Path(out)
    REMEMBERED.clear()
    request = read_request(folder)
    new = check_inputs(folder, request, list_inputs(inputs), out)
    when = date_of(new, date)
    open_kept(folder)
    run = open_update(request, new, out, jobs)
    run = replace(run, translate=frame_of(folder))
    with (
        lock_folder(folder),
        lock_folder(out),
        report_full_disk(out),
        Workers(run.jobs) as workers,
    ):
        region = Region(run, run.work_folder, workers, progress)
        shown = replace(region.store, folder=folder / WORK)
        check_edits(folder, shown)
        before = take_parts(folder, region.store, request)
        few = len(request.owners) <= REMEMBERED_BLOCKS
        if few:
            shown, before = RememberingStore(**vars(shown)), RememberingStore(**vars(before))
        own = {os.path.realpath(run.index.path(k)) for k in range(len(run.index))}
        first_new = len(own & {os.path.realpath(path) for path in request.inputs})
        try:
            changed = bring_points(region, first_new, progress)
        except InputError:
            region.store.discard()
            raise
        begin_manifest(out)
        blocks = region.used_blocks()
        region.check_rasters(blocks)
        computed = compute_stale(region, before, changed.places, blocks)
        plans = region.join(blocks, Core(holds=lambda block: True))
        old = planned(request, before, run, workers)
        versions, owners, again = model_changed(
            region, before, plans, old, request, changed, known_ids(folder), when
        )
        if few:
            region.store = RememberingStore(**vars(region.store))
        edits, orders, conflicts, owners, edited = edit_again(folder, region, blocks, owners, progress)
        outputs = tuple(name for name in run.outputs if name != "report")
        region.run = run.with_options(outputs=outputs)
        others = {*versions.new, *versions.remodelled, *versions.gone, *(order.id for order in orders)}
        places = [*versions.outlines, *(one for order in orders for one in order.outlines)]
        lines = EarlierLines.read(folder / MODELS, others, places)
        keep_numbers(region.store, sorted({*again, *edited}), numbers_in(shown, request.owners))
        points = EarlierPoints.of(folder, before, run.index.subset(np.arange(first_new)))
        plans, known = [OwnedBuildings(owner, ()) for owner in owners], set(lines.places)
        summary = write_outputs(region, blocks, plans, earlier=lines, points=points)
        beside = sorted(known - set(lines.places))
        told = {
            "date": when,
            "inputs": [Path(path).name for path in new],
            "new": len(versions.new),
            "remodelled": len(versions.remodelled),
            "gone": len(versions.gone),
            "beside": len(beside),
        }
        plan = {**run.plan, "updates": [*request.plan.get("updates", []), told]}
        ended = [*versions.gone, *versions.remodelled]
        files = [*summary.files, *write_history(folder, out, MODELS, ended, when), *edits]
        shutil.rmtree(before.folder)
        merged = [*request.inputs, *new]
        write_request(
            region.store, Request(tuple(merged), request.options, plan, tuple(blocks), tuple(owners))
        )
        region.store.keep_plan(plan)
        end_manifest(out, files, summary.about, summary.complete)
        counts = (changed.came, changed.went), (computed, len(blocks))
        whole = replace(summary, files=tuple(files))
        return Updated(whole, when, *counts, versions, tuple(conflicts), tuple(beside))


def check_inputs(folder: Path, request: Request, paths: Sequence[str], out: Path) -> list[str]:
    """The true paths of new files, when they and the output folder can be used.

    Raises
    ------
    InputError
        When a file is one of the run already, or one of its results, or `out` is the run's folder.
    """
    if is_same_place(folder, out):
        raise InputError.about(out, "is the folder of the run that is updated", "choose another with -o")
    new = [os.path.realpath(path) for path in paths]
    for path in new:
        if path in request.inputs:
            raise InputError.about(path, f"is an input of {folder} already", "give the new points alone")
        if is_same_place(Path(path).parent, folder):
            raise InputError.about(path, f"lies in {folder}, among its results", "give the new points alone")
    return new


def date_of(paths: Sequence[str], date: str | None) -> str:
    """The date of an update, checked, or from the headers of the new files.

    Raises
    ------
    InputError
        When it is none, or no header states one.
    """
    if date is not None:
        try:
            return datetime.date.fromisoformat(date).isoformat()
        except ValueError:
            raise InputError(f"--date {date}: no date; write it as 2026-05-31") from None
    dates = []
    for path in paths:
        if Path(path).suffix.lower() in LAS_SUFFIXES:
            try:
                with laspy.open(path) as file:
                    dates.append(file.header.creation_date)
            except Exception as error:  # what is wrong with the file is said where it is read
                log.debug("%s: %s", path, error)
    known = [one for one in dates if one is not None and one.year > 1]
    if not known:
        raise InputError.about(
            paths[0], "states no date in its header", "give the scan's with --date 2026-05-31"
        )
    return str(max(known).isoformat())


def open_update(request: Request, new: Sequence[str], out: Path, jobs: int) -> Run:
    """The run over the earlier and the new inputs, in this order: so points keep their ids.

    Raises
    ------
    InputError
        When a new file cannot be used, or its reference system is another.
    """
    inputs = [*request.inputs, *new]
    options = {**request.options, "jobs": jobs}
    run = open_run(inputs, out, recipe_of(request.plan), keep=True, **options)
    broken = [reason for reason in run.failed if any(path in reason for path in new)]
    if broken:
        raise InputError(broken[0])
    return ordered(run, inputs)


def take_parts(folder: Path, store: Store, request: Request) -> Store:
    """Fill a store with a run's parts but for its buildings; the store of all its parts as it found them."""
    store.discard()
    store.prepare()
    source = folder / WORK
    before = replace(store, folder=store.folder / EARLIER)
    link_tree(source, before.folder)
    originals = before.folder / ORIGINALS
    for path in sorted((originals / "buildings").glob("*.npz")):
        link_file(path, before.folder / "buildings" / path.name)
    for path in originals.glob("*.added"):
        (before.folder / "buildings" / f"{path.stem}.npz").unlink(missing_ok=True)
    shutil.rmtree(originals, ignore_errors=True)
    for kind in ("points", *(kind for kind in COMPUTED if kind != "buildings")):
        link_tree(before.folder / kind, store.folder / kind)
    superseded = before.folder / SUPERSEDED
    if superseded.exists():
        link_file(superseded, store.folder / SUPERSEDED)
    (store.folder / REQUEST).unlink(missing_ok=True)
    return before


def check_edits(folder: Path, shown: Store) -> None:
    """Nothing, when no edit waits to be rebuilt; `shown` are the parts of the folder.

    Raises
    ------
    InputError
        When the layer was changed since.
    """
    if not is_edited(folder):
        return
    owners = [Block(*map(int, path.stem.split("_"))) for path in (shown.folder / "buildings").glob("*.npz")]
    outlines = {str(row.values["id"]): row.polygon for row in shown.building_rows(owners)}
    if outlines and changed_in_layer(folder, shown, outlines):
        raise InputError.about(
            folder / LAYER, "has edits that were not rebuilt", f"run eaves update {folder} first"
        )


def bring_points(region: Region, first_new: int, progress: Progress) -> Replacement:
    """Bring the new points to their blocks, in the place of earlier ones.

    Raises
    ------
    InputError
        When a file cannot be read to its end, or the points lie far from all others.
    """
    run, store = region.run, region.store
    parts = [part for part in file_slices(run.index) if part.number >= first_new]
    total, read = sum(part.count for part in parts), 0
    held = set(store.blocks(run.side))
    work = partial(partition_slice, store=store, side=run.side, window=run.window)
    for outcome in region.workers.run(work, parts):
        part = parts[outcome.index]
        region.budget.add("read", outcome.cpu)
        if outcome.answer is None or outcome.answer.unread is not None:
            raise InputError(outcome.error or outcome.answer.unread)
        read += part.count
        progress("read", min(read, total), total)
    fresh = {
        block
        for block in store.blocks(run.side)
        if any(number_of(path) >= first_new for path in store.points_path(block).glob("*.bin"))
    }
    path = run.index.path(first_new)
    if not fresh:
        raise InputError.about(
            path, "has no point that the run would use", "check its coordinates and --bounds"
        )
    places = np.array([(block.column, block.row) for block in sorted(held)])
    away = min(int(np.abs(places - [block.column, block.row]).max(axis=1).min()) for block in sorted(fresh))
    if away > AWAY_BLOCKS:
        raise InputError.about(
            path,
            f"lies {away * run.side / 1000:.1f} km from all points of the run",
            "check its coordinates, or build it by itself",
        )
    done = replace_points(store, first_new, run.side)
    earlier = run.index.subset(np.arange(first_new))
    if any(earlier.has_field(name) != run.index.has_field(name) for name in FIELDS):
        done.places = {block: [block.bounds] for block in store.blocks(run.side)}
    return done


def planned(request: Request, before: Store, run: Run, workers: Workers) -> list[OwnedBuildings]:
    """The buildings of the earlier run, as it joined them."""
    region = Region(run, before.folder, workers, no_progress)
    region.store = before
    blocks = [block for block in request.blocks if before.has("blocks", block)]
    region.blocks = blocks
    return region.join(blocks, Core(holds=lambda block: True))


def model_changed(
    region: Region,
    before: Store,
    plans: Sequence[OwnedBuildings],
    old: Sequence[OwnedBuildings],
    request: Request,
    changed: Replacement,
    ended: set[str],
    date: str,
) -> tuple[Versions, list[Block], set[Block]]:
    """Model the buildings of the owner blocks that may be others now, and take over those of all others; the
    versions, the blocks that own buildings, and those whose buildings may be others."""
    store, run = region.store, region.run
    cells = changed_keys(np.concatenate(changed.cells))
    near = touched_blocks(cells, run.side)
    if run.given is not None:  # given outlines may overlap, and share points across blocks
        near = {block for one in {*near, *changed.places} for block in ring(one)}
    near |= goes_on(plans, store, near, cells) | goes_on(old, before, near, cells)
    todo = plans_to_model(plans, old, request.owners, near)
    again = {one.now.owner_block for one in todo}
    for plan in plans:
        if plan.owner_block not in again and before.has("buildings", plan.owner_block):
            link_file(before.path("buildings", plan.owner_block), store.path("buildings", plan.owner_block))
    work = partial(
        model_again,
        store=store,
        before=before,
        recipe=run.recipe,
        snap=run.options["snap_footprints"],
        changed=cells,
    )
    todo = list(region.workers.heaviest_first(todo, lambda one: len(one.now.buildings)))
    modelled: dict[Block, list[bool]] = {}
    near_gatherer.cache_clear()
    for done, outcome in enumerate(region.workers.run(work, todo), 1):
        owner = todo[outcome.index].now.owner_block
        region.note(outcome, f"buildings of block {owner.name}")
        region.budget.add("buildings", outcome.cpu)
        region.progress("buildings", done, len(todo))
        if outcome.answer is not None:
            modelled[owner] = outcome.answer
    near_gatherer.cache_clear()
    owners = sorted({plan.owner_block for plan in plans} | set(modelled))
    taken = ended | {
        str(row.values["id"]) for row in store.building_rows([one for one in owners if one not in modelled])
    }
    versions = name_versions(store, before, dict(sorted(modelled.items())), taken, date)
    planned_now = {plan.owner_block for plan in plans}
    owners = [one for one in owners if one in planned_now or any(True for _ in store.planes(one))]
    return versions, owners, set(modelled)


def edit_again(
    folder: Path, region: Region, blocks: Sequence[Block], owners: Sequence[Block], progress: Progress
) -> tuple[list[Path], list[Order], list[str], list[Block], set[Block]]:
    """Carry out the edits of the earlier run: their file, what they ask for, conflicts, the owner blocks, and
    those of them that were edited."""
    if not (folder / EDITS).exists():
        return [], [], [], list(owners), set()
    run = region.run
    store = RememberingStore(**vars(region.store))
    edits = read_edits(folder / EDITS, store.system)
    state = State(store, blocks, owners, run.recipe)
    orders, conflicts = settle(edits, state.found())
    _, _, failed = state.apply(orders, progress)
    path = run.folder / EDITS
    write_edits(path, edits, store.system)
    told = [*conflicts, *(f"no model: {one}" for one in failed)]
    return [path], orders, told, state.owners, state.touched
