"""Parts of a run on disk: arrays by name in one file, and values with their arrays in one of these.

Data only: reading one can run no code. A table says of each array its type, its shape and its checksum; the
bytes follow as they are. A run that resumes another verifies the checksums once (`is_whole_part`), and
whoever reads an array later does not: the same parts are read by all blocks around.
"""

from __future__ import annotations

import base64
import json
import math
import sys
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from datetime import date, datetime, time, timedelta
from functools import partial
from pathlib import Path
from struct import Struct
from typing import Any
from zlib import crc32

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from eaves.formats.whole_files import atomic

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


def load_part(path: Path) -> Any:
    """The result that `as_arrays` was given, from its file."""
    file = PartFile(path)
    return unpack(file["value"]) if "value" in file else dict(file)


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
