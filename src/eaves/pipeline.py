"""The flow from files to files. Read this file first.

```
open_run ─→ points ─→ superseded, ─→ floors, ─→ ground ─→ regions ─→ join ─→ buildings ─→ outputs ─→ report
            by block  thinned,       large,     blocks    blocks     across   outline,     files      page and
                      sharpened:     decks      with      rasters,   seams    roof planes,            pictures
                      which count               buffer    regions             solids
```

Each step is a function of `flow/region.py` on one region. Those whose results are kept are declared in the
table of `flow/step.py`: what is found by its key in the region's store is not computed.
"""

from __future__ import annotations

import logging
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from shutil import rmtree
from typing import TYPE_CHECKING, Any, Literal, Unpack
from weakref import finalize

from eaves.flow.formats import noted_failure
from eaves.flow.outputs import LateOutput, finished_models, page_of, write_outputs
from eaves.flow.progress import bars
from eaves.flow.refusals import edits_and_work
from eaves.flow.region import (
    Region,
    blocks_ahead,
    blocks_of,
    check_blocks,
    drop_upkeep,
    end_region,
    find_regions,
    import_methods,
    join_buildings,
    model_plans,
    open_region,
)
from eaves.flow.results import ModelledBuildings, Results
from eaves.flow.run import Progress, Run, look_at_scan, no_progress, open_run
from eaves.flow.tiles import WHOLE, Area, areas, finish_area
from eaves.formats.in_memory import as_point_files, as_polygon_file
from eaves.formats.whole_files import clear_leftovers, report_full_disk
from eaves.model import Block
from eaves.model.summary import IncompleteRunError, Summary
from eaves.recipe.recipe import Recipe
from eaves.run.manifest import end_manifest, lock_folder, set_aside
from eaves.run.memory import Clock
from eaves.run.options import POLYGONS, RunOptions, list_options
from eaves.run.workers import Workers

if TYPE_CHECKING:
    from eaves.buildings.gather import OwnedBuildings
    from eaves.flow.classified import PointSink
    from eaves.flow.corrected import CarriedEdits

log = logging.getLogger("eaves")

Correction = Callable[[Region, list[Block]], list[Block]]
"""Changes the buildings of a region, which blocks own; returns the blocks that own buildings then."""


def no_correction(region: Region, owners: list[Block]) -> list[Block]:
    """The `Correction` that changes nothing."""
    return owners


@list_options
def build(
    inputs: str | Path | Sequence[str | Path] | Any,
    out: str | Path,
    recipe: Recipe | None = None,
    progress: Progress | Literal[True] = no_progress,
    allow_failures: bool = False,
    **options: Unpack[RunOptions],
) -> Results:
    """Footprints, models, rasters, classified points and report.html, in the folder `out`.

    Parameters
    ----------
    inputs : str, Path or sequence of them, laspy.LasData, PointCloud, or array (N, 3)
        LAS, LAZ, COPC or text files, folders or globs; or points in memory, an array in the units of `crs`.
    out : str or Path
        Folder; made when missing.
    recipe : Recipe or None
        The methods, instead of the options that name them.
    progress : callable or True
        Called with the step, how much of it is done, and how much there is; True shows bars.
    allow_failures : bool
        Return what there is when a part could not be computed.
    {options}

    Returns
    -------
    Results
        What was found and written; a notebook shows it as HTML. A run by tiles has no report.

    Raises
    ------
    InputError
        When an input cannot be used; nothing is written then.
    TypeError, ValueError
        When an option, a method or a value does not exist.
    DiskFullError
        When the disk is full; what is done stays for a run with `resume`.
    IncompleteRunError
        When a part could not be computed, after all the others; it carries the results.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> from eaves.simulate import write_simulation
    >>> files = write_simulation(truth, "nine")
    >>> results = eaves.build(files["points"], "out", jobs=1)
    >>> results.found == results.modelled + sum(results.failures.values())
    True
    >>> (results.folder / "report.html").exists()
    True
    """
    with ExitStack() as opened:
        show: Progress = opened.enter_context(bars()) if progress is True else progress
        keep = Path(out) if options.get("keep") else None
        inputs = opened.enter_context(as_point_files(inputs, options.get("crs"), keep))
        for name in POLYGONS:
            options[name] = opened.enter_context(as_polygon_file(options.get(name), name, keep))
        run = open_run(inputs, out, recipe, show, **options)
        page, edits = page_of(run), carried_edits(run)
        with hold_folder(run) as workers:
            sink = None if page is None else page.sink
            summary = build_run(run, workers, show, sink, no_correction if edits is None else edits.correct)
            if page is not None:
                summary = with_page(page, summary)
            if edits is not None:
                summary = replace(summary, files=(*summary.files, edits.keep()))
            end_run(run, summary)
    return Results.of(summary).checked(allow_failures)


def find_buildings(
    points: str | Path | Sequence[str | Path] | Any,
    recipe: Recipe | None = None,
    progress: Progress | Literal[True] = no_progress,
    allow_failures: bool = False,
    **options: Unpack[RunOptions],
) -> Results:
    """The buildings in points: `footprints` and `planes` as tables, `models` as meshes. Leaves no files.

    Parameters
    ----------
    points : str, Path or sequence of them, laspy.LasData, PointCloud, or array (N, 3)
        Files or folders; or points in memory, an array in the units of `crs`.
    recipe : Recipe or None
        The methods, instead of the options that name them.
    progress : callable or True
        Called with the step, how much of it is done, and how much there is; True shows bars.
    allow_failures : bool
        Return what there is when a part could not be computed.
    **options : keywords of a run
        Those of `eaves.build`, whose help explains each: `crs`, `bounds`, `footprints`, `lod`, a method by
        its stage (`detect="consensus"`), …

    Returns
    -------
    Results
        The buildings that `eaves build` finds, from a folder that is removed with this value.

    Raises
    ------
    InputError
        When an input cannot be used.
    TypeError, ValueError
        When an option, a method or a value does not exist.
    IncompleteRunError
        When a part could not be computed, after all the others; it carries the results.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> found = eaves.find_buildings(nine_roofs_on_a_slope(density=4.0).cloud)
    >>> len(found), len(found.footprints), len(found.models)
    (9, 9, 9)
    """
    folder = tempfile.mkdtemp(prefix="eaves-")
    options.setdefault("outputs", ("footprints", "models"))
    try:
        results = build(points, Path(folder) / "run", recipe, progress, allow_failures, **options)
    except BaseException:
        rmtree(folder, ignore_errors=True)
        raise
    finalize(results, rmtree, folder, ignore_errors=True)
    return results


