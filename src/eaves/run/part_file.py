"""Parts of a run on disk: arrays and JSON in one npz file. Data only: reading one can run no code.

The zip format keeps a checksum of each array, which reading it verifies.
"""

from __future__ import annotations

import base64
import json
import math
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import fields
from datetime import date, datetime, time, timedelta
from functools import lru_cache, partial
from io import BytesIO
from pathlib import Path
from struct import Struct
from typing import Any, Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from eaves.formats.atomic import atomic
from eaves.model import BuildingModel, Failure, Footprint, RoofPlane, Solid
from eaves.model.building import Face, Installation

TYPES: dict[str, type[Any]] = {
    cls.__name__: cls for cls in (BuildingModel, Failure, Footprint, RoofPlane, Solid, Face, Installation)
}
"""The classes a part may hold, beside JSON's own values, tuples, geometries, arrays, bytes and times."""
TIMES = {cls.__name__: cls for cls in (datetime, date, time)}
MARK = "~"
"""Key of an object that stands for something JSON has no word for."""
HEAD = Struct("<II")
"""Before an item: how many bytes tell of its arrays, and how many are its JSON."""
JSON_TYPES = frozenset((type(None), str, bool, int, float))


def save_part(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays by name, whole or not at all."""
    with atomic(path) as temporary:
        # numpy's stub takes any of the names for its own option allow_pickle
        np.savez(temporary, **arrays)  # type: ignore[arg-type]


def open_part(path: Path) -> PartFile:
    """The arrays of a part by name, each read when it is asked for; to be used in a `with` statement."""
    return PartFile(path)


class PartFile(Mapping[str, NDArray[Any]]):
    """A part that is open. Like numpy's own reader, but that many small arrays cost a third of the time."""

    def __init__(self, path: Path) -> None:
        try:
            self._zip = zipfile.ZipFile(path)
        except zipfile.BadZipFile:
            raise ValueError(
                f"{path} is no part, which is a zip file of arrays, but perhaps a pickle"
            ) from None

    def __enter__(self) -> PartFile:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def __getitem__(self, name: str) -> NDArray[Any]:
        data = self._zip.read(name + NPY)
        start = PREFIX + int.from_bytes(data[PREFIX - 2 : PREFIX], "little")
        shape, order, dtype = read_header(data[:start])
        return np.frombuffer(data, dtype, math.prod(shape), start).reshape(shape, order=order).copy()

    def __iter__(self) -> Iterator[str]:
        return (name.removesuffix(NPY) for name in self._zip.namelist())

    def __len__(self) -> int:
        return len(self._zip.namelist())

    def close(self) -> None:
        """Close the file."""
        self._zip.close()


NPY, PREFIX = ".npy", 10
"""Numpy's suffix, and the bytes before the header of its files, of which the last two are its length."""


@lru_cache(maxsize=1024)
def read_header(data: bytes) -> tuple[tuple[int, ...], Literal["C", "F"], np.dtype[Any]]:
    """Shape, order and type of an array, of what stands before its values in its npy file; most arrays of a
    run bear one of a few."""
    stream = BytesIO(data)
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError("an array of a part has a header of another version than parts have")
    shape, by_columns, dtype = np.lib.format.read_array_header_1_0(stream)
    if dtype.hasobject:
        raise ValueError("an array of a part would be a pickle, which is never loaded")
    return shape, "F" if by_columns else "C", dtype


def as_arrays(value: Any) -> Mapping[str, NDArray[Any]]:
    """A result as the arrays of its file: as it is where it is arrays by name, else packed as `value`."""
    if isinstance(value, Mapping) and all(isinstance(array, np.ndarray) for array in value.values()):
        return value
    return pack("value", value)


def load_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """All arrays of a part, by name."""
    with open_part(path) as file:
        return dict(file)


def load_value(path: Path, types: Mapping[str, type[Any]] = TYPES) -> Any:
    """The one value of a file, packed under the name `value`."""
    with open_part(path) as file:
        return unpack(file, "value", types)


def pack(name: str, value: Any) -> dict[str, NDArray[Any]]:
    """A value as a few arrays, their names beginning with `name`: those in it are joined, type by type, for
    each array of a file costs as much to open as hundreds of numbers to read."""
    arrays: list[NDArray[Any]] = []
    text = encode(value, arrays)
    joined: dict[str, list[NDArray[Any]]] = {}
    index = []
    for array in arrays:
        joined.setdefault(array.dtype.str, []).append(array.ravel())
        index.append([array.dtype.str, list(array.shape)])
    packed = {name: text, f"{name}-index": encode(index, [])}
    return packed | {f"{name}-{kind}": np.concatenate(pieces) for kind, pieces in joined.items()}


def unpack(file: Mapping[str, NDArray[Any]], name: str, types: Mapping[str, type[Any]] = TYPES) -> Any:
    """The value of `pack`, from a part that is open."""
    joined: dict[str, NDArray[Any]] = {}
    ends: dict[str, int] = {}
    arrays = []
    for kind, shape in decode(file[f"{name}-index"], []):
        if kind not in joined:
            joined[kind], ends[kind] = file[f"{name}-{kind}"], 0
        start, ends[kind] = ends[kind], ends[kind] + math.prod(shape)
        arrays.append(joined[kind][start : ends[kind]].reshape(shape))
    return decode(file[name], arrays, types)


def pack_item(value: Any) -> bytes:
    """A value by itself, with its arrays: one of many in an array of bytes."""
    arrays: list[NDArray[Any]] = []
    text = json.dumps(plain(value, arrays), separators=(",", ":")).encode()
    index = json.dumps([[array.dtype.str, array.shape] for array in arrays], separators=(",", ":")).encode()
    return b"".join([HEAD.pack(len(index), len(text)), index, text, *(array.tobytes() for array in arrays)])


def unpack_item(data: bytes) -> Any:
    """The value of `pack_item`."""
    sizes = HEAD.unpack_from(data)
    start = HEAD.size + sizes[0]
    place, arrays = start + sizes[1], []
    for kind, shape in json.loads(data[HEAD.size : start]):
        array = np.frombuffer(data, kind, math.prod(shape), place)
        arrays.append(array.reshape(shape).copy())  # in line with the machine's words
        place += array.nbytes
    return decode(data[start : start + sizes[1]], arrays)


def is_whole_part(path: Path) -> bool:
    """True if a part is whole and every array matches its checksum."""
    try:
        with zipfile.ZipFile(path) as file:
            return bool(file.namelist()) and file.testzip() is None
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, NotImplementedError, RuntimeError):
        return False


