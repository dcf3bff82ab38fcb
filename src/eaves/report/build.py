"""The whole flow with the report: tiles in, results and the page that people open first out."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any, Literal, Unpack
from weakref import finalize

from eaves.flow.formats import noted_failure
from eaves.flow.results import Results
from eaves.flow.run import Progress, Run, no_progress, open_run
from eaves.formats.in_memory import as_point_files, as_polygon_file
from eaves.pipeline import build_run, end_run, hold_folder, no_correction
from eaves.recipe.recipe import Recipe
from eaves.report.contents import BUILDINGS_SHOWN, POINTS_SHOWN, read_contents
from eaves.report.page_file import write_page
from eaves.report.progress import bars
from eaves.report.sample import PointSample
from eaves.run.clock import Clock
from eaves.run.options import EVERYTHING, POLYGONS, RunOptions, list_options

if TYPE_CHECKING:
    from eaves.upkeep.corrected import CarriedEdits


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
    with ExitStack() as files:
        show: Progress = files.enter_context(bars()) if progress is True else progress
        keep = Path(out) if options.get("keep") else None
        inputs = files.enter_context(as_point_files(inputs, options.get("crs"), keep))
        for name in POLYGONS:
            options[name] = files.enter_context(as_polygon_file(options.get(name), name, keep))
        return build_files(inputs, out, recipe, show, options).checked(allow_failures)


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
    folder = mkdtemp(prefix="eaves-")
    options.setdefault("outputs", ("footprints", "models"))
    try:
        results = build(points, Path(folder) / "run", recipe, progress, allow_failures, **options)
    except BaseException:
        rmtree(folder, ignore_errors=True)
        raise
    finalize(results, rmtree, folder, ignore_errors=True)
    return results


def build_files(
    inputs: Any, out: str | Path, recipe: Recipe | None, progress: Progress, options: RunOptions
) -> Results:
    """The results of `build`, of files."""
    shown = "report" in (options.get("outputs") or EVERYTHING)
    run = open_run(inputs, out, recipe, progress, carries_edits=True, **options)
    sample = PointSample(POINTS_SHOWN, BUILDINGS_SHOWN) if shown else None
    with hold_folder(run) as workers:
        carried = carried_edits(run)
        correct = no_correction if carried is None else carried.correct
        summary = build_run(run, workers, progress, sample, correct)
        if shown and not run.by_tiles:
            clock, before = Clock(), time.perf_counter()
            failed: list[str] = []
            with noted_failure("report.html", failed, raised=()):
                page = write_page(read_contents(summary.folder, received=sample), summary.as_text())
                summary = replace(summary, files=(*summary.files, page))
            summary = replace(summary, failed=(*summary.failed, *failed))
            clock.lap("report")
            summary = summary.with_step("report", clock.laps["report"], time.perf_counter() - before)
        if carried is not None:
            summary = replace(summary, files=(*summary.files, carried.keep()))
        end_run(run, summary)
    return Results.of(summary)


def carried_edits(run: Run) -> CarriedEdits | None:
    """The edits that a run finds in its folder and carries on; None where it carries none."""
    if not run.carries_edits:
        return None
    from eaves.upkeep.corrected import CarriedEdits  # late: most runs have none

    return CarriedEdits.of(run)
