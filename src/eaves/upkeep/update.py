"""A run opened again, to be corrected or updated: with the results that it kept (`eaves build --keep`), about
100 bytes a point, or without any, so that all of them are computed again."""

from __future__ import annotations

import datetime
import json
import logging
import os
import shutil
from collections.abc import Collection, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import laspy
import numpy as np

from eaves.buildings.building_file import (
    NUMBERS,
    SavedBuildings,
    found_buildings,
    keep_numbers,
    numbers_of_owners,
)
from eaves.flow.classified import known_copies
from eaves.flow.corrected import Corrected, changed_in_layer, correct, kept_edits, outlines_in
from eaves.flow.edits import Edit, read_edits, write_edits
from eaves.flow.outputs import write_outputs
from eaves.flow.refusals import EDITS, is_same_place
from eaves.flow.region import EARLIER, REQUEST, Region, drop_upkeep, end_region, ensure_points, open_region
from eaves.flow.results import Results
from eaves.flow.run import Progress, Run, look_at_scan, no_progress, open_run, stated_request
from eaves.flow.step import store_of
from eaves.formats import InputError
from eaves.formats.inputs import LAS_SUFFIXES, list_inputs
from eaves.methods import installed_methods, resolve_method
from eaves.model import GRID_STEP, Points
from eaves.pipeline import compute_buildings, hold_folder
from eaves.recipe.recipe import Recipe
from eaves.run.index import Index
from eaves.run.keys import BUILDINGS, CLASSIFIED, EDITED, NAMED, REGIONS, SUPERSEDED
from eaves.run.manifest import begin_manifest, end_manifest, lock_folder, read_facts
from eaves.run.options import DECLARED, METHOD_OPTIONS
from eaves.run.store import WORK, Store, link_file
from eaves.surroundings.wires import VegetationRules
from eaves.upkeep.versions import Versions, known_ids, lines_of, name_versions, write_history

log = logging.getLogger("eaves")

MODELS = "buildings.city.jsonl"
"""The file of a run's models."""

REMEDY = "build it again with --keep"
DECISIVE = ("methods", "use_classes", "lod", "clip", "footprints", "party_walls")
"""Of a run's plan: where one of these is another, the results are."""


@dataclass(frozen=True)
class Request:
    """The request of a run, and the updates that it went through."""

    inputs: Sequence[str]
    options: dict[str, Any]
    plan: dict[str, Any]
    generations: Sequence[int]
    updates: Sequence[dict[str, Any]]
    keep: bool = False
    """True if its results are kept."""


def read_request(folder: Path) -> Request:
    """The request of the run in a folder: that beside the results that it kept, or else that in its run.json.

    Raises
    ------
    InputError
        When there is none, or it is damaged, or of another version.
    """
    path = folder / WORK / REQUEST
    if not folder.is_dir():
        raise InputError.about(folder, "does not exist", "give what `eaves build --keep` wrote")
    facts = read_facts(folder)
    try:
        if path.exists():
            request = Request(**json.loads(path.read_text(encoding="utf-8")), keep=True)
        else:
            request = Request(plan=facts, **facts["request"])
    except KeyError:
        raise InputError.about(folder, "keeps no parts of its run", REMEDY) from None
    except TypeError:
        raise InputError.about(folder, "keeps parts that another version of eaves wrote", REMEDY) from None
    except (ValueError, RecursionError):
        raise InputError.about(path, "is damaged", REMEDY) from None
    if request.options.keys() - DECLARED.keys():
        raise InputError.about(folder, "keeps parts that another version of eaves wrote", REMEDY)
    return request