@list_options
def model_buildings(
    inputs: str | Path | Sequence[str | Path], recipe: Recipe | None = None, **options: Unpack[RunOptions]
) -> ModelledBuildings:
    """The buildings that `build` writes, by all its steps from the points to the models, without files.

    Parameters
    ----------
    inputs : str, Path or sequence of them
        LAS, LAZ, COPC or text files, PLY, E57, folders, globs, addresses or `.vpc` lists.
    recipe : Recipe or None
        The methods, instead of the options that name them.
    {options}

    Returns
    -------
    ModelledBuildings
        The models and failures in the order of `buildings.city.jsonl`, with what `write_cityjson_seq` takes.

    Raises
    ------
    InputError
        When an input cannot be used.
    TypeError, ValueError
        When an option, a method or a value does not exist.
    IncompleteRunError
        When a part could not be computed.

    Examples
    --------
    >>> import eaves
    >>> from eaves.formats import write_cityjson_seq
    >>> models, system, source = eaves.model_buildings("tile.laz")        # doctest: +SKIP
    >>> write_cityjson_seq("a.city.jsonl", models, system, provenance=source)  # doctest: +SKIP
    153
    """
    with tempfile.TemporaryDirectory() as folder:
        options["outputs"] = ("models",)
        run = open_run(inputs, Path(folder) / "out", recipe, **options)
        with hold_folder(run) as workers:
            region = open_region(run, workers, no_progress)
            models = list(finished_models(region.buildings, compute_buildings(region)))
        buildings = ModelledBuildings(models, region.system, run.provenance)
        if region.failed:
            raise IncompleteRunError(region.failed, buildings)
        return buildings


@contextmanager
def hold_folder(run: Run) -> Iterator[Workers]:
    """The workers of a run that has its output folder for itself until the block ends."""
    with (
        lock_folder(run.folder, run.lock),
        report_full_disk(run.folder),
        Workers(run.jobs, run.options["scheduler"], run.memory) as workers,
    ):
        yield workers


def build_run(
    run: Run,
    workers: Workers,
    progress: Progress = no_progress,
    sink: PointSink | None = None,
    correct: Correction = no_correction,
) -> Summary:
    """All files of a run but for the report, its buildings corrected."""
    if run.memory is not None or run.index.spans_blocks(run.side, run.window.bounds):
        workers.start(partial(import_methods, run.recipe))
    if run.options["overwrite"] and run.classified is None:
        set_aside(run.folder, [path for path, _ in edits_and_work(run.folder, run.planned)])
    run = look_at_scan(run)  # while they start
    if run.by_tiles and "classified" in run.options["outputs"]:
        log.warning("classified points are not written tile by tile; run eaves build --bounds for a part")
    region = open_region(run, workers, progress)
    return build_region(region, sink, correct)


def with_page(page: LateOutput, summary: Summary) -> Summary:
    """Write the page of a run, unless that fails; the summary with its file, or with the reason, and its
    time."""
    clock, before = Clock(), time.perf_counter()
    failed: list[str] = []
    with noted_failure("report.html", failed, raised=()):
        summary = replace(summary, files=(*summary.files, page.write(summary)))
    summary = replace(summary, failed=(*summary.failed, *failed))
    clock.lap("report")
    return summary.with_step("report", clock.laps["report"], time.perf_counter() - before)


def carried_edits(run: Run) -> CarriedEdits | None:
    """The edits that a run finds in its folder and carries on; None where it carries none."""
    if not run.carries_edits:
        return None
    from eaves.flow.corrected import CarriedEdits  # late: most runs have none

    return CarriedEdits.of(run)


def end_run(run: Run, summary: Summary) -> None:
    """Say that all files of the run are there; a run that writes one file alone leaves no list of them."""
    if run.classified is None:
        end_manifest(run.folder, summary.files, summary.complete, incomplete=list(summary.failed))
    else:
        clear_leftovers(summary.files)


def build_region(
    region: Region, sink: PointSink | None = None, correct: Correction = no_correction
) -> Summary:
    """All files of a region; its results go when nothing failed."""
    drop_upkeep(region)
    owners = correct(region, compute_buildings(region))
    summary = write_outputs(region, owners, sink)
    end_region(region, summary.complete)
    return summary


def compute_buildings(region: Region) -> list[Block]:
    """Every step from the files to the buildings, all at once or tile by tile; the blocks that own them."""
    for area in areas(region):
        plans = find_plans(region, area)
        model_plans(region, plans)
        finish_area(region, area, plans)
    check_blocks(region)
    return region.owners


def find_plans(region: Region, area: Area = WHOLE) -> list[OwnedBuildings]:
    """Every step from the files to the buildings of an area before they are modelled."""
    todo, done = blocks_of(region, area), list[Block]()
    while todo:
        find_regions(region, todo)
        done += todo
        todo = blocks_ahead(region, area, done)
    return join_buildings(region, area, done)
