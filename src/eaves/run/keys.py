"""Keys: all that a result follows from, as one short word.

A result is named by the key of all that its step takes: its code, the reference system, parameters and
inputs. Where that is found again, the step is not run: that is all there is to resuming a run and to updating
one.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from eaves.methods import Method
from eaves.run.code import DIGITS, PACKAGE

SUPERSEDED, FLOORS, LARGE, DECKS, GROUND = "superseded", "floors", "large", "decks", "ground"
REGIONS, BUILDINGS = "regions", "buildings"
"""Names of the steps whose results are kept; `eaves.flow.steps` is their table."""
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


def key_of(*taken: Any) -> str:
    """The key of arrays, to the last bit, of geometries, and of plain values, by how they are written."""
    digest = hashlib.sha256()
    for item in taken:
        _feed(digest, item)
    return digest.hexdigest()[:DIGITS]


def _feed(digest: hashlib._Hash, one: Any) -> None:
    if isinstance(one, np.ndarray):
        digest.update(f"{one.dtype.str}{one.shape}".encode())
        digest.update(np.ascontiguousarray(one).reshape(-1).view(np.uint8).data if one.size else b"")
    elif isinstance(one, BaseGeometry):
        digest.update(shapely.to_wkb(one))
    elif is_dataclass(one):
        digest.update(type(one).__name__.encode())
        for field in fields(one):
            _feed(digest, getattr(one, field.name))
    elif isinstance(one, list | tuple):
        digest.update(f"{len(one)}(".encode())
        for item in one:
            _feed(digest, item)
    elif isinstance(one, Mapping):
        _feed(digest, list(one.items()))
    else:
        digest.update(f"{one!r},".encode())
