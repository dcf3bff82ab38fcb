"""The flow from files to files. Read this file first.

```
open_run ─→ read ─→ replace ─→ wide ─→ ground ─→ regions ─→ join ─→ buildings ─→ outputs ─→ report
            points   by later   what is  blocks    blocks     across   outline,     files      page and
            by block scans'     wide     with      rasters,   seams    roof planes,            pictures
                                         buffer    regions             solids
```

Each step is a function of `flow/region.py` on one region. Those whose results are kept are declared in
`flow/steps.py`: what is found by its key in the region's store is not computed (`flow/step.py`).
"""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from eaves.buildings.building_file import SavedBuildings
from eaves.flow.outputs import finished_models, write_outputs
from eaves.flow.refusals import edits_and_work
from eaves.flow.region import (
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
from eaves.flow.results import ModelledBuildings
from eaves.flow.run import Progress, Run, look_at_scan, no_progress, open_run
from eaves.flow.step import Region
from eaves.flow.tiles import WHOLE, Area, areas, finish_area
from eaves.formats.whole_files import clear_leftovers, report_full_disk
from eaves.model import Block
from eaves.model.summary import IncompleteRunError, Summary
from eaves.recipe.recipe import Recipe
from eaves.run.keys import BUILDINGS
from eaves.run.lock import lock_folder
from eaves.run.manifest import end_manifest, set_aside
from eaves.run.options import RunOptions, list_options
from eaves.run.workers import Workers

if TYPE_CHECKING:
    from eaves.buildings.join import OwnedBuildings
    from eaves.flow.classified_points import PointSink

log = logging.getLogger("eaves")

Correction = Callable[[Region, list[Block]], list[Block]]
"""Changes the buildings of a region, which blocks own; returns the blocks that own buildings then."""


def no_correction(region: Region, owners: list[Block]) -> list[Block]:
    """The `Correction` that changes nothing."""
    return owners


@list_options
def build(
    inputs: str | Path | Sequence[str | Path],
    out: str | Path,
    recipe: Recipe | None = None,
    progress: Progress = no_progress,
    sink: PointSink | None = None,
    allow_failures: bool = False,
    **options: Unpack[RunOptions],
) -> Summary:
    """Footprints, models, rasters and classified points of all inputs, written to the folder `out`.

    Parameters
    ----------
    inputs
        LAS, LAZ, COPC or text files, PLY, E57, folders, globs, addresses or `.vpc` lists.
    out
        Folder; made when missing.
    recipe
        The methods, instead of the options that name them.
    progress
        Called with the step, how much of it is done, and how much there is.
    sink
        Receives the classified points as they are written; not in a run by tiles.
    allow_failures
        Return what there is when a part could not be computed.
    options
        The keywords of `eaves.build`.

    Raises
    ------
    InputError
        When an input cannot be used, or another run holds the folder; nothing is written then.
    DiskFullError
        When the disk is full; what is done stays for a run with `resume`.
    IncompleteRunError
        When a part could not be computed, after all the others; see `allow_failures`.
    """
    run = open_run(inputs, out, recipe, progress, **options)
    with hold_folder(run) as workers:
        summary = build_run(run, workers, progress, sink)
        end_run(run, summary)
    return summary.checked(allow_failures)


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
            models = list(finished_models(SavedBuildings(region.store), compute_buildings(region)))
        buildings = ModelledBuildings(models, region.store.system, run.provenance)
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
    region.store.evict_others(BUILDINGS, region.owners)
    return region.owners


def find_plans(region: Region, area: Area = WHOLE) -> list[OwnedBuildings]:
    """Every step from the files to the buildings of an area before they are modelled."""
    todo, done = blocks_of(region, area), list[Block]()
    while todo:
        find_regions(region, todo)
        done += todo
        todo = blocks_ahead(region, area, done)
    return join_buildings(region, area, done)
