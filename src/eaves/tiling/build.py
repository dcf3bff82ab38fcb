"""From files to files: index, scatter, block pass, join, building pass, outputs."""

from __future__ import annotations

import hashlib
import logging
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from eaves.formats import InputError, Source, common_system, find_inputs, open_source
from eaves.model import Block, Bounds, Failure, Footprint
from eaves.pipeline import (
    BuildingPoints,
    BuildingResult,
    Clock,
    Recipe,
    block_pass,
    building_pass,
    draw_footprints,
    make_recipe,
)
from eaves.tiling.exports import check_formats
from eaves.tiling.gather import Gatherer
from eaves.tiling.join import HomePlan, Seam, assign_footprints, join_regions
from eaves.tiling.outputs import EVERYTHING, Summary, write_outputs
from eaves.tiling.runners import Outcome, peak_memory_mb, run
from eaves.tiling.scatter import scatter_points
from eaves.tiling.store import Store
from eaves.tiling.vectors import area_of, in_metres, read_area, read_footprints

log = logging.getLogger("eaves")
WORK_FOLDER = ".eaves-work"
"""Folder inside the output folder for parts; it goes when the run is complete."""

Tell = Callable[[str, int, int], None]
"""Hears progress: stage, done, total."""


@dataclass(frozen=True)
class Options:
    """What a run is asked for besides its inputs and methods."""

    crs: str | None = None
    bounds: Bounds | None = None
    """In the units of the files' reference system; turned to metres at the door."""
    clip: Path | None = None
    footprints: Path | None = None
    id_field: str | None = None
    snap_footprints: bool = False
    formats: tuple[str, ...] = ()
    """Names of further formats (tiling.exports)."""
    jobs: int = 1
    scheduler: str | None = None
    resume: bool = False
    block: float = 240.0
    outputs: tuple[str, ...] = ()
    """Names of the outputs to write (tiling.outputs.EVERYTHING); all for none."""
    classified: Path | None = None
    """Where the classified points of the one input go, without extra dimensions and without a run.json."""


def build(
    inputs: str | Path | Sequence[str | Path],
    out: str | Path,
    recipe: Recipe | None = None,
    options: Options | None = None,
    tell: Tell = lambda stage, done, total: None,
) -> Summary:
    """Footprints, models, rasters and classified points of all inputs, written to the folder `out`.

    Parameters
    ----------
    inputs
        LAS, LAZ, COPC or text files, folders or globs.
    out
        Folder; made when missing.
    recipe
        The methods; `make_recipe()` for none.
    options
        The rest; see `Options`.
    tell
        Hears progress.

    Raises
    ------
    InputError
        When an input cannot be used; nothing is written then.
    """
    started = time.time()
    recipe, options = recipe or make_recipe(), options or Options()
    check_formats(options.formats)
    folder = Path(out)
    paths = find_inputs([inputs] if isinstance(inputs, str | Path) else inputs)
    failed: list[str] = []
    sources = open_all(paths, options.crs, failed)
    system = common_system(sources)
    bounds = in_metres(options.bounds, system)
    clip = None if options.clip is None else read_area(options.clip, system)
    given = None
    if options.footprints is not None:
        area = area_of([source.bounds for source in sources], bounds, clip)
        given = read_footprints(options.footprints, options.id_field, system, area)
    if options.classified is not None and len(sources) > 1:
        raise InputError(
            f"{options.classified}: one file cannot hold {len(sources)} inputs; give a folder with -o"
        )
    claim(folder)

    plan = describe(sources, recipe, options)
    store = Store(
        folder / (WORK_FOLDER if options.classified is None else f"{WORK_FOLDER}-{options.classified.stem}"),
        has_returns=any("return_number" in source.fields for source in sources),
        has_classes=any("classification" in source.fields for source in sources),
        system=system,
    )
    if not (options.resume and store.matches(plan)):
        store.discard()
        store.prepare()
        total, read = sum(source.count for source in sources), 0

        def read_more(points: int) -> None:
            nonlocal read
            read += points
            tell("read", read, total)

        unread = scatter_points(sources, store, options.block, bounds, clip, read_more)
        if len(unread) == len(sources):
            raise InputError(unread[0])
        failed += unread
        if not unread:
            store.keep_plan(plan)

    blocks = store.blocks(options.block)
    if not blocks:
        log.warning("no points left to use: see the bounds, the clip area and the files")
    work = partial(compute_block, store=store, recipe=recipe)
    peak = peak_memory_mb()
    left = [block for block in blocks if not store.has("blocks", block)]
    if left:  # what was joined without them no longer holds
        store.forget("buildings")
    for done, outcome in enumerate(run(work, left, options.jobs, options.scheduler), 1):
        peak = max(peak, outcome.peak_mb)
        note_failure(outcome, left, "block", failed)
        tell("blocks", done, len(left))
    seams = [Seam.of(store.load_block(block)) for block in blocks if store.has("blocks", block)]

    homes = assign_footprints(given, blocks) if given is not None and blocks else join_regions(seams)
    todo = [home for home in homes if not store.has("buildings", home.home)]
    work_home = partial(compute_home, store=store, recipe=recipe, snap=options.snap_footprints)
    for done, outcome in enumerate(run(work_home, todo, options.jobs, options.scheduler), 1):
        peak = max(peak, outcome.peak_mb)
        note_failure(outcome, [home.home for home in todo], "buildings of block", failed)
        tell("buildings", done, len(todo))

    summary = write_outputs(
        store,
        sources,
        blocks,
        [home.home for home in homes],
        folder,
        run={**plan, "crs": system.code, "peak_memory_mb": round(peak)},
        failed=failed,
        wanted=options.outputs or EVERYTHING,
        formats=options.formats,
        classified=options.classified,
        started=started,
        tell=tell,
    )
    if summary.complete:
        store.discard()
    return summary


