"""Keys: all that a result follows from, as one short word.

A result is named by the key of all that its step takes: its code, the reference system, parameters and
inputs. Where that is found again, the step is not run: that is all there is to resuming a run and to updating
one.

The code of a step is one digest of the folders and files that it declares, which a test holds to be all that
it can run, and of the methods that it is given. Writers, styles, pictures and commands are in none: inputs
are known by what was read of them, to the last bit.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from eaves.methods import Method

PACKAGE = "eaves"
DIGITS = 32
"""Of a digest or a key; processors have SHA-256 built in, so that it is faster than any other of Python's
hashes."""


HOME = Path(__file__).parents[1]
"""The folder of this package."""

BASE = ("kernels.py", "methods.py", "model", "geometry", "raster", "run")
"""The code under every step: nouns, plain operations, and how points and results are kept and loaded."""
READING = (
    *(*BASE, "formats/points", "formats/inputs.py", "formats/crs.py", "formats/statements.py"),
    "formats/transformation.py",
)
"""The code that reads points."""
GROUND_CODE = (*BASE, "blocks/ground.py", "ground/stage.py", "ground/toolkit", "surroundings")
SCENES_CODE = (*GROUND_CODE, "blocks/block.py", "blocks/block_file.py", "detect/stage.py", "detect/toolkit")
BUILDINGS_CODE = (
    *(*BASE, "blocks/block_file.py", "buildings", "figures", "footprints", "outline", "units", "roof"),
    *("reconstruct", "solids", "surroundings", "validate", "detect/toolkit/cells.py"),
)
EVERYTHING = ("",)
"""The whole package: what a method of another one may take from it."""


def code_digest(code: Iterable[str], folder: Path = HOME) -> str:
    """The digest of the sources of some folders and files.

    Parameters
    ----------
    code : iterable of str
        Paths of folders and files under `folder`.
    folder : Path
        The folder of this package, or another.

    Returns
    -------
    str
        A word of `DIGITS` hexadecimal digits.

    Raises
    ------
    FileNotFoundError
        When there is no such path.

    Examples
    --------
    >>> from eaves.run.keys import code_digest
    >>> code_digest(["ground"]) == code_digest(["detect"])
    False
    """
    return kept_digest(tuple(dict.fromkeys(code)), folder)


def digest_of(code: tuple[str, ...], folder: Path) -> str:
    """The same as the files stand now."""
    digest = hashlib.sha256()
    for name in code:
        place = folder / name
        for file in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            content = hashlib.sha256(file.read_bytes()).hexdigest()
            digest.update(f"{file.relative_to(folder).as_posix()} {content}\n".encode())
    return digest.hexdigest()[:DIGITS]


kept_digest = cache(digest_of)


def is_of_package(module: str) -> bool:
    """True if a module is of this package, by its name."""
    return module.partition(".")[0] == PACKAGE


def source_of(module: str) -> Path | None:
    """The folder of the package that a module is of, or its file; None where it has no source."""
    top = sys.modules.get(module.partition(".")[0])
    places = list(getattr(top, "__path__", ())) or [getattr(top, "__file__", None) or ""]
    return next((path for path in map(Path, places) if path.name and path.exists()), None)


def code_of_methods(value: Any, folder: Path = HOME) -> Iterator[str]:
    """The digests of the code of the methods and other classes that a parameter is made of, beside what the
    step declares: of one of ours its own file, or the folder of its steps; of another package that package,
    which may change while a process goes on, and all of ours, which it may take."""
    for module in dict.fromkeys(modules_of(value)):
        if is_of_package(module):
            yield code_digest([path_of_method(module)], folder)
        else:
            place = source_of(module)
            foreign = "" if place is None else digest_of((place.name,), place.parent)
            yield code_digest(EVERYTHING, folder) + foreign


def path_of_method(module: str) -> str:
    """The file of a method of ours, or the folder that it has for its steps."""
    _, *names = module.split(".")
    return "/".join(names[:-1]) if len(names) > 2 else "/".join(names) + ".py"


POINTS, SUPERSEDED, THINNED, SHARPENED = "points", "superseded", "thinned", "sharpened"
FLOORS, LARGE, DECKS = "floors", "large", "decks"
GROUND, SIGNS, REGIONS, BUILDINGS = "ground", "signs", "regions", "buildings"
"""Names of the steps whose results are kept; `eaves.flow.step` is their table."""
VISITED, CLASSIFIED = "visited", "classified"
"""Names of what is known by marks like theirs: tiles that are finished, files of classified points."""
UNKEYED = {"keyed": False}
"""Metadata of a field of a data class that decides nothing: it is in no key."""
NAMED, EDITED = "named", "edited"
"""Layers over the buildings found: of those that an update gave their ids and versions, and of those that
edits are of."""


def modules_of(value: Any) -> Iterator[str]:
    """The modules of the classes of a parameter and of what it is made of, where they are of this package or
    those of a method."""
    module = type(value).__module__
    if module.startswith(f"{PACKAGE}.") or isinstance(value, Method):
        yield module
        yield from (cls.__module__ for cls in type(value).__mro__[1:] if issubclass(cls, Method))
        for part in vars(value).values():
            yield from modules_of(part)


@dataclass(frozen=True)
class Mark:
    """The keys of a result.

    Parameters
    ----------
    step : str
        The key of its step: code, system, parameters, reach.
    read : str
        The key of the files that the step reads: where it is found, nothing is loaded.
    taken : str
        The key of what the step takes from them, to the last bit: where it is found, nothing is computed.
    found : str
        The key of the result, which what follows from it reads.
    """

    step: str
    read: str
    taken: str
    found: str


def key_of(*values: Any) -> str:
    """The key of arrays, to the last bit, of geometries, and of plain values, by how they are written."""
    digest = hashlib.sha256()
    for item in values:
        _feed(digest, item)
    return digest.hexdigest()[:DIGITS]


def _feed(digest: hashlib._Hash, value: Any) -> None:
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype.str}{value.shape}".encode())
        digest.update(np.ascontiguousarray(value).reshape(-1).view(np.uint8).data if value.size else b"")
    elif isinstance(value, BaseGeometry):
        digest.update(shapely.to_wkb(value))
    elif is_dataclass(value):
        digest.update(type(value).__name__.encode())
        for field in fields(value):
            if field.metadata != UNKEYED:
                _feed(digest, getattr(value, field.name))
    elif isinstance(value, list | tuple):
        digest.update(f"{len(value)}(".encode())
        for item in value:
            _feed(digest, item)
    elif isinstance(value, Mapping):
        _feed(digest, list(value.items()))
    else:
        digest.update(f"{value!r},".encode())
