"""Keys: what a step takes, and what it finds, as one short word each.

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

from eaves.model import CoordinateSystem
from eaves.run.code import PACKAGE, Sources, package_sources


@dataclass(frozen=True)
class Step:
    """A step whose results are kept: the folder of its results, the module of its function, and the
    parameters of a recipe that it reads."""

    name: str
    module: str
    parameters: tuple[str, ...] = ()

    def key(self, recipe: Any, system: CoordinateSystem, sources: Sources | None = None) -> str:
        """The key of the step's code with that of the methods it is given, of their parameters, and of the
        reference system; `sources` are those of this package unless others are given."""
        values = [getattr(recipe, name) for name in self.parameters]
        modules = [self.module, *(module for value in values for module in modules_of(value))]
        code = (sources or package_sources()).digest(modules)
        return key_of(self.name, code, system, values)


POINTS = Step("points", "eaves.run.partition")
GONE = Step("gone", "eaves.run.replace")
FLOORS = Step("floors", "eaves.blocks.wide")
WIDE = Step("wide", "eaves.blocks.wide", ("ground",))
DECKS = Step("decks", "eaves.blocks.wide")
GROUND = Step("ground", "eaves.blocks.ground", ("ground", "use_classes", "ground_classes"))
BLOCKS = Step(
    "blocks",
    "eaves.blocks.block",
    ("sees_wide", "detect", "use_classes", "vegetation", "others", "keeps_low"),
)
BUILDINGS = Step(
    "buildings",
    "eaves.buildings.owned",
    ("outline", "units", "roof", "reconstruct", "lod", "overhangs", "keeps_low"),
)
NAMED = Step("named", "eaves.change.upkeep.versions")
EDITED = Step("edited", "eaves.change.upkeep.corrected")
"""Layers over the buildings found: of those that an update gave their ids and versions, and of those that
edits are of."""
STEPS = (GONE, FLOORS, WIDE, DECKS, GROUND, BLOCKS, BUILDINGS, NAMED, EDITED)
"""In the order in which they run; ARCHITECTURE.md says of each its unit, inputs and reach."""


def modules_of(value: Any) -> Iterator[str]:
    """The modules of the classes of a parameter and of what it is made of, where they are of this package."""
    module = type(value).__module__
    if module.startswith(f"{PACKAGE}."):
        yield module
        for part in vars(value).values():
            yield from modules_of(part)


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
