"""Refusals before the first point is read: what cannot meet, what is not there, what the disk cannot hold."""

from __future__ import annotations

import logging
import shutil
from typing import TYPE_CHECKING

import numpy as np
import shapely

from eaves.detect.given_classes import GivenClasses
from eaves.flow.exports import COPC
from eaves.footprints.read import box_text
from eaves.formats import InputError, open_source
from eaves.formats.points.source import check_fields
from eaves.run.code import is_of_package, package_sources
from eaves.run.memory import physical_memory, share_memory
from eaves.run.options import METHOD_OPTIONS
from eaves.run.partition import BOX_TOLERANCE, Window
from eaves.run.store import RECORD

if TYPE_CHECKING:
    from eaves.flow.run import Run
    from eaves.run.index import Index
    from eaves.run.options import RunOptions

log = logging.getLogger("eaves")

COPIED_POINTS = 200_000_000
"""Inputs of more points are decompressed a second time: copies of their records would fill the disk."""
COPIED_BYTES = 20
"""Of the shortest record of a LAS file."""
COPC_BYTES = 60
"""Of memory for a point of a COPC file that is written."""
ANYWAY = "or add --allow-empty"


def refuse_unknown_code(run: Run) -> None:
    """Check that other processes can import the run's methods, and that later runs can see them change.

    Raises
    ------
    InputError
        When several processes, or a run that is kept or resumed, need a method of an interactive session.
    """
    options = run.options
    for stage in METHOD_OPTIONS:
        method = getattr(run.recipe, stage)
        name = type(method).__module__
        if method is None or is_of_package(name):
            continue
        is_shared = options["scheduler"] is None and run.jobs > 1
        lasts = options["keep"] or options["resume"]
        if (is_shared or lasts) and package_sources().path(name) is None:
            raise InputError(
                f"{stage} method {type(method).__qualname__}: has no source file, by which other processes "
                "and later runs know it; put its class into a file, or leave jobs, keep and resume out"
            )


def refuse_no_fields(run: Run) -> None:
    """Check that every input has the fields of points that the methods need.

    Raises
    ------
    InputError
        When one lacks a field.
    """
    needs = run.recipe.needs
    for number in range(len(run.index)) if needs else ():
        check_fields(run.index.kept.get(number) or open_source(run.index.path(number), run.index.crs), needs)


def refuse_no_points(index: Index, window: Window, options: RunOptions) -> None:
    """Check that the headers put points into the bounds and the clip area.

    Raises
    ------
    InputError
        When none of them does.
    """
    boxes = index.entries["box"][index.entries["count"] > 0]
    if not len(boxes):
        raise InputError.about(index.path(0), "no input holds a point", f"give others, {ANYWAY}")
    extent = box_text(boxes, index.system)
    bounds = window.bounds
    if bounds is not None and not index.meeting(bounds.buffered(BOX_TOLERANCE)).any():
        asked = box_text(list(vars(bounds).values()), index.system)
        raise InputError(
            f"--bounds {asked}: no point lies there: the headers put them within {extent}; check the "
            f"numbers, {ANYWAY}"
        )
    grown = boxes + BOX_TOLERANCE * np.array([-1.0, -1.0, 1.0, 1.0])
    if window.clip is not None and not shapely.intersects(window.clip, shapely.box(*grown.T)).any():
        place = "is empty"
        if not window.clip.is_empty:
            place = f"lies within {box_text(window.clip.bounds, index.system)}"
        raise InputError.about(
            options["clip"] or "--clip",
            f"no point lies in its area, which {place}: the headers put them within {extent}",
            f"check its coordinate system, {ANYWAY}",
        )


def refuse_no_classes(run: Run) -> None:
    """Check that points have the classes that `use_classes` asks for; where not all of them were looked at, a
    warning has to do.

    Raises
    ------
    InputError
        When none has a class of the ground, or of buildings where these are to be found by it.
    """
    recipe, facts = run.recipe, run.facts
    there = ", ".join(facts.classes) or "none"
    asked = [("ground", recipe.ground_classes)]
    if isinstance(recipe.detect, GivenClasses) and run.given is None:
        asked.append(("building", recipe.detect.classes))
    for name, classes in asked:
        if facts.classes.keys().isdisjoint(map(str, classes)):
            numbers = " or ".join(map(str, classes))
            reason = InputError.about(
                run.index.path(0),
                f"--use-classes: no point has class {numbers} ({name}); the classes are {there}",
                f"leave out --use-classes, give --{name}-classes, {ANYWAY}",
            )
            if facts.whole:
                raise reason
            log.warning("of %s points looked at: %s", f"{facts.looked_at:,}", reason)


def refuse_full_disk(run: Run) -> None:
    """Check that the disk has room for the points alone.

    Raises
    ------
    InputError
        When it has not.
    """
    each = RECORD.itemsize + 8 * len(run.recipe.needs) + (COPIED_BYTES if copies_records(run) else 0)
    needed = each * run.index.points if run.window == Window() else 0
    place = next(
        folder for folder in (run.folder.absolute(), *run.folder.absolute().parents) if folder.is_dir()
    )
    reusable = sum(path.stat().st_size for path in run.work_folder.rglob("*") if path.is_file())
    free = shutil.disk_usage(place).free + reusable
    if needed > free:
        raise InputError.about(
            run.folder,
            f"its disk has {free / 1e6:,.1f} MB free, and {run.index.points:,} points take "
            f"{needed / 1e6:,.1f} MB while they are computed",
            "free some, choose a folder on another disk, or build by --per-tile",
        )


def refuse_small_memory(run: Run) -> None:
    """Check that the points of the largest file fit into memory where they are to be COPC.

    Raises
    ------
    InputError
        When they do not.
    """
    largest = int(run.index.entries["count"].argmax())
    count, memory = run.index.count(largest), run.memory or physical_memory()
    as_copc = COPC in run.options["formats"] and not run.by_tiles and run.window == Window()
    if as_copc and count * COPC_BYTES > memory:
        raise InputError.about(
            run.index.path(largest),
            f"its {count:,} points as COPC take {count * COPC_BYTES / 1e6:,.1f} MB of memory, and there are "
            f"{memory / 1e6:,.1f}",
            "cut it into tiles, or leave copc out of --formats",
        )


def warn_of_memory(run: Run) -> None:
    """Say when the processes are expected to need more memory than there is: by the mean density of the
    points, so that the run may do all the same."""
    jobs, _ = share_memory(run.memory, run.jobs)
    if jobs * run.facts.memory_mb * 1e6 > (run.memory or physical_memory()):
        log.warning(
            "memory: %d processes are expected to need %s MB each, more than %s; give fewer --jobs or more "
            "memory, or see it run out",
            jobs,
            f"{run.facts.memory_mb:,}",
            f"--memory {run.options['memory']}" if run.memory else "this computer has",
        )


def copies_records(run: Run) -> bool:
    """True if the inputs are kept decompressed for the classified points."""
    small = run.index.points <= COPIED_POINTS
    return "classified" in run.outputs and small and not (run.by_tiles or run.options["keep"])
