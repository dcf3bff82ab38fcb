"""The results of a run's steps, each by its unit and with its key: computed once, and found from then on."""

from __future__ import annotations

import base64
import json
import logging
import math
import os
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from datetime import date, datetime, time, timedelta
from functools import partial
from pathlib import Path
from struct import Struct
from typing import Any, Protocol
from zlib import crc32

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from eaves.formats import InputError
from eaves.formats.whole_files import atomic
from eaves.model import Block, CoordinateSystem
from eaves.run.keys import POINTS, SHARPENED, SUPERSEDED, THINNED, Mark, key_of

log = logging.getLogger("eaves")

TIMES = {cls.__name__: cls for cls in (datetime, date, time)}
MARK = "~"
"""Key of an object that stands for something JSON has no word for."""
HEAD = Struct("<I")
"""Before a value: how many bytes are its JSON; its arrays lie behind."""
TABLE = Struct("<II")
"""At the head of a part: how many bytes are its table, and their checksum."""
JSON_TYPES = frozenset((type(None), str, bool, int, float))


def save_part(path: Path, arrays: Mapping[str, NDArray[Any]], forced: bool = True) -> dict[str, list[Any]]:
    """Write arrays by name, whole or not at all, `forced` to the disk or not; type, shape, checksum and place
    of each, by its name.

    Raises
    ------
    ValueError
        When an array holds objects.
    """
    pieces, table, place = [], {}, 0
    for name, array in arrays.items():
        if array.dtype.hasobject:
            raise ValueError(f"{name} holds objects, which a part never does")
        pieces.append(np.ascontiguousarray(array).data)
        table[name] = [array.dtype.str, array.shape, crc32(pieces[-1]), place]
        place += array.nbytes
    text = json.dumps(table).encode()
    with atomic(path, forced) as temporary, temporary.open("wb") as file:
        file.write(TABLE.pack(len(text), crc32(text)) + text)
        file.writelines(pieces)
    return table


class PartFile(Mapping[str, NDArray[Any]]):
    """The arrays of a part by name, each read when it is asked for.

    Raises
    ------
    ValueError
        When the file is no part; of an array, when the file is cut off.
    """

    def __init__(self, path: Path) -> None:
        with path.open("rb") as file:
            length, checksum = TABLE.unpack(file.read(TABLE.size).ljust(TABLE.size, b"\0"))
            text = file.read(length)
        if not length or crc32(text) != checksum:
            raise ValueError(f"{path} is no part of a run, or a damaged one")
        self.path, self.start = path, TABLE.size + length
        self.table: dict[str, list[Any]] = json.loads(text)

    def __getitem__(self, name: str) -> NDArray[Any]:
        kind, shape, _, place = self.table[name]
        return np.fromfile(self.path, kind, math.prod(shape), offset=self.start + place).reshape(shape)

    def __iter__(self) -> Iterator[str]:
        return iter(self.table)

    def __len__(self) -> int:
        return len(self.table)

    def mapped(self, name: str) -> NDArray[Any]:
        """An array of which no more is read than is looked at; one that is empty is refused."""
        kind, shape, _, place = self.table[name]
        return np.asarray(np.memmap(self.path, kind, "c", self.start + place, tuple(shape)))


def as_arrays(result: Any) -> Mapping[str, NDArray[Any]]:
    """A result as the arrays of its file: as it is where it is arrays by name, else packed as `value`."""
    if isinstance(result, Mapping) and all(isinstance(array, np.ndarray) for array in result.values()):
        return result
    return {"value": packed(result)}


Records = NDArray[Any]
"""Points as they lie in files: an array of a structured type."""


def load_part(path: Path) -> Any:
    """The result that `as_arrays` was given, from its file."""
    file = PartFile(path)
    return unpack(file["value"]) if "value" in file else dict(file)


def open_part(path: Path, *_: Any) -> PartFile:
    """The arrays of a part, each read when it is asked for, as steps load a result."""
    return PartFile(path)


def packed(value: Any) -> NDArray[np.uint8]:
    """A value as an array of bytes (`pack`)."""
    return np.frombuffer(pack(value), np.uint8)


def pack(value: Any) -> bytes:
    """A value with its arrays in bytes: JSON's own values, tuples, geometries, arrays, bytes, times and data
    classes of this package."""
    arrays = bytearray()
    text = json.dumps(plain(value, arrays), separators=(",", ":")).encode()
    return HEAD.pack(len(text)) + text + arrays


def unpack(data: bytes | NDArray[np.uint8]) -> Any:
    """The value of `pack`."""
    data = bytes(data)
    end = HEAD.size + HEAD.unpack_from(data)[0]
    # the parser itself hands over each object, its members done: a walk over all takes five times as long
    return json.loads(data[HEAD.size : end], object_hook=partial(restored, arrays=data[end:]))


