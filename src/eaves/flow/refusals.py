"""Refusals before the first point is read: what cannot meet, what is not there, what the disk cannot hold.

No file that a run writes is one that it reads, or holds a person's work or the results of other inputs.
"""

from __future__ import annotations

import hashlib
import logging
import os
import shutil
from collections.abc import Collection, Iterator, Mapping, Sequence
from datetime import datetime
from glob import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from eaves.blocks.seams import find_steps
from eaves.detect.given_classes import GivenClasses
from eaves.flow.formats import memory_of_points
from eaves.footprints.read import box_text
from eaves.formats import InputError
from eaves.formats.inputs import is_raster
from eaves.formats.points.source import check_fields
from eaves.run.index import Index
from eaves.run.keys import is_of_package, source_of
from eaves.run.manifest import (
    LISTED,
    changes_between,
    known_facts,
    known_files,
    names_of_paths,
    next_place,
    tables_of,
    work_of_persons,
)
from eaves.run.memory import physical_memory, share_memory
from eaves.run.options import METHOD_OPTIONS, RunOptions
from eaves.run.points import BOX_TOLERANCE, Window
from eaves.run.store import RECORD, WORK

if TYPE_CHECKING:
    from eaves.flow.region import Region
    from eaves.flow.run import Run
    from eaves.run.index import Index
    from eaves.run.options import RunOptions

log = logging.getLogger("eaves")

COPIED_POINTS = 200_000_000
"""Inputs of more points are decompressed a second time: copies of their records would fill the disk."""
COPIED_BYTES = 20
"""Of the shortest record of a LAS file."""
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
        if (is_shared or lasts) and source_of(name) is None:
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
        check_fields(run.index.source(number), needs)


