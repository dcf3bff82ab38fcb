"""No file that a run reads is one that it writes."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from eaves.flow.exports import FOOTPRINT_FILES
from eaves.formats import InputError

ELSEWHERE = "choose another folder with -o"


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
    written = ["footprints.gpkg", *(file for _, file in FOOTPRINT_FILES.values())]
    for path in polygons:
        if any(is_same_place(path, folder / name) for name in written):
            raise InputError.about(path, "would be overwritten by the footprints of this run", ELSEWHERE)


def is_same_place(one: str | Path, other: str | Path) -> bool:
    """Whether two paths are one file or folder, also where names differ by case or lead through links."""
    try:
        return os.path.samefile(one, other)
    except OSError:  # one of them is not there yet
        return os.path.normcase(os.path.realpath(one)) == os.path.normcase(os.path.realpath(other))
