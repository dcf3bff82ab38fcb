"""A later scan of a part of a run's area: a build over the changed points that finds most of its results."""

from __future__ import annotations

import datetime
import logging
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import laspy
import numpy as np

from eaves.blocks.superseded import files_of, scan_number
from eaves.buildings.building_file import Kept, as_found
from eaves.change.edits import settle, write_edits
from eaves.change.upkeep.corrected import correct, outlines_in
from eaves.change.upkeep.kept import MODELS, open_kept, read_request
from eaves.change.upkeep.rebuild import LAYER, changed_in_layer, kept_edits
from eaves.change.upkeep.versions import Versions, known_ids, lines_of, name_versions, write_history
from eaves.flow.classified_points import known_copies
from eaves.flow.collisions import EDITS, is_same_place
from eaves.flow.numbers import keep_numbers, numbers_of_owners
from eaves.flow.outputs import write_outputs
from eaves.flow.region import Region, end_region, open_region, store_of
from eaves.flow.run import WORK, Progress, no_progress
from eaves.formats import InputError
from eaves.formats.inputs import LAS_SUFFIXES, list_inputs
from eaves.model.summary import IncompleteRunError, Summary
from eaves.pipeline import bring_points, find_buildings, hold_folder
from eaves.run.keys import EDITED, NAMED, REGIONS, SUPERSEDED
from eaves.run.lock import lock_folder
from eaves.run.manifest import begin_manifest, end_manifest
from eaves.run.store import Store, link_file

log = logging.getLogger("eaves")

AWAY_BLOCKS = 2
"""New points farther than so many blocks from all of the run's are of another place."""


@dataclass(frozen=True, eq=False)
class Updated:
    """The result of an update."""

    summary: Summary
    date: str
    points: tuple[int, int]
    """Number of points added, and number replaced."""
    blocks: tuple[int, int]
    """Number of blocks computed again, and number of all."""
    versions: Versions
    conflicts: tuple[str, ...] = ()
    """Among the edits, and edits whose building was removed."""
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
        return "\n".join([*lines, *(f"conflict: {words}" for words in self.conflicts)])


def update(
    folder: str | Path,
    inputs: str | Path | Sequence[str | Path],
    out: str | Path,
    date: str | None = None,
    jobs: int = 1,
    progress: Progress = no_progress,
    overwrite: bool = False,
    allow_failures: bool = False,
) -> Updated:
    """A run's results after a later scan of a part of its area, in a folder of their own.

    New points take the place of the earlier ones in the area that they cover (`eaves.blocks.superseded`).
    What comes out is what a build of the points that stay and the new ones gives; a step that takes what it
    took before is found by its key. Buildings keep their ids where half of their outline stays, and edits are
    kept.

    Parameters
    ----------
    folder : str or Path
        Folder of `eaves build --keep` or of an earlier update. It stays as it is.
    inputs : str, Path or sequence of them
        The new points: files, folders or globs, in the run's reference system.
    out : str or Path
        Folder for the results; another one.
    date : str or None
        `YYYY-MM-DD`, for the `creationDate` and `terminationDate` of what changes; by default the latest
        creation date in the headers of the new files.
    jobs : int
        Processes.
    progress : callable
        Called with the step, how much of it is done, and how much there is.
    overwrite : bool
        Write over edits, changed files and the results of other inputs that `out` holds.
    allow_failures : bool
        Return what there is when a part could not be computed.

    Returns
    -------
    Updated
        The summary of the new results, and the buildings that are new, modelled again or gone.

    Raises
    ------
    InputError
        When the folder keeps no parts, or the new points do not fit it; nothing is written then.
    IncompleteRunError
        When a part could not be computed, after all the others.

    Examples
    --------
    >>> import eaves
    >>> updated = eaves.update("out", "later.laz", "out-2026")            # doctest: +SKIP
    >>> updated.versions.new                                              # doctest: +SKIP
    ['b351_1863_66_250']
    """
    folder, out = Path(folder), Path(out)
    known = read_request(folder).inputs
    new = check_inputs(folder, known, list_inputs(inputs), out)
    when = date_of(new, date)
    run = open_kept(folder, new, out, jobs, overwrite)
    with lock_folder(folder), hold_folder(run) as workers:
        before = replace(store_of(run), folder=folder / WORK)
        shown = outlines_in(Kept(before), run.side)
        if shown and changed_in_layer(folder, before, shown):
            raise InputError.about(
                folder / LAYER, "has edits that were not rebuilt", f"run eaves update {folder} first"
            )
        store_of(run).discard()
        link_results(before.folder, run.work_folder)
        region = open_region(run, workers, progress)
        bring_points(region)
        check_place(region)
        begin_manifest(out)
        owners = find_buildings(region)
        store = region.store
        versions, changed = name_versions(store, as_found(before), owners, known_ids(folder), when)
        edits = kept_edits(folder, store)
        orders, conflicts = settle(edits, outlines_in(as_found(store), run.side))
        edited = correct(region, orders)
        keep_numbers(
            store, sorted(changed | edited.touched), numbers_of_owners(before, Kept(before).owners(run.side))
        )
        summary = write_outputs(region, Kept(store).owners(run.side), copies=known_copies(folder, before))
        beside = walls_changed(folder, out, {*versions.new, *versions.remodelled, *(o.id for o in orders)})
        words = {
            "date": when,
            "inputs": [Path(path).name for path in new],
            "new": len(versions.new),
            "remodelled": len(versions.remodelled),
            "gone": len(versions.gone),
            "beside": len(beside),
        }
        files = [*summary.files, *write_history(folder, out, MODELS, versions.ended, when)]
        if (folder / EDITS).exists():
            write_edits(out / EDITS, edits, store.system)
            files.append(out / EDITS)
        region.run = replace(run, updates=(*run.updates, words))
        end_region(region, summary.complete)
        end_manifest(out, files, summary.complete)
        conflicts += [f"no model: {one}" for one in edited.failed]
        updated = Updated(
            replace(summary, files=tuple(files)),
            when,
            points_counted(region),
            (blocks_computed(region, before), len(region.blocks)),
            versions,
            tuple(conflicts),
            tuple(beside),
        )
    if summary.failed and not allow_failures:
        raise IncompleteRunError(summary.failed, updated)
    return updated