def open_again(
    folder: Path,
    new: Sequence[str] = (),
    out: Path | None = None,
    jobs: int = 1,
    overwrite: bool = False,
    methods: Collection[str] = (),
) -> Run:
    """The run of a folder, opened again; with `new` inputs, a later scan, into `out`. Of other packages the
    `methods` named (`module:Class`) are imported.

    Points keep their ids, for the inputs keep their order.

    Raises
    ------
    InputError
        When the folder holds none, an input is missing, has changed or cannot be used, another version made
        the results, results are needed that it did not keep, or `out` holds what would be written over.
    """
    request = read_request(folder)
    if not request.keep and (new or request.generations):
        raise InputError.about(folder, "keeps no parts of its run", REMEDY)
    inputs = [*request.inputs, *new]
    # in its own folder edits are kept
    options = {**request.options, "jobs": jobs, "overwrite": overwrite or out is None}
    recipe = kept_recipe(request.plan, methods)
    run = look_at_scan(open_run(inputs, out or folder, recipe, keep=request.keep, resume=True, **options))
    broken = [reason for reason in run.failed if any(path in reason for path in new)]
    if broken:
        raise InputError(broken[0])
    index = ordered(run.index, inputs)
    for key in DECISIVE:
        if run.plan.get(key) != request.plan.get(key):
            raise InputError.about(
                folder, f"keeps parts of a run with another {key.replace('_', ' ')}", REMEDY
            )
    count = len(index) - len(new)
    if marks_of(index.subset(np.arange(count)).describe()) != marks_of(request.plan):
        raise InputError.about(folder, "keeps parts of inputs that have changed since", REMEDY)
    return replace(
        run,
        index=index,
        plan={**run.plan, **index.describe()},
        inputs=tuple(inputs),
        generations=(*request.generations, count) if new else tuple(request.generations),
        updates=tuple(request.updates),
        translate=frame_of(folder),
    )


def ordered(index: Index, inputs: Sequence[str]) -> Index:
    """The index with its files in an order of their true paths."""
    places = {os.path.realpath(path): k for k, path in enumerate(inputs)}
    order = sorted(range(len(index)), key=lambda k: places.get(os.path.realpath(index.path(k)), len(places)))
    return index.subset(np.array(order, np.int64))


def frame_of(folder: Path) -> tuple[float, ...] | None:
    """The origin of the coordinates of a run's models; None where it wrote none."""
    path = folder / MODELS
    try:
        with path.open(encoding="utf-8") as file:
            return tuple(map(float, json.loads(file.readline())["transform"]["translate"]))
    except FileNotFoundError:
        return None
    except (ValueError, KeyError, TypeError):
        raise InputError.about(path, "is damaged", REMEDY) from None


def marks_of(plan: dict[str, Any]) -> list[tuple[int, str]]:
    """Points and fingerprint of each input, wherever it lies; of very many inputs their common hash."""
    if "inputs" in plan:
        return [(entry["points"], entry["fingerprint"]) for entry in plan["inputs"]]
    return [(plan["files"], plan["inputs_sha256"])]


def kept_recipe(plan: dict[str, Any], named: Collection[str] = ()) -> Recipe:
    """The recipe that a run's plan states. A file imports no code: a method of another package is one that an
    installed package brings, or is among those `named`.

    Raises
    ------
    InputError
        When one is neither.
    """
    for stage in METHOD_OPTIONS:
        place = str((plan["methods"][stage] or {}).get("method"))
        if ":" in place and place not in {*named, *installed_methods(stage).values()}:
            raise InputError(
                f"the run's {stage} method is {place!r}, code that is not imported because a file names it; "
                f"if you trust it, add --method {place}"
            )
    methods: dict[str, Any] = {
        stage: None if table is None else resolve_method(stage, table, False)
        for stage, table in ((stage, plan["methods"][stage]) for stage in METHOD_OPTIONS)
    }
    vegetation = plan.get("vegetation")
    return Recipe(
        **methods,
        use_classes=plan["use_classes"],
        from_raster=bool(plan.get("from_raster")),
        lod=plan["lod"],
        ground_classes=tuple(plan.get("ground_classes") or (2,)),
        vegetation=None if vegetation is None else VegetationRules(**vegetation),
        others=plan.get("others", True),
        smallest=tuple(plan.get("smallest", Recipe.smallest)),
    )


