"""The flow from files to files. Read this file first.

```
open_run ─→ partition ─→ blocks ─→ join ─→ buildings ─→ outputs
            points by    ground,    regions   outline,     files
            block        rasters,   across    roof planes,
                         regions    seams     solids
```

What a block is computed with is in `run/block.py`, what a building is computed with in `run/building.py`;
both call the stages (`ground`, `detect`, `outline`, `units`, `roof`, `reconstruct`, `validate`).
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from eaves.formats.atomic import report_full_disk
from eaves.model.summary import Summary
from eaves.run.clock import Clock
from eaves.run.lock import lock_folder
from eaves.run.manifest import end_manifest
from eaves.run.options import RunOptions, list_options
from eaves.run.outputs import write_outputs
from eaves.run.recipe import Recipe
from eaves.run.region import Core, Region, import_methods, warn_of_wrong_boxes
from eaves.run.run import Progress, Run, no_progress, open_run, request_of
from eaves.run.workers import Workers

if TYPE_CHECKING:
    from eaves.run.classified_points import PointSink

log = logging.getLogger("eaves")


@list_options
def build(
    inputs: str | Path | Sequence[str | Path],
    out: str | Path,
    recipe: Recipe | None = None,
    progress: Progress = no_progress,
    sink: PointSink | None = None,
    report: Callable[[Summary], Path] | None = None,
    **options: Unpack[RunOptions],
) -> Summary:
    """Footprints, models, rasters and classified points of all inputs, written to the folder `out`.

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
    sink
        Receives the classified points as they are written; not in a run by tiles.
    report
        Writes one more file from the results; not in a run by tiles, which is more than a page holds.
    options
        The keywords of `eaves.build`.

    Raises
    ------
    InputError
        When an input cannot be used, or another run holds the folder; nothing is written then.
    DiskFullError
        When the disk is full; what is done stays for a run with `resume`.
    """
    run = open_run(inputs, out, recipe, progress, **options)
    with (
        lock_folder(run.folder, run.lock),
        report_full_disk(run.folder),
        Workers(run.jobs, run.options["scheduler"], run.memory) as workers,
    ):
        if run.by_tiles:
            from eaves.run.tiles import build_tiles  # late: most runs have no tiles

            summary = build_tiles(run, workers, progress, build_region)
        else:
            summary = build_whole(run, workers, progress, sink)
            if report is not None:
                clock, before = Clock(), time.perf_counter()
                summary = replace(summary, files=(*summary.files, report(summary)))
                clock.lap("report")
                summary = summary.with_step("report", clock.laps["report"], time.perf_counter() - before)
        if run.classified is None:
            end_manifest(run.folder, summary.files, summary.about, summary.complete)
        return summary


def build_whole(run: Run, workers: Workers, progress: Progress, sink: PointSink | None) -> Summary:
    """The whole run as one region."""
    if run.memory is not None or run.index.spans_blocks(run.side, run.window.bounds):
        workers.start(partial(import_methods, run.recipe))
    region = Region(run, run.work_folder, workers, progress)
    summary = build_region(region, Core(holds=lambda block: True), sink)
    warn_of_wrong_boxes(run.index, region.wrong_boxes)
    return summary


def build_region(region: Region, core: Core, sink: PointSink | None = None) -> Summary:
    """The buildings, rasters and points of the core's blocks; the working folder goes when nothing failed.

    Raises
    ------
    TooNarrowError
        When the bounds loaded do not hold the core's buildings.
    """
    region.open_store()
    region.partition()
    region.budget.step("read")
    blocks = region.used_blocks()
    if core.loaded is None:
        region.check_points()
    region.check_rasters(blocks)
    if not any(map(core.holds, blocks)):
        log.warning("no points left to use: see the bounds, the clip area and the files")
    plans = region.join(blocks, core)  # computes the blocks on the way
    plans = [plan for plan in plans if core.holds(plan.owner_block)]
    region.budget.step("blocks")
    region.model(plans)
    region.budget.step("buildings")
    summary = write_outputs(region, [block for block in blocks if core.holds(block)], plans, sink)
    if region.run.options["keep"]:
        owners = [plan.owner_block for plan in plans]
        region.store.keep_request(request_of(region.run), blocks, owners)
    elif summary.complete:
        region.store.discard()
    else:
        region.store.drop_records()
    return summary