def open_all(paths: Sequence[Path], crs: str | None, failed: list[str]) -> list[Source]:
    """The sources that can be opened; the others are noted in `failed`. InputError when there is none."""
    sources = []
    for path in paths:
        try:
            sources.append(open_source(path, crs))
        except InputError as error:
            if len(paths) == 1:
                raise
            failed.append(str(error))
            log.error("%s", error)
    if not sources:
        raise InputError(failed[0])
    return sources


def compute_block(block: Block, store: Store, recipe: Recipe) -> None:
    """The block pass for one block, kept in the store."""
    store.save("blocks", block, block_pass(store.load_cloud(block, recipe.reach), block, recipe))


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
    store.save("buildings", plan.home, results)


def draw_all(buildings: list[BuildingPoints], recipe: Recipe) -> list[Footprint | Failure]:
    """The footprints of a block's buildings together; one by one where one of them breaks the others."""
    try:
        return draw_footprints(buildings, recipe)
    except Exception as error:
        if len(buildings) == 1:
            log.debug("traceback", exc_info=True)
            return [Failure("internal_error", f"{type(error).__name__}: {error}", "outline")]
        return [draw_all([building], recipe)[0] for building in buildings]


def note_failure(outcome: Outcome, blocks: Sequence[Block], what: str, failed: list[str]) -> None:
    """Log an outcome's error, and remember it for the report."""
    if outcome.error:
        failed.append(f"{what} {blocks[outcome.index].name}: {outcome.error}")
        log.error("%s", failed[-1])


def claim(folder: Path) -> None:
    """Make the output folder and see that it can be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".eaves-probe"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise InputError(
            f"{folder}: the output folder cannot be written ({error.strerror}); choose another with -o"
        ) from None


def describe(sources: Sequence[Source], recipe: Recipe, options: Options) -> dict[str, Any]:
    """What decides the result, as JSON: inputs with their hashes, methods with parameters, block, version."""
    stages = ("ground", "detect", "outline", "roof", "reconstruct")
    chosen = {stage: getattr(recipe, stage) for stage in stages}
    methods = {
        stage: method and {"method": method.name, **method.model_dump(mode="json")}
        for stage, method in chosen.items()
    }
    return {
        "version": version("eaves"),
        "inputs": [
            {"path": os.fspath(source.path), "points": source.count, "sha256": fingerprint(source.path)}
            for source in sources
        ],
        "methods": methods,
        "use_classes": recipe.use_classes,
        "lod": recipe.lod,
        "block": options.block,
        "reach": recipe.reach,
        "bounds": None if options.bounds is None else list(vars(options.bounds).values()),
        "clip": None if options.clip is None else fingerprint(options.clip),
        "footprints": None if options.footprints is None else fingerprint(options.footprints),
        "snap_footprints": options.snap_footprints,
    }


def fingerprint(path: Path) -> str:
    """SHA-256 of a file."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