def encode(value: Any, arrays: list[NDArray[Any]]) -> NDArray[np.uint8]:
    """A value as JSON in bytes; its arrays go to `arrays`, which the JSON counts."""
    return np.frombuffer(json.dumps(plain(value, arrays), separators=(",", ":")).encode(), np.uint8)


def decode(
    text: NDArray[np.uint8] | bytes, arrays: list[NDArray[Any]], types: Mapping[str, type[Any]] = TYPES
) -> Any:
    """The value that `encode` was given."""
    # the parser itself hands over each object, its members done: a walk over all takes five times as long
    return json.loads(bytes(text), object_hook=partial(restored, arrays=arrays, types=types))


def plain(value: Any, arrays: list[NDArray[Any]]) -> Any:
    """A value in JSON's words."""
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
        arrays.append(value)
        return {MARK: "array", "number": len(arrays) - 1}
    if isinstance(value, BaseGeometry):
        return {MARK: "geometry", "wkb": base64.b64encode(shapely.to_wkb(value)).decode("ascii")}
    if isinstance(value, Solid):
        return plain_solid(value, arrays)
    if isinstance(value, bytes):
        return {MARK: "bytes", "base64": base64.b64encode(value).decode("ascii")}
    name = type(value).__name__
    if name in TIMES:
        return {MARK: name, "iso": value.isoformat()}
    if isinstance(value, timedelta):
        return {MARK: "timedelta", "parts": [value.days, value.seconds, value.microseconds]}
    return {MARK: name} | {one.name: plain(getattr(value, one.name), arrays) for one in fields(value)}


def plain_solid(solid: Solid, arrays: list[NDArray[Any]]) -> dict[str, Any]:
    """A solid in JSON's words: its faces, most of what a model consists of, in five lists."""
    lists = {one.name: getattr(solid, one.name).tolist() for one in fields(solid)[1:]}
    return {MARK: "Solid", "vertices": plain(solid.vertices, arrays), **lists}


def restored(value: dict[str, Any], arrays: list[NDArray[Any]], types: Mapping[str, type[Any]]) -> Any:
    """The value that `plain` was given, of an object whose members are restored."""
    kind = value.pop(MARK, None)
    if kind is None:
        return value
    if kind == "tuple":
        return tuple(value["items"])
    if kind == "dict":
        return dict(value["items"])
    if kind == "array":
        return arrays[value["number"]]
    if kind == "geometry":
        return shapely.from_wkb(base64.b64decode(value["wkb"]))
    if kind == "bytes":
        return base64.b64decode(value["base64"])
    if kind in TIMES:
        return TIMES[kind].fromisoformat(value["iso"])
    if kind == "timedelta":
        return timedelta(*value["parts"])
    return restored_solid(value) if types[kind] is Solid else types[kind](**value)


def restored_solid(value: dict[str, Any]) -> Solid:
    """The solid of `plain_solid`."""
    vertices, surfaces = value.pop("vertices"), np.array(value.pop("surfaces"), np.str_)
    numbers = {name: np.array(numbers, np.int64) for name, numbers in value.items()}
    return Solid(vertices, surfaces=surfaces, **numbers)
