"""No file that a run writes is one that it reads, or holds a person's work or the results of other inputs."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from eaves.flow.exports import FOOTPRINT_FILES
from eaves.formats import InputError
from eaves.run.manifest import known_facts, known_files
from eaves.run.set_aside import LISTED, names_of_paths, next_place, work_of_persons
from eaves.run.store import WORK
from eaves.run.tables import changes_between, tables_of

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
    written = [LAYER, *(file for _, file in FOOTPRINT_FILES.values())]
    for path in polygons:
        if any(is_same_place(path, folder / name) for name in written):
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
            kept = "request" in facts and (folder / WORK).is_dir()
            scan = f"add a later scan of its area by eaves update {folder} POINTS -o OTHER, " if kept else ""
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
    """What of a person a build would write over, each with the reason."""
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


def is_same_place(one: str | Path, other: str | Path) -> bool:
    """True if two paths are one file or folder, also where names differ by case or lead through links."""
    try:
        return os.path.samefile(one, other)
    except OSError:  # one of them is not there yet
        return os.path.normcase(os.path.realpath(one)) == os.path.normcase(os.path.realpath(other))