def refuse_no_points(index: Index, window: Window, options: RunOptions) -> None:
    """Check that the headers put points into the bounds and the clip area, where a result without any is not
    allowed.

    Raises
    ------
    InputError
        When none of them does.
    """
    boxes = index.entries["box"][index.entries["count"] > 0]
    if options["allow_empty"]:
        return
    if not len(boxes):
        raise InputError.about(index.path(0), "no input holds a point", f"give others, {ANYWAY}")
    extent = box_text(boxes, index.system)
    bounds = window.bounds
    if bounds is not None and not index.meeting(bounds.buffered(BOX_TOLERANCE)).any():
        asked = box_text(list(bounds), index.system)
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
            str(options["clip"] or "--clip"),
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
    present = ", ".join(facts.classes) or "none"
    asked = [("ground", recipe.ground_classes)]
    if isinstance(recipe.detect, GivenClasses) and run.given is None:
        asked.append(("building", recipe.detect.classes))
    for name, classes in asked:
        if facts.classes.keys().isdisjoint(map(str, classes)):
            numbers = " or ".join(map(str, classes))
            reason = InputError.about(
                run.index.path(0),
                f"--use-classes: no point has class {numbers} ({name}); the classes are {present}",
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
    each = RECORD.itemsize + 8 * len(run.fields) + (COPIED_BYTES if copies_records(run) else 0)
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
    """Check that the points of the largest file fit into memory where formats of points need them there.

    Raises
    ------
    InputError
        When they do not.
    """
    largest = int(run.index.entries["count"].argmax())
    count, memory = run.index.count(largest), run.memory or physical_memory()
    name, size = memory_of_points(run.options["formats"])
    if count * size > memory and not run.by_tiles and run.window == Window():
        raise InputError.about(
            run.index.path(largest),
            f"its {count:,} points as {name} take {count * size / 1e6:,.1f} MB of memory, and there are "
            f"{memory / 1e6:,.1f}",
            f"cut it into tiles, or leave {name} out of --formats",
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


ELSEWHERE = "choose another folder with -o"
EDITS = "edits.gpkg"
"""Name of the file in a run's folder that keeps all edits; a user may change it, too."""
LAYER = "footprints.gpkg"
"""The file of a run whose layer of footprints takes edits."""


def refuse_collisions(
    folder: Path, classified: Path | None, inputs: Sequence[str | Path], polygons: Sequence[Path]
) -> None:
    """Check that no file that is read is one that is written, or would be read by the next run.

    Parameters
    ----------
    folder
        The output folder.
    classified
        The one file to be written, instead of a folder's.
    inputs, polygons
        The point files; the footprints, party walls and the area.

    Raises
    ------
    InputError
        With the first file that collides.
    """
    if classified is not None:
        for path in (*inputs, *polygons):
            if is_same_place(path, classified):
                raise InputError.about(
                    classified, "is an input and would be overwritten", "choose another -o"
                )
        return
    if not folder.is_dir():
        return
    folders = {os.path.dirname(os.path.abspath(path)): path for path in inputs}
    for place, path in folders.items():
        if is_same_place(place, folder):
            raise InputError.about(
                path,
                f"lies in the output folder {folder}: the next run would read this one's results",
                ELSEWHERE,
            )
    for path in inputs:  # a symbolic link, or another name of the same folder
        if os.path.islink(path) and is_same_place(os.path.dirname(os.path.realpath(path)), folder):
            raise InputError.about(path, f"leads into the output folder {folder}", ELSEWHERE)
    for path in polygons:
        if is_same_place(os.path.dirname(path), folder) and Path(path).stem == Path(LAYER).stem:
            raise InputError.about(path, "would be overwritten by the footprints of this run", ELSEWHERE)


def refuse_overwrite(
    folder: Path, plan: Mapping[str, Any], planned: Collection[str], carries_edits: bool = False
) -> None:
    """Check that a run that is planned so would write over no person's work in its output folder, but for
    edits where it carries them on, and over no results of inputs that it has not.

    Raises
    ------
    InputError
        When the folder holds edits, files that were changed since they were written, files of no run that
        bear the `planned` names of this one's, or a run of other inputs.
    """
    facts = known_facts(folder)
    same = {identity for entry in plan.get("inputs", ()) for identity in identities(entry)}
    for entry in facts.get("inputs", ()) if same else ():
        if same.isdisjoint(identities(entry)):
            keeps_results = "request" in facts and (folder / WORK).is_dir()
            scan = (
                f"add a later scan of its area by eaves update {folder} POINTS -o OTHER, "
                if keeps_results
                else ""
            )
            remedy = f"{scan}give another -o, or --overwrite"
            raise InputError.about(folder, f"holds a run of {Path(entry['path']).name}", remedy)
    work = list(edits_and_work(folder, planned))
    if carries_edits:
        work = [(path, reason) for path, reason in work if path != folder / EDITS]
    if work:
        path, reason = work[0]
        more = names_of_paths(folder, [path for path, _ in work[1:]])
        also = f" (and of {len(work) - 1} more: {more})" if more else ""
        remedy = f"give another -o, or --overwrite, which moves it to {next_place(folder).name} in the folder"
        if "request" in facts and {path.name for path, _ in work} & {EDITS, LAYER}:
            remedy = f"take its changes as edits by eaves update {folder}, {remedy}"
        raise InputError.about(path, f"{reason}{changes_told(path)}{also}", remedy)


def edits_and_work(folder: Path, planned: Collection[str]) -> Iterator[tuple[Path, str]]:
    """Files with a person's work that a build would overwrite, each with the reason."""
    if (edits := folder / EDITS).exists():
        day = datetime.fromtimestamp(edits.stat().st_mtime)
        yield edits, f"holds edits of {day.day} {day:%B %Y}"
    yield from (entry for entry in work_of_persons(folder, planned) if entry[0] != edits)


def changes_told(path: Path) -> str:
    """The tables, columns, rows and values of a GeoPackage that are not as a run wrote them, in brackets;
    empty of other files, and where nothing is known."""
    noted = known_files(path.parent).get(path.name, {}).get("tables")
    changes = list(changes_between(noted, tables_of(path))) if noted else []
    return f" ({', '.join(changes[:LISTED])})" if changes else ""


def identities(entry: Mapping[str, Any]) -> tuple[str, str]:
    """The path, and the name with the number of points, of an input that run.json lists: either tells that it
    is the same, changed or moved."""
    return os.path.realpath(entry["path"]), f"{entry['points']} points in {Path(entry['path']).name}"


def is_same_place(first: str | Path, second: str | Path) -> bool:
    """True if two paths are one file or folder, also where names differ by case or lead through links."""
    try:
        return os.path.samefile(first, second)
    except OSError:  # one of them is not there yet
        return os.path.normcase(os.path.realpath(first)) == os.path.normcase(os.path.realpath(second))


def has_rasters(inputs: str | Path | Sequence[str | Path], dtm: Path | None) -> bool:
    """True if any input is a raster.

    Raises
    ------
    InputError
        When none is, and there is a terrain for one.
    """
    rasters = any(map(is_raster, [inputs] if isinstance(inputs, str | Path) else inputs))
    if dtm is not None and not rasters:
        raise InputError(f"--dtm {dtm}: no input is a raster; give a DSM (.tif), or leave it out")
    return rasters


def refuse_changed(polygons: Mapping[str, Path], hashes: Mapping[str, str | None]) -> None:
    """Check that files of polygons have the hashes that they had.

    Raises
    ------
    InputError
        When one has another.
    """
    for name, path in polygons.items():
        if hash_of(path) != hashes[name]:
            raise InputError.about(path, "changed while the run was reading it", "run again")


def hash_of(path: str | Path | None) -> str | None:
    """SHA-256 of a file and of those beside it that belong to it: a shapefile is several; None for none."""
    if path is None or not Path(path).is_file():
        return None
    digest, path = hashlib.sha256(), Path(path)
    beside = [
        sidecar
        for sidecar in path.parent.glob(f"{escape(path.stem)}.*")
        if sidecar.suffix.lower() in SIDECARS
    ]
    beside += path.parent.glob(f"{escape(path.name)}-wal")
    for part in [path, *sorted(set(beside) - {path})]:
        with part.open("rb") as file:
            digest.update(hashlib.file_digest(file, "sha256").digest())
    return digest.hexdigest()


SIDECARS = (".shp", ".shx", ".dbf", ".prj", ".cpg")
"""Files whose contents are part of a shapefile's."""


def remark_on_copies(region: Region) -> None:
    """Say how many points are copies of others, and of which inputs the first ones are."""
    if not region.copies:
        return
    index, count = region.run.index, sum(copies[0] for copies in region.copies.values())
    ids = region.copies[min(region.copies)][1:]
    numbers = np.searchsorted(index.starts, ids, side="right") - 1
    files = " and ".join(dict.fromkeys(index.path(int(number)).name for number in numbers))
    region.remark(
        f"{count:,} of {region.points:,} points are identical to others (the first: in {files}) and count "
        "once: a file given twice, tiles with a buffer, or a strip copied"
    )


def remark_on_steps(region: Region) -> None:
    """Say which two inputs differ most in height where they meet, and by how much."""
    found = find_steps([region.heights[block] for block in sorted(region.heights)])
    if not found:
        return
    step, *numbers, places = found[0]
    low, high = (region.run.index.path(number).name for number in (numbers if step > 0 else numbers[::-1]))
    others = f"; {len(found) - 1} more pairs of files differ" if len(found) > 1 else ""
    facts = f"{abs(step):.2f} m higher than {low} where they meet (median of {places:,} places{others})"
    region.remark(
        f"{high} lies {facts}: a vertical step between files, as of two height systems; heights of "
        "the results follow each file"
    )


def warn_of_wrong_boxes(region: Region) -> None:
    """One warning for all files whose points lie outside the box their header states."""
    boxes = region.wrong_boxes
    if boxes:
        log.warning(
            "%d files have points outside the bounding box of their header (the first: %s); the points are "
            "used where they are",
            len(boxes),
            region.run.index.path(min(boxes)),
        )
