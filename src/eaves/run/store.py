"""The results of a run's steps, each by its unit and with its key: computed once, and found from then on."""

from __future__ import annotations

import logging
import os
import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from eaves.formats import InputError
from eaves.model import Block, CoordinateSystem
from eaves.run.keys import POINTS, SHARPENED, SUPERSEDED, THINNED, Mark, key_of
from eaves.run.part_file import PartFile, is_whole_part, save_part

log = logging.getLogger("eaves")

WORK = ".eaves-work"
"""Name of the folder of the results in that of a run."""
FORM = 13
"""Version of the form in which all lies in the folder; another one is refused."""
RECORD = np.dtype(
    [
        ("xyz", "<i4", 3),
        ("point_id", "<i8"),
        ("return_number", "u1"),
        ("number_of_returns", "u1"),
        ("classification", "u1"),
        ("moment", "<u2"),
    ]
)
"""A point between reading and the block pass: coordinates in quanta about its block's corner, and a digest of
the time of its pulse. Where methods take other fields of the points, `fields` holds them by name."""
STARTS = "starts"
"""Array of a block's result: how many its terrain begins with, of a filter that names them."""
SECONDS = "seconds"
"""The array of a result that says what it cost: no part of what was found."""


class Unit(Protocol):
    """What a result is of: a block or another square, a part of an input, a file."""

    @property
    def name(self) -> str: ...


