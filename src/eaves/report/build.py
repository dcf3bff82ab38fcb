"""The whole flow with the report: tiles in, results and the page that people open first out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Unpack

from eaves.pipeline import build as build_files
from eaves.report.contents import BUILDINGS_SHOWN, POINTS_SHOWN, import_libraries
from eaves.report.notebook import Results
from eaves.report.page_file import write_report
from eaves.report.sample import PointSample
from eaves.run.recipe import Recipe
from eaves.run.run import Progress, RunOptions, no_progress


def build(
    inputs: str | Path | Sequence[str | Path],
    out: str | Path,
    recipe: Recipe | None = None,
    progress: Progress = no_progress,
    **options: Unpack[RunOptions],
) -> Results:
    """Footprints, models, rasters, classified points and report.html, in the folder `out`.

    Parameters
    ----------
    inputs
        LAS, LAZ, COPC or text files, folders or globs.
    out
        Folder; made when missing.
    recipe
        The methods, instead of the options that name them.
    progress
        Called with the step, how much of it is done, and how much there is.
    options
        The keywords of `eaves.run.run.RunOptions`: `ground`, `detect`, `outline`, `roof`, `reconstruct` (a
        method, its name, or a table of its parameters), `use_classes`, `as_published`, `lod`, `crs`,
        `bounds`, `clip`, `footprints`, `id_field`, `snap_footprints`, `party_walls`, `formats`, `outputs`,
        `block` (m),
        `jobs`, `scheduler`, `resume`, `per_tile`, `classified`.

    Returns
    -------
    Results
        What was found and written; in a notebook it shows itself. A run by tiles has no report: it is more
        than a page holds.

    Raises
    ------
    InputError
        When an input cannot be used; nothing is written then.
    TypeError, ValueError
        When an option, a method or a value does not exist.
    DiskFullError
        When the disk is full; what is done stays for a run with `resume`.

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
    sample = PointSample(POINTS_SHOWN, BUILDINGS_SHOWN)
    several = options.get("jobs", 1) > 1 or options.get("scheduler") is not None

    def show(step: str, done: int, total: int) -> None:
        progress(step, done, total)
        if several and step == "buildings" and done == 1:  # the others compute meanwhile
            import_libraries()

    results = Results.of(build_files(inputs, out, recipe, show, sample, **options))
    if "tiles" in results.run:
        return results
    return replace(results, files=(*results.files, write_report(results, sample)))
