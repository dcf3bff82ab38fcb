"""Keys: what a step takes, and what it finds, as one short word each.

A result is named by the key of all that its step takes, parameters and the version of the package included.
Where that is found again, the step is not run: that is all there is to resuming a run and to updating one.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from importlib.metadata import version
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry


@dataclass(frozen=True)
class Step:
    """A step whose results are kept: the folder of its results, and the parameters of a recipe that it
    reads."""

    name: str
    parameters: tuple[str, ...] = ()

    def key(self, recipe: Any) -> str:
        """The key of the step with the parameters of a recipe, in this version of the package."""
        return key_of(version("eaves"), self.name, *(getattr(recipe, name) for name in self.parameters))


GONE = Step("gone")
FLOORS = Step("floors")
WIDE = Step("wide", ("ground",))
DECKS = Step("decks")
GROUND = Step("ground", ("ground", "use_classes", "ground_classes"))
BLOCKS = Step("blocks", ("sees_wide", "detect", "use_classes", "vegetation", "others", "keeps_low"))
BUILDINGS = Step("buildings", ("outline", "units", "roof", "reconstruct", "lod", "overhangs"))
NAMED, EDITED = Step("named"), Step("edited")
"""Layers over the buildings found: of those that an update gave their ids and versions, and of those that
edits are of."""
STEPS = (GONE, FLOORS, WIDE, DECKS, GROUND, BLOCKS, BUILDINGS, NAMED, EDITED)
"""In the order in which they run; ARCHITECTURE.md says of each its unit, inputs and reach."""


@dataclass(frozen=True)
class Mark:
    """The inputs that a result follows from, and its kind.

    `read` is the key of the files that its step reads: where it is found, nothing is loaded. `taken` is the
    key of what the step took from them, to the last bit: where it is found, nothing is computed. `found` is
    the key of the result, which what follows from it reads.
    """

    read: str
    taken: str
    found: str


DIGITS = 32
"""Of a key; processors have SHA-256 built in, so that it is faster than any other of Python's hashes."""


def key_of(*taken: Any) -> str:
    """The key of arrays, to the last bit, of geometries, and of plain values, by how they are written."""
    whole = hashlib.sha256()
    for one in taken:
        _feed(whole, one)
    return whole.hexdigest()[:DIGITS]


def _feed(whole: hashlib._Hash, one: Any) -> None:
    if isinstance(one, np.ndarray):
        whole.update(f"{one.dtype.str}{one.shape}".encode())
        whole.update(np.ascontiguousarray(one).reshape(-1).view(np.uint8).data if one.size else b"")
    elif isinstance(one, BaseGeometry):
        whole.update(shapely.to_wkb(one))
    elif is_dataclass(one):
        whole.update(type(one).__name__.encode())
        for field in fields(one):
            _feed(whole, getattr(one, field.name))
    elif isinstance(one, list | tuple):
        whole.update(f"{len(one)}(".encode())
        for item in one:
            _feed(whole, item)
    elif isinstance(one, Mapping):
        _feed(whole, list(one.items()))
    else:
        whole.update(f"{one!r},".encode())