def link_results(source: Path, target: Path) -> None:
    """The results of a run under other names, without taking room where the disk can do that. They are never
    written in place, so neither run sees what the other does."""
    hidden = shutil.ignore_patterns(EARLIER, ".*")
    shutil.copytree(source, target, copy_function=link_file, ignore=hidden, dirs_exist_ok=True)


AWAY_BLOCKS = 2
"""New points farther than so many blocks from all of the run's are of another place."""


@dataclass(frozen=True, eq=False, repr=False)
class Updated(Results):
    """The results of an update, and what it changed."""

    date: str | None = None
    """Of the new points; None where none came."""
    points_changed: tuple[int, int] = (0, 0)
    """Number of points added, and number replaced."""
    blocks: tuple[int, int] = (0, 0)
    """Number of blocks computed again, and number of all."""
    versions: Versions = field(default_factory=Versions)
    edits: tuple[Edit, ...] = ()
    """All edits of the run, earlier ones too."""
    corrected: Corrected = Corrected()  # noqa: RUF009 (frozen)
    """The result of the edits."""
    beside: tuple[str, ...] = ()
    """Ids of buildings that are as they were but for the walls they share: a neighbour changed. Their lines
    say the new areas; their version stays, for it is that of the building itself."""

    def as_text(self) -> str:
        """The closing lines."""
        named, count = self.versions, self.found
        new, again, gone = len(named.new), len(named.remodelled), len(named.gone)
        lines = []
        if self.date is not None:
            came, went = self.points_changed
            lines.append(
                f"{came:,} points added, {went:,} replaced; "
                f"{self.blocks[0]:,} of {self.blocks[1]:,} blocks were computed again"
            )
        if self.date is not None or new or again or gone:
            lines.append(
                f"{count:,} buildings: {count - new - again:,} unchanged, {again:,} modelled again, "
                f"{new:,} new; {gone:,} removed"
            )
        if self.beside:
            lines.append(f"{len(self.beside):,} unchanged buildings share other walls with a neighbour")
        if self.edits or self.date is None:
            lines.append(
                f"{len(self.edits)} edits: {len(self.corrected.modelled)} buildings modelled by them, "
                f"{len(self.corrected.removed)} removed"
            )
        lines += [f"conflict: {reason}" for reason in self.corrected.conflicts]
        return "\n".join([*lines, *(f"no model: {reason}" for reason in self.corrected.failed)])