@dataclass(frozen=True)
class Store:
    """A folder with a folder for each step, in it for each unit a file and its mark; in `points/` also a
    folder for each block with a file for each part of an input, and during a small run `records/`
    (decompressed records, a file for each part of an input)."""

    folder: Path
    has_returns: bool = True
    has_classes: bool = True
    system: CoordinateSystem = CoordinateSystem()  # noqa: RUF009 (frozen)
    fields: tuple[str, ...] = ()
    """Other fields of the points that methods take."""
    persistent: bool = False
    """True if a later run may reuse the results; only then are keys computed."""
    copies: bool = False
    """True if the records of the inputs are kept as they were read."""

    @property
    def record(self) -> np.dtype[np.void]:
        """The layout of a point."""
        return record_of(self.fields)

    def key_of(self, *taken: Any) -> str:
        """The key of what a step takes from the files it reads; empty in a store that is not persistent,
        where the files alone identify the results."""
        return key_of(*taken) if self.persistent else ""

    def prepare(self, remedy: str = "run without --resume") -> None:
        """Make the folders, where nothing of another form lies in them.

        Raises
        ------
        InputError
            Where something does.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        form = self.folder / "form"
        if any(self.folder.iterdir()) and (not form.exists() or form.read_text() != str(FORM)):
            raise InputError.about(self.folder, "holds parts that another version of eaves wrote", remedy)
        if not form.exists():
            form.write_text(str(FORM))
        (self.folder / POINTS).mkdir(exist_ok=True)

    def discard(self) -> None:
        """Remove the folder with everything in it."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def points_path(self, block: Block) -> Path:
        """The folder of a block's points."""
        return self.folder / POINTS / block.name

    def remove_points(self, block: Block) -> None:
        """Remove the points of a block."""
        shutil.rmtree(self.points_path(block), ignore_errors=True)

    def has_points(self, name: str, blocks: Iterable[str]) -> bool:
        """True if the points of a part of an input, by its name, are in some blocks, by theirs."""
        return all((self.folder / POINTS / block / f"{name}.bin").exists() for block in blocks)

    def are_whole(self, name: str, files: Mapping[str, Sequence[int]]) -> bool:
        """True if what is there of the points of a part of an input has the size and checksum that its
        `files` had, by block; else with a warning."""
        for block, (size, checksum) in files.items():
            place = self.folder / POINTS / block / f"{name}.bin"
            if place.exists() and (place.stat().st_size != size or crc32(place.read_bytes()) != checksum):
                log.warning("%s: the part is damaged; its points are read again", place)
                return False
        return True

    def keep_points(self, parts: Sequence[Unit]) -> None:
        """Remove the points of all parts of inputs but these."""
        self.evict_others(POINTS, parts)
        names = {part.name for part in parts}
        for folder in (entry for entry in (self.folder / POINTS).iterdir() if entry.is_dir()):
            for path in folder.iterdir():
                if path.stem not in names:
                    path.unlink()
            if not any(folder.iterdir()):
                folder.rmdir()

    def records_path(self, name: str) -> Path:
        """The file of the records of a part of an input."""
        return self.folder / "records" / f"{name}.bin"

    def drop_records(self) -> None:
        """Remove the records of the inputs, which only the run that read them can use."""
        shutil.rmtree(self.folder / "records", ignore_errors=True)

    def blocks(self, side: float) -> list[Block]:
        """The blocks that have points, in order."""
        with os.scandir(self.folder / POINTS) as entries:
            names = [entry.name.split("_") for entry in entries if entry.is_dir()]
        blocks = sorted(Block(int(column), int(row), side) for column, row in names)
        return [block for block in blocks if not self.has(SUPERSEDED, block) or self.count_points(block)]

    def count_points(self, block: Block) -> int:
        """Number of points that a block holds."""
        files = self.points_path(block).glob("*.bin")
        return sum(file.stat().st_size for file in files) // self.record.itemsize - len(
            self.superseded(block)
        )

    def superseded(self, block: Block) -> NDArray[np.int64]:
        """Ids (K,) of the points of a block that later ones have taken the place of."""
        return self.array(SUPERSEDED, block, "id") if self.has(SUPERSEDED, block) else np.zeros(0, np.int64)

    def read_points(self, block: Block) -> NDArray[np.void]:
        """The records of the points in a block that methods see, by input and part of it, each part's in
        canonical order."""
        return join_records(self.map_points(block))

    def scan_files(self, block: Block) -> list[tuple[int, Path]]:
        """The files of a block's points, in their order, each with the number of the input it is from."""
        return [
            (int(path.stem.split("-")[0]), path) for path in sorted(self.points_path(block).glob("*.bin"))
        ]

    def map_points(self, block: Block) -> list[NDArray[np.void]]:
        """The records of a block's points that methods see, an array a file: of a dense scan those that stand
        for the others. Of a file no more is read than is looked at."""
        files = self.map_chosen(block)
        if self.has(SHARPENED, block) and files:
            heights = self.array(SHARPENED, block, "z")
            pieces = np.split(heights, np.cumsum([len(records) for records in files])[:-1])
            for records, piece in zip(files, pieces, strict=True):  # private to this process
                records["xyz"][:, 2] = piece
        return files

    def map_chosen(self, block: Block) -> list[NDArray[np.void]]:
        """The same with heights as they were read."""
        part = self.thinned(block)
        return [part.mapped("records").view(self.record)] if part else self.map_all(block)

    def thinned(self, block: Block) -> PartFile | None:
        """The points that stand for all of a dense scan in a block, with who stands for whom
        (`eaves.blocks.thinned`); None or empty where all speak for themselves."""
        return PartFile(self.path(THINNED, block)) if self.has(THINNED, block) else None

    def followers(self, block: Block) -> list[tuple[NDArray[np.int64], NDArray[np.uint32]]]:
        """Of each file of a dense scan in a block the ids (N,) of all points, and the numbers (N,) of what
        stands for them; nothing where all speak for themselves."""
        part = self.thinned(block)
        files = self.map_all(block) if part else []
        places = np.cumsum([len(records) for records in files])
        stands = np.split(part.mapped("stands"), places[:-1]) if part else []
        return [(records["point_id"], numbers) for records, numbers in zip(files, stands, strict=True)]

    def map_all(self, block: Block) -> list[NDArray[np.void]]:
        """The records of all points in a block, an array a file; of a file no more is read than is looked
        at."""
        files = map_records([path for _, path in self.scan_files(block)], self.record)
        ids = self.superseded(block)
        return [records[~np.isin(records["point_id"], ids)] for records in files] if len(ids) else files

    def path(self, step: str, unit: Unit) -> Path:
        """The file of the result of a step for a unit."""
        return self.folder / step / f"{unit.name}.part"

    def has(self, step: str, unit: Unit) -> bool:
        """True if the result exists."""
        return os.path.exists(f"{self.folder}/{step}/{unit.name}.part")

    def array(self, step: str, unit: Block, name: str) -> NDArray[Any]:
        """An array of a result."""
        return PartFile(self.path(step, unit))[name]

    def units(self, step: str, side: float) -> list[Block]:
        """The blocks or squares of a side (m) that have results of a step, in order."""
        names = [name.split("_") for name in self.names(step)]
        return sorted(Block(int(column), int(row), side) for column, row in names)

    def names(self, step: str) -> list[str]:
        """The names of the units that have results of a step."""
        return [path.stem for path in (self.folder / step).glob("*.part")]

    def mark(self, step: str, unit: Unit) -> Mark | None:
        """The mark of a result; None where there is none that is whole."""
        path = self.path(step, unit).with_suffix(".key")
        if not (path.exists() and self.has(step, unit)):
            return None
        keys = path.read_text(encoding="ascii", errors="replace").split()
        if len(keys) != len(Mark.__annotations__) or any(len(word) != len(key_of()) for word in keys):
            log.warning("%s: the part is damaged; it is computed again", path)
            return None
        return Mark(*keys)

    def found(self, step: str, units: Iterable[Unit]) -> list[tuple[str, str]]:
        """The units that have a result, each with the key of what was found."""
        marks = ((unit.name, self.mark(step, unit)) for unit in units)
        return [(name, mark.found) for name, mark in marks if mark is not None]

    def reuse_if_unchanged(self, step: str, unit: Unit, read: str, taken: str) -> bool:
        """True if the result that is there follows from the same, though read from other files; it is then
        marked as read from these, and removed otherwise."""
        mark = self.mark(step, unit)
        if taken and mark is not None and mark.taken == taken:
            self._write_mark(step, unit, replace(mark, read=read))
            return True
        self.remove(step, unit)
        return False

    def save(
        self,
        step: str,
        unit: Unit,
        arrays: Mapping[str, NDArray[Any]],
        read: str = "",
        taken: str = "",
        step_key: str = "",
    ) -> None:
        """Keep a result with its mark, each whole or not at all."""
        path = self.path(step, unit)
        path.parent.mkdir(exist_ok=True)
        table = save_part(path, arrays)
        result_key = key_of({name: entry[:3] for name, entry in table.items() if name != SECONDS})
        nothing = key_of()
        mark = Mark(step_key or nothing, read or nothing, taken or read or nothing, result_key)
        self._write_mark(step, unit, mark)

    def _write_mark(self, step: str, unit: Unit, mark: Mark) -> None:
        path = self.path(step, unit).with_suffix(".key")
        hidden = path.with_name(f".{path.name}-{os.getpid()}")
        hidden.write_text(" ".join(vars(mark).values()), encoding="ascii")
        os.replace(hidden, path)

    def remove(self, step: str, unit: Unit) -> None:
        """Remove a result with its mark."""
        for suffix in (".key", ".part"):
            self.path(step, unit).with_suffix(suffix).unlink(missing_ok=True)

    def evict_others(self, step: str, units: Iterable[Unit]) -> None:
        """Remove the results of a step for all units but these."""
        names = {unit.name for unit in units}
        for path in (self.folder / step).glob("*.*"):
            if path.stem not in names:
                path.unlink(missing_ok=True)

    def drop_damaged(self) -> None:
        """Remove the parts that were changed or damaged, with a warning for each: they are computed
        again; and what a writer that was killed left hidden beside them."""
        for leftover in self.folder.glob("*/.*"):
            if leftover.is_dir():
                shutil.rmtree(leftover)
            else:
                leftover.unlink()
        for path in sorted(self.folder.glob("*/*.part")):
            if not is_whole_part(path):
                log.warning("%s: the part is damaged; it is computed again", path)
                path.unlink()


def record_of(fields: Sequence[str]) -> np.dtype[np.void]:
    """The layout of a point with other fields by their names."""
    others = [("fields", [(name, "<f8") for name in fields])]
    return np.dtype([*RECORD.descr, *others]) if fields else RECORD


def map_records(paths: Sequence[Path], record: np.dtype[np.void] = RECORD) -> list[NDArray[np.void]]:
    """The records of some files, an array each, of which no more is read than is looked at."""
    return [np.asarray(np.memmap(path, record, "c")) for path in paths if path.stat().st_size]


def join_records(arrays: Sequence[NDArray[np.void]]) -> NDArray[np.void]:
    """Arrays of records, one after the other; one alone is not copied."""
    if len(arrays) == 1:
        return arrays[0]
    # numpy joins records field by field, many times as slowly
    data = [np.zeros(0, np.uint8), *(records.view(np.uint8) for records in arrays)]
    return np.concatenate(data).view(arrays[0].dtype if arrays else RECORD)
