"""The formats written on request, by the names of `--formats`, and the names of all files of a run.

The table is of those that come with the core; installed packages bring others by entry points of the group
`eaves.formats`, each with its name. A format is fetched when it is asked for: most runs want none of them.
"""

from __future__ import annotations

import logging
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from eaves import extensions
from eaves.blocks.block_file import BlockFile
from eaves.buildings.building_file import SavedBuildings, read_numbers
from eaves.extensions import imported, installed
from eaves.formats import InputError, write_classified
from eaves.formats.columns import LAYERS
from eaves.formats.format import Format
from eaves.formats.inputs import refuse_change
from eaves.formats.points.classified import SUPERSEDED, UNCHANGED
from eaves.formats.vectors.geopackage import Row
from eaves.formats.whole_files import atomic, is_full
from eaves.model import BLOCK_SIDE, BUILDING, Block, CoordinateSystem, Provenance
from eaves.run.index import Index
from eaves.run.keys import CLASSIFIED, code_digest, key_of
from eaves.run.keys import SUPERSEDED as SUPERSEDED_POINTS
from eaves.run.manifest import is_changed, known_files
from eaves.run.points import Window, file_slices
from eaves.run.store import Store

if TYPE_CHECKING:
    from eaves.flow.run import Run

log = logging.getLogger("eaves")

TYPES: dict[str, Any] = {
    "classes": np.uint8,
    "part": np.uint8,
    "building_id": np.int32,
    "plane_id": np.int32,
}


PIECE = 1_000_000
"""Values that are compared, or written, at a time."""


class PointSink(Protocol):
    """Receives the classified points as they are written; picklable, for another process may write them."""

    def start(self, points: int, buildings: int, on_buildings: int) -> None:
        """The number of points of the inputs, of buildings that were found, and of the points of these."""

    def write(self, path: Path, first: int, records: NDArray[np.void]) -> None:
        """Records of a file, and the place of the first."""

    def take_from(self, other: Any) -> None:
        """Take what the copy in another process received."""


@dataclass(frozen=True)
class PointColumn:
    """A run of values in a file, read slice by slice, so that memory does not grow with the file."""

    path: Path
    dtype: Any
    first: int
    count: int

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, place: slice) -> NDArray[Any]:
        start, stop, _ = place.indices(self.count)
        size = np.dtype(self.dtype).itemsize
        return np.fromfile(self.path, self.dtype, stop - start, offset=(self.first + start) * size)


def known_copies(folder: Path, work: Path) -> dict[str, Path]:
    """The classified points in a run's folder by the keys of what they follow from, those that are as the run
    wrote them; `work` holds the results that it kept."""
    known, store = known_files(folder), Store(work)
    paths = [folder / place.stem for place in sorted((work / CLASSIFIED).glob("*.part"))]
    return {
        mark.read: path
        for path in paths
        if (mark := store.mark(CLASSIFIED, path))
        and path.exists()
        and known.get(path.name)
        and not is_changed(path, known[path.name])
    }


def write_points(
    run: Run,
    kept: SavedBuildings,
    regions: Mapping[Block, BlockFile],
    owners: Sequence[Block],
    sink: PointSink | None = None,
    copies: Mapping[str, Path] | None = None,
) -> list[Path]:
    """The classified points of every input; those of which there are `copies` by their keys are copied.

    Raises
    ------
    InputError
        When an input is no longer what it was when the run began.
    """
    index, single, windowed = run.index, run.classified, run.window != Window()
    labels = run.work_folder / "labels"
    gather_labels(labels, index, kept, regions, owners)
    records = copies_of(index, kept.store.records_path)
    written: dict[Path, str] = {}
    names: set[str] = set()
    for number in range(len(index)):
        columns = columns_of(labels, index, number)
        if windowed and not has_used(columns["classes"]):
            continue
        path = single or run.folder / classified_name(index.path(number), len(index) == 1, names)
        made_from = replace(run.provenance, sources=(index.path(number).name,), count=1)
        key = key_of_columns(columns, index.mark(number), made_from) if run.options["keep"] else ""
        copy = (copies or {}).get(key)
        classes, columns_beside = columns["classes"], {} if single else {**columns}
        columns_beside.pop("classes", None)
        try:
            if copy is None or sink is not None:
                write = None if sink is None else partial(sink.write, path)
                source, copied = index.source(number), records.get(number, [])
                write_classified(
                    source,
                    path,
                    classes,
                    columns_beside,
                    sink=write,
                    provenance=made_from,
                    copies=copied,
                    used_only=windowed,
                )
            elif copy != path:
                with atomic(path) as temporary:
                    shutil.copyfile(copy, temporary)
            written[path] = key
        except InputError as error:  # a damaged file; scattering it has said so
            log.debug("%s", error)
            names.discard(path.stem.casefold())
        try:
            refuse_change(index.path(number), index.mark(number))
        except InputError:
            path.unlink(missing_ok=True)
            raise
    shutil.rmtree(labels)
    if run.options["keep"]:
        kept.store.evict_others(CLASSIFIED, written)
        for path, key in written.items():
            kept.store.save(CLASSIFIED, path, {}, key)
    return list(written)