def update(
    folder: str | Path,
    inputs: str | Path | Sequence[str | Path] = (),
    out: str | Path | None = None,
    date: str | None = None,
    jobs: int = 1,
    progress: Progress = no_progress,
    overwrite: bool = False,
    allow_failures: bool = False,
    edits: str | Path | None = None,
    methods: Sequence[str] = (),
) -> Updated:
    """A run's results after a later scan of a part of its area, after a person's edits, or both.

    It is a build over what the run kept: a step that takes what it took before is found by its key. New
    points take the place of the earlier ones in the area that they cover (`eaves.blocks.superseded`); what
    comes out is what a build of the points that stay and the new ones gives, but for buildings that these
    only confirm: where they took the place of earlier points of a group of buildings that stand wall to
    wall, and it differs nowhere by as much as a comparison of both epochs would list, it stays as it was.
    Others keep their ids where half of their outline stays. Edits are those kept in the folder's edits.gpkg,
    what was changed in its footprints.gpkg, and those of the file `edits`. Without new points a run need not
    have kept anything: all is then computed again.

    Parameters
    ----------
    folder : str or Path
        Folder of `eaves build`, with new points of `eaves build --keep` or of an earlier update.
    inputs : str, Path or sequence of them
        The new points: files, folders or globs, in the run's reference system.
    out : str, Path or None
        Folder for the results; None for `folder`. New points need another one: `folder` stays as it is.
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
    edits : str, Path or None
        More edits: polygons with a field `verdict`, and `id` where they are of a known building, or a CSV
        file of both fields.
    methods : sequence of str
        Methods of the run (`module:Class`) that no installed package brings, and that are to be imported.

    Returns
    -------
    Updated
        The new results, and the buildings that are new, modelled again or gone.

    Raises
    ------
    InputError
        When the folder keeps no parts, the new points do not fit it, an input has changed, or an edit cannot
        be read; no output changes then.
    IncompleteRunError
        When a part could not be computed, after all the others.

    Examples
    --------
    >>> import eaves
    >>> updated = eaves.update("out", "later.laz", "out-2026")            # doctest: +SKIP
    >>> updated.versions.new                                              # doctest: +SKIP
    ['b351_1863_66_250']
    """
    folder, out = Path(folder), Path(out or folder)
    if edits is not None and not Path(edits).exists():
        raise InputError.about(edits, "does not exist", "check the path")
    inside = is_same_place(folder, out)
    request = read_request(folder)
    new = check_inputs(folder, request.inputs, list_inputs(inputs), out) if inputs else []
    when = date_of(new, date) if new else None
    run = open_again(folder, new, None if inside else out, jobs, overwrite, methods)
    linked = request.keep and not inside
    with nullcontext() if inside else lock_folder(folder), hold_folder(run) as workers:
        if linked:
            store_of(run).discard()
            link_results(folder / WORK, run.work_folder)
        region = open_region(run, workers, progress)
        if new:
            ensure_points(region)
            check_place(region)
        if not request.keep:
            compute_again(region, folder)
        before = earlier_buildings(region.store, folder / WORK if linked else run.work_folder)
        ordered = all_edits(folder, edits, before, run.side)
        if not inside:
            begin_manifest(out)
        updated = update_region(region, before, folder, ordered, when)
    return updated.checked(allow_failures)


def compute_again(region: Region, folder: Path) -> None:
    """The buildings that a run shows which kept nothing: those that it found, and on them its edits."""
    log.info("%s: keeps no parts of its run, so that all of it is computed again", folder)
    drop_upkeep(region)
    compute_buildings(region)
    correct(region, kept_edits(folder, region.store.system))


def earlier_buildings(store: Store, folder: Path) -> SavedBuildings:
    """The buildings of the run that is updated, as it shows them, with its results in a folder.

    They are set aside, for the store goes on with the others; an update that was broken off leaves them.
    """
    aside, unfinished = store.folder / EARLIER, folder / EARLIER
    before = unfinished if unfinished.exists() else folder
    if before != aside:
        hidden = aside.with_name(f"{EARLIER}-{os.getpid()}")
        hidden.mkdir(exist_ok=True)
        for path in [before / name for name in (REGIONS, BUILDINGS, NAMED, EDITED, NUMBERS, CLASSIFIED)]:
            if path.exists():
                link = link_results if path.is_dir() else link_file
                link(path, hidden / path.name)
        hidden.rename(aside)
    return SavedBuildings(replace(store, folder=aside))


def all_edits(folder: Path, file: str | Path | None, shown: SavedBuildings, side: float) -> list[Edit]:
    """The edits that a run's folder keeps, those that a user made in its layer since it was written, and
    those of a file; of the buildings that the run shows, in blocks of a side (m)."""
    system, outlines = shown.store.system, outlines_in(shown, side)
    edits = [*kept_edits(folder, system), *changed_in_layer(folder, system, outlines)]
    detected = outlines_in(found_buildings(shown.store), side)
    return edits if file is None else [*edits, *read_edits(Path(file), system, {**detected, **outlines})]