def is_whole_part(path: Path) -> bool:
    """True if a part is whole and every array matches its checksum."""
    try:
        part = PartFile(path)
        return all(crc32(part[name].data) == checksum for name, (*_, checksum, _) in part.table.items())
    except (OSError, ValueError):
        return False


def plain(value: Any, arrays: bytearray) -> Any:
    """A value in JSON's words; its arrays go behind the others."""
    if type(value) in JSON_TYPES:
        return value
    if isinstance(value, np.generic):
        return plain(value.item(), arrays)
    if isinstance(value, str | int | float):
        return value
    if isinstance(value, list):
        return [plain(item, arrays) for item in value]
    if isinstance(value, tuple):
        return {MARK: "tuple", "items": [plain(item, arrays) for item in value]}
    if isinstance(value, Mapping):
        if MARK not in value and all(isinstance(key, str) for key in value):
            return {key: plain(item, arrays) for key, item in value.items()}
        return {MARK: "dict", "items": [[plain(k, arrays), plain(v, arrays)] for k, v in value.items()]}
    if isinstance(value, np.ndarray):
        place = len(arrays)
        arrays += value.tobytes()
        return {MARK: "array", "type": value.dtype.str, "shape": value.shape, "place": place}
    if isinstance(value, BaseGeometry):
        return {MARK: "geometry", "wkb": base64.b64encode(shapely.to_wkb(value)).decode("ascii")}
    if isinstance(value, bytes):
        return {MARK: "bytes", "base64": base64.b64encode(value).decode("ascii")}
    cls = type(value)
    if cls.__name__ in TIMES:
        return {MARK: cls.__name__, "iso": value.isoformat()}
    if isinstance(value, timedelta):
        return {MARK: "timedelta", "parts": [value.days, value.seconds, value.microseconds]}
    members = {field.name: plain(getattr(value, field.name), arrays) for field in fields(value)}
    return {MARK: f"{cls.__module__}:{cls.__name__}"} | members


def restored(value: dict[str, Any], arrays: bytes) -> Any:
    """The value that `plain` was given, of an object whose members are restored."""
    kind = value.pop(MARK, None)
    if kind is None:
        return value
    if kind == "tuple":
        return tuple(value["items"])
    if kind == "dict":
        return dict(value["items"])
    if kind == "array":
        array = np.frombuffer(arrays, value["type"], math.prod(value["shape"]), value["place"])
        return array.reshape(value["shape"]).copy()  # aligned in memory
    if kind == "geometry":
        return shapely.from_wkb(base64.b64decode(value["wkb"]))
    if kind == "bytes":
        return base64.b64decode(value["base64"])
    if kind in TIMES:
        return TIMES[kind].fromisoformat(value["iso"])
    if kind == "timedelta":
        return timedelta(*value["parts"])
    return data_class(kind)(**value)


def data_class(kind: str) -> Any:
    """A data class of this package by `module:Class`; whoever reads a value of it has imported it.

    Raises
    ------
    ValueError
        When it is another thing.
    """
    module, _, name = kind.partition(":")
    cls = getattr(sys.modules.get(module), name, None)
    if not (module.startswith("eaves.") and isinstance(cls, type) and is_dataclass(cls)):
        raise ValueError(f"a part holds {kind!r}, which is no data of eaves")
    return cls


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
        (`eaves.blocks.points`); None or empty where all speak for themselves."""
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
        table = save_part(path, arrays, self.persistent)  # what resumes a run looks at all checksums
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

    def link(self, step: str, unit: Unit, other: Store) -> None:
        """Have a result with its mark in another store, too, under other names of the files."""
        for suffix in (".part", ".key"):
            place = self.path(step, unit).with_suffix(suffix)
            link_file(place, other.path(step, unit).with_suffix(suffix))

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


class Results(Mapping[Block, Any]):
    """Values of some squares, each loaded when it is asked for."""

    def __init__(self, load: Callable[[Block], Any], squares: Sequence[Block]) -> None:
        self._load, self._squares = load, dict.fromkeys(squares)

    def __getitem__(self, square: Block) -> Any:
        if square not in self._squares:
            raise KeyError(square)
        return self._load(square)

    def __iter__(self) -> Iterator[Block]:
        return iter(self._squares)

    def __len__(self) -> int:
        return len(self._squares)


def link_file(source: str | Path, target: str | Path) -> None:
    """One file under another name, in a folder that is made when missing."""
    Path(target).parent.mkdir(parents=True, exist_ok=True)
    Path(target).unlink(missing_ok=True)
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)