def check_inputs(folder: Path, known: Sequence[str], paths: Sequence[str], out: Path) -> list[str]:
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
        if path in known:
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


def link_results(source: Path, target: Path) -> None:
    """The results of a run under other names, without taking room where the disk can do that, but for what
    edits made of them. They are never written in place, so neither run sees what the other does."""
    for place, folders, names in os.walk(source):
        folders[:] = [name for name in folders if name not in (EDITED, NAMED)]
        to = target / Path(place).relative_to(source)
        to.mkdir(parents=True, exist_ok=True)
        for name in names:
            if not name.startswith("."):
                link_file(Path(place) / name, to / name)


def check_place(region: Region) -> None:
    """Check that the last scan has points, near those of the others.

    Raises
    ------
    InputError
        When it has none that are used, or they lie far from all others; nothing of the update stays then.
    """
    run, store = region.run, region.store
    first = run.generations[-1]
    path = run.index.path(first)
    fresh, held = [], []
    for block in store.blocks(run.side):
        numbers = [scan_number(one) for one in files_of(store, block)]
        fresh += [block] * (max(numbers) >= first)
        held += [block] * (min(numbers) < first)
    if not fresh:
        region.store.discard()
        raise InputError.about(
            path, "has no point that the run would use", "check its coordinates and --bounds"
        )
    places = np.array([(block.column, block.row) for block in held])
    away = min(int(np.abs(places - [block.column, block.row]).max(axis=1).min()) for block in fresh)
    if away > AWAY_BLOCKS:
        region.store.discard()
        raise InputError.about(
            path,
            f"lies {away * run.side / 1000:.1f} km from all points of the run",
            "check its coordinates, or build it by itself",
        )


def points_counted(region: Region) -> tuple[int, int]:
    """Number of points that the last scan added, and of earlier ones that it replaced."""
    store = region.store
    counts = [store.array(SUPERSEDED, block, "counts") for block in store.units(SUPERSEDED, region.run.side)]
    came, went = np.sum([np.zeros(2, np.int64), *counts], axis=0).tolist()
    return int(came), int(went)


def blocks_computed(region: Region, before: Store) -> int:
    """Number of blocks whose results differ from those before."""
    known = set(before.found(REGIONS, region.blocks))
    return sum(one not in known for one in region.store.found(REGIONS, region.blocks))


def walls_changed(folder: Path, out: Path, others: set[str]) -> list[str]:
    """The buildings, but for some others, whose lines changed: they share other walls."""
    before, after = lines_of(folder / MODELS), lines_of(out / MODELS)
    return sorted(
        name for name in after if name in before and name not in others and before[name] != after[name]
    )