def update_region(
    region: Region, before: SavedBuildings, folder: Path, edits: Sequence[Edit], date: str | None
) -> Updated:
    """The buildings of a region with the names of those before and with all edits, and the files of them; the
    folder is that of the run that is updated, the date that of new points."""
    store, side, out = region.store, region.run.side, region.run.folder
    owners, shown = compute_buildings(region), SavedBuildings(store)
    named = found_buildings(before.store)
    gave_way = places_superseded(store, side)
    versions, changed = name_versions(
        SavedBuildings(store, (BUILDINGS,)), named, owners, known_ids(folder), date, gave_way
    )
    edited = correct(region, edits)
    numbers = numbers_of_owners(before, before.owners(side))
    keep_numbers(shown, sorted(changed | edited.touched), numbers)
    copies = known_copies(folder, before.store.folder)
    summary = write_outputs(region, shown.owners(side), copies=copies)
    files = [*summary.files, *write_history(folder, out, MODELS, versions, date)]
    if edits or (folder / EDITS).exists():
        write_edits(out / EDITS, edits, store.system)
        files.append(out / EDITS)
    beside: list[str] = []
    if date is not None:
        changed_ids = {*versions.new, *versions.remodelled, *edited.modelled, *edited.removed}
        beside = walls_changed(folder, out, changed_ids)
        region.run = with_update(region.run, date, versions, len(beside))
    end_region(region, summary.complete)
    end_manifest(out, files, summary.complete, edits=len(edits), **stated_request(region.run))
    blocks = blocks_computed(region, before), len(region.shown)
    shutil.rmtree(before.store.folder, ignore_errors=True)
    return Updated(
        **vars(replace(summary, files=tuple(files))),
        date=date,
        points_changed=points_counted(region),
        blocks=blocks,
        versions=versions,
        edits=tuple(edits),
        corrected=edited,
        beside=tuple(beside),
    )


def with_update(run: Run, date: str, versions: Versions, beside: int) -> Run:
    """A run with the counts of its last update, of the points from its last generation on."""
    counts = {
        "date": date,
        "inputs": [run.index.path(number).name for number in range(run.generations[-1], len(run.index))],
        "new": len(versions.new),
        "remodelled": len(versions.remodelled),
        "gone": len(versions.gone),
        "beside": beside,
    }
    return replace(run, updates=(*run.updates, counts))


def check_inputs(folder: Path, earlier: Sequence[str], paths: Sequence[str], out: Path) -> list[str]:
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
        if path in earlier:
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
    days = [day for day in dates if day is not None and day.year > 1]
    if not days:
        raise InputError.about(
            paths[0], "states no date in its header", "give the scan's with --date 2026-05-31"
        )
    return str(max(days).isoformat())


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
    fresh, earlier = [], []
    for block in store.blocks(run.side):
        numbers = [scan for scan, _ in store.scan_files(block)]
        fresh += [block] * (max(numbers) >= first)
        earlier += [block] * (min(numbers) < first)
    if not fresh:
        region.store.discard()
        raise InputError.about(
            path, "has no point that the run would use", "check its coordinates and --bounds"
        )
    places = np.array([(block.column, block.row) for block in earlier])
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


def places_superseded(store: Store, side: float) -> Points:
    """Places (N, 2; world metres) of the points that those of the last scan took the place of: copies of
    earlier ones took none, and what went in an earlier update says nothing of this one."""
    places = [np.zeros((0, 2))]
    for block in store.units(SUPERSEDED, side):
        ids = store.array(SUPERSEDED, block, "gone")
        for _, path in store.scan_files(block) if len(ids) else ():
            records = np.fromfile(path, store.record)
            gone = records["xyz"][np.isin(records["point_id"], ids), :2]
            places.append(gone * GRID_STEP + np.array(block.origin))
    return np.concatenate(places)


def blocks_computed(region: Region, before: SavedBuildings) -> int:
    """Number of blocks whose results differ from those before."""
    before_keys = set(before.store.found(REGIONS, region.shown))
    return sum(entry not in before_keys for entry in region.store.found(REGIONS, region.shown))


def walls_changed(folder: Path, out: Path, changed_ids: set[str]) -> list[str]:
    """The buildings, but for some others, whose lines changed: they share other walls."""
    before, after = lines_of(folder / MODELS), lines_of(out / MODELS)
    return sorted(
        name for name in after if name in before and name not in changed_ids and before[name] != after[name]
    )
