"""The classified points of a run, file by file as they came: gathered labels beside them, or copies of those
that an earlier run wrote."""

from __future__ import annotations

import logging
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from eaves.blocks.block_file import BlockFile
from eaves.buildings.building_file import SavedBuildings, read_numbers
from eaves.flow.formats import classified_name
from eaves.formats import InputError, write_classified
from eaves.formats.inputs import refuse_change
from eaves.formats.points.classified import SUPERSEDED, UNCHANGED
from eaves.formats.whole_files import atomic
from eaves.model import BLOCK_SIDE, BUILDING, Block, Provenance
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
    code = code_digest(["flow/classified.py", "formats/points"])
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
