"""The formats written on request, by the names of `--formats`, and the names of all files of a run.

The table is of those that come with the core; installed packages bring others by entry points of the group
`eaves.formats`, each with its name. A format is fetched when it is asked for: most runs want none of them.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache, partial
from itertools import chain
from pathlib import Path
from typing import Any

from eaves import extensions
from eaves.extensions import imported, installed
from eaves.formats import InputError
from eaves.formats.columns import LAYERS
from eaves.formats.format import Format
from eaves.formats.vectors.geopackage import Row
from eaves.formats.whole_files import is_full
from eaves.model import CoordinateSystem, Provenance

log = logging.getLogger("eaves")

FORMATS = {
    "cityjson": "eaves.formats.models.cityjson:FORMAT",
    "geojson": "eaves.formats.vectors.geopackage:GEOJSON",
    "fgb": "eaves.formats.vectors.geopackage:FLATGEOBUF",
    "parquet": "eaves.formats.vectors.parquet:FORMAT",
}
"""Name → where the format is, as entry points name it."""
OUTPUT_OF = {
    "models": "models",
    "footprints": "footprints",
    "roof_planes": "footprints",
    "points": "classified",
}
"""Content of a format → the output of a run that it follows from."""

OUTPUT_FILES = {
    "footprints": ("footprints.gpkg", "review.csv", "primitives.csv", "buildings.qgz"),
    "models": ("buildings.city.jsonl",),
    "mask": ("mask.tif", "mask.vrt"),
    "rasters": ("dtm.tif", "dsm.tif", "ndsm.tif", "dtm.vrt", "dsm.vrt", "ndsm.vrt"),
    "report": ("report.html",),
    "steps": ("steps",),
}
"""Files, and folders of files, of each output; those of classified points follow from the inputs."""
TILES = "tiles"
"""Folder of the files of rasters too large for one, tile by tile."""


@cache
def places_of_formats() -> dict[str, str]:
    """Name → `module:attribute` of every format there is; nothing is imported."""
    return {**FORMATS, **installed(extensions.FORMATS)}


@cache
def format_of(name: str) -> Format:
    """The format of a name."""
    one: Format = imported(places_of_formats()[name])
    return one


def check_formats(
    names: Sequence[str], outputs: Sequence[str] = ("footprints", "models", "classified")
) -> None:
    """Check that every name is one of a format that can be written here, beside the `outputs` of the run.

    Raises
    ------
    ValueError
        For an unknown name, a format whose library is missing, or one of what is not among the outputs.
    """
    choices = places_of_formats()
    for name in names:
        if name not in choices:
            raise ValueError(f"--formats {name}: unknown format; choose among: {', '.join(choices)}")
        one = format_of(name)
        needed = next(OUTPUT_OF[content] for content in one.files)
        if needed not in outputs:
            raise ValueError(f"--formats {name}: it follows from {needed}; add {needed} to --outputs")
        one.require()


def planned_names(outputs: Sequence[str], names: Sequence[str]) -> set[str]:
    """Names in a run's folder of the files and folders that its outputs and formats are, but for classified
    points."""
    return files_of_formats(names) | {name for output in outputs for name in OUTPUT_FILES.get(output, ())}


def files_of_formats(names: Iterable[str]) -> set[str]:
    """Names of the files and folders of some formats, but for classified points."""
    planned = set[str]()
    for one in map(format_of, names):
        files = (file for content, (file, _) in one.files.items() if content != "points")
        planned |= {Path(file).parts[0] for file in (*files, *one.beside)}
    return planned


def copies_of_points(path: Path, names: Iterable[str]) -> list[Path]:
    """The files of formats of points that are written of one file of classified points."""
    files = (format_of(name).files.get("points") for name in names)
    return [path.with_suffix(suffix) for suffix, _ in filter(None, files)]


def classified_name(path: Path, alone: bool, taken: set[str]) -> str:
    """Name of the classified copy of an input; files of one name from two folders get a number behind, also
    where names differ by case only, which is none on many disks. A name too long for a disk is cut."""
    inner = path.stem[:-5] if path.stem.lower().endswith(".copc") else path.stem  # what is written is none
    stem = "classified" if alone else f"classified_{inner}"
    stem = os.fsdecode(os.fsencode(stem)[:LONGEST_NAME])
    number = 1
    while (name := stem if number == 1 else f"{stem}-{number}").casefold() in taken:
        number += 1
    taken.add(name.casefold())
    return f"{name}.laz"


LONGEST_NAME = 200
"""Bytes of 255, so that a number, a suffix and the folder of the file in the making have room."""


def memory_of_points(names: Iterable[str]) -> tuple[str, int]:
    """The format that needs most memory while points are written, and how many bytes a point takes."""
    return max(
        ((name, format_of(name).point_bytes) for name in names), key=lambda one: one[1], default=("", 0)
    )


@contextmanager
def noted_failure(
    name: str, failed: list[str] | None, raised: tuple[type[Exception], ...] = (InputError,)
) -> Iterator[None]:
    """Note in `failed` that a file could not be written, so that the others of a run are. Without such a list
    its error is raised, as are those that are to end a run: `raised` (an input changed), a full disk, no
    memory."""
    try:
        yield
    except Exception as error:
        if failed is None or isinstance(error, (MemoryError, *raised)) or is_full(error):
            raise
        failed.append(f"{name}: not written ({type(error).__name__}: {error})")
        log.error("%s", failed[-1], exc_info=log.isEnabledFor(logging.DEBUG))


def export_footprints(
    folder: Path,
    rows: Iterable[Row],
    roofs: Iterable[Row],
    system: CoordinateSystem,
    names: Sequence[str],
    provenance: Provenance,
    failed: list[str] | None = None,
) -> list[Path]:
    """Write the footprints, and the roof planes, in the formats named; the files written."""
    files = (
        export_content(folder, content, partial(in_order, layer), system, names, provenance, failed)
        for content, layer in (("footprints", rows), ("roof_planes", roofs))
    )
    return list(chain.from_iterable(files))


def export_content(
    folder: Path,
    content: str,
    make: Callable[[], Iterable[Any]],
    system: CoordinateSystem,
    names: Sequence[str],
    provenance: Provenance,
    failed: list[str] | None = None,
) -> list[Path]:
    """Write a content, made anew for each, in those formats named that hold it; the files written."""
    written = []
    for name in sorted(set(names), key=list(places_of_formats()).index):
        one = format_of(name)
        if content not in one.files:
            continue
        file, write = one.files[content]
        with noted_failure(Path(file).parts[0], failed):
            write(folder / file, make(), system, provenance=provenance)
            written += [folder / file, *(folder / name for name in one.beside)]
    return written


def export_points(
    files: Iterable[Path],
    system: CoordinateSystem | None,
    names: Sequence[str],
    failed: list[str] | None = None,
) -> list[Path]:
    """Write each of the classified points in the formats of points that are named; the files written."""
    writers = [format_of(name).files["points"] for name in names if "points" in format_of(name).files]
    written = []
    for path in files if writers else ():
        for suffix, write in writers:
            copy = path.with_suffix(suffix)
            with noted_failure(copy.name, failed):
                written += [copy] if write(path, copy, system) else []
    return written


def in_order(rows: Iterable[Row]) -> list[Row]:
    """Rows with the columns of all layers in the order of their declaration, others behind them."""
    declared = list(chain(*LAYERS.values()))
    attributes = ((row.geometry, dict(row.attributes)) for row in rows)
    return [
        Row(geometry, {name: values[name] for name in declared if name in values} | values)
        for geometry, values in attributes
    ]