def columns_of(labels: Path, index: Index, number: int) -> dict[str, PointColumn]:
    """The attributes of each point of an input, by name."""
    first, count = int(index.starts[number]), index.count(number)
    return {name: PointColumn(labels / f"{name}.bin", dtype, first, count) for name, dtype in TYPES.items()}


def has_used(classes: PointColumn) -> bool:
    """True if any point of an input was used."""
    pieces = (classes[first : first + PIECE] for first in range(0, len(classes), PIECE))
    return any((piece != UNCHANGED).any() for piece in pieces)


def key_of_columns(columns: Mapping[str, PointColumn], mark: bytes, made_from: Provenance) -> str:
    """The key of all that a classified file follows from."""
    pieces = (
        column[first : first + PIECE] for column in columns.values() for first in range(0, len(column), PIECE)
    )
    code = code_digest(["flow/formats.py", "formats/points"])
    return key_of(code, mark, made_from, [key_of(piece) for piece in pieces])


def copies_of(index: Index, path_of: Callable[[str], Path]) -> dict[int, list[Path]]:
    """The files with the records of the inputs that were copied whole as they were read, by input; `path_of`
    says where that of a part lies."""
    paths: dict[int, list[Path]] = {}
    for part in file_slices(index):
        paths.setdefault(part.number, []).append(path_of(part.name))
    return {number: files for number, files in paths.items() if all(path.exists() for path in files)}


def gather_labels(
    folder: Path,
    index: Index,
    kept: SavedBuildings,
    regions: Mapping[Block, BlockFile],
    owners: Sequence[Block],
) -> None:
    """Fill the files of labels in a folder; they are opened anew for every block, for pages stay in memory
    till then."""
    total = max(index.points, 1)
    folder.mkdir(exist_ok=True)
    for name, dtype in TYPES.items():
        fill_file(folder / f"{name}.bin", dtype, total, UNCHANGED if name == "classes" else 0)

    def opened(name: str) -> np.memmap[Any, Any]:
        return np.memmap(folder / f"{name}.bin", TYPES[name], "r+", shape=(total,))

    numbers = read_numbers(kept)
    number, first_plane = 0, 0
    for owner in owners:
        buildings, planes = opened("building_id"), opened("plane_id")
        names = [] if numbers is None else [str(row.values["id"]) for row in kept.rows([owner])]
        for place, (point_id, plane) in enumerate(kept.planes(owner)):
            if numbers is None:
                number += 1
            else:
                number, first_plane, _ = numbers.of[names[place]]
            buildings[point_id] = number
            planes[point_id] = np.where(plane > 0, plane + first_plane, 0)
            first_plane += int(plane.max(initial=0))
    for block, result in regions.items():
        point_id, followers = result.point_id(), kept.store.followers(block)
        values = {"classes": result["classification"], "part": result["part"]}
        if owners:
            values |= {name: opened(name)[point_id] for name in TYPES if name not in values}
            values["classes"][values["building_id"] > 0] = BUILDING
        for name, column in values.items():
            for ids, stands in followers:
                opened(name)[ids] = column[stands]
            opened(name)[point_id] = column
    for block in kept.store.units(SUPERSEDED_POINTS, BLOCK_SIDE):
        opened("classes")[kept.store.superseded(block)] = SUPERSEDED


def fill_file(path: Path, dtype: Any, count: int, value: int, piece: int = PIECE) -> None:
    """Write a file of `count` equal values. All of it is written: a disk that is full must say so now, for a
    page of memory that finds no place on it later ends the process."""
    values = np.full(min(piece, count), value, dtype)
    with path.open("wb") as file:
        for first in range(0, count, len(values)):
            file.write(values[: count - first].tobytes())
        file.flush()
        os.fsync(file.fileno())


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
