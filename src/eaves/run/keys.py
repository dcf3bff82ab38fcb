"""Keys: all that a result follows from, as one short word.

A result is named by the key of all that its step takes: its code, the reference system, parameters and
inputs. Where that is found again, the step is not run: that is all there is to resuming a run and to updating
one.

The code of a step is a digest of the source of every module that it can run. Comments, docstrings, formatting
and imports for types alone change nothing, for they change no result. The digest of a module is kept beside
its bytecode by the SHA-256 of its file, so that a run reads the sources and parses none.
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from eaves.formats.whole_files import atomic
from eaves.methods import Method

PACKAGE = "eaves"
DIGITS = 32
"""Of a digest or a key; processors have SHA-256 built in, so that it is faster than any other of Python's
hashes."""


class Source(NamedTuple):
    """A module's file, its syntax and its imports.

    Parameters
    ----------
    file : str
        SHA-256 of the file.
    syntax : str
        Digest of the syntax tree, without docstrings.
    imports : sequence of str
        The modules of the package that it imports, also late ones.
    """

    file: str
    syntax: str
    imports: Sequence[str]


class Sources:
    """The modules of this package and of those that bring methods, with what each imports of its own package
    and of this one.

    Parameters
    ----------
    folder : Path
        The folder of this package.
    table : Path or None
        File that keeps the digests from run to run; None keeps them in memory alone.

    Examples
    --------
    >>> from eaves.run.keys import package_sources
    >>> package_sources().digest(["eaves.kernels"]) == package_sources().digest(["eaves.methods"])
    False
    """

    def __init__(self, folder: Path, table: Path | None = None) -> None:
        self.folder, self.table = folder, table
        self._kept = read_table(table)
        self._read: dict[str, Source | None] = {}
        self._digests: dict[tuple[str, ...], str] = {}

    def digest(self, modules: Iterable[str]) -> str:
        """The digest of modules and of all that they import, directly or not.

        Parameters
        ----------
        modules : iterable of str
            Their names.

        Returns
        -------
        str
            A word of `DIGITS` hexadecimal digits.
        """
        names = tuple(modules)
        if names not in self._digests or not all(map(is_of_package, names)):
            syntax = hashlib.sha256()
            for name in sorted(self.closure(names)):
                source = self.source(name)
                syntax.update(f"{name} {'' if source is None else source.syntax}\n".encode())
            self._digests[names] = syntax.hexdigest()[:DIGITS]
        return self._digests[names]

    def closure(self, modules: Iterable[str]) -> set[str]:
        """The names of modules and of all that they import, directly or not."""
        reached, waiting = set[str](), list(modules)
        while waiting:
            name = waiting.pop()
            source = None if name in reached else self.source(name)
            reached.add(name)
            waiting += () if source is None else source.imports
        self._save()
        return reached

    def source(self, name: str) -> Source | None:
        """A module as its file stands; None where it has no source. Files of other packages may change while
        a process goes on."""
        if name not in self._read or not is_of_package(name):
            path = self.path(name)
            self._read[name] = None if path is None else self._parsed(name, path)
        return self._read[name]

    def _parsed(self, name: str, path: str) -> Source:
        """The source in a file, from the table where that is of the same file."""
        with open(path, "rb") as stream:
            content = stream.read()
        file = hashlib.sha256(content).hexdigest()
        if name in self._kept and self._kept[name][0] == file:
            return Source(*self._kept[name])
        tree = effective_syntax(content)
        syntax = hashlib.sha256(ast.dump(tree, annotate_fields=False).encode()).hexdigest()
        return Source(file, syntax[:DIGITS], sorted(set(self.imports(tree, name, path))))

    def path(self, name: str) -> str | None:
        """The file of a module; None where there is none."""
        place = self.place(name)
        paths = os.path.join(place, "__init__.py"), f"{place}.py"
        return next((path for path in paths if os.path.isfile(path)), None)

    def place(self, name: str) -> str:
        """The path of a module without its suffix, as that of its package is imported, if it is."""
        package, *path = name.split(".")
        if package == PACKAGE:
            return os.path.join(self.folder, *path)
        module = sys.modules.get(package)
        folders = list(getattr(module, "__path__", ()))
        top = folders[0] if folders else os.path.splitext(getattr(module, "__file__", None) or "")[0]
        return os.path.join(top, *path)

    def imports(self, tree: ast.AST, module: str, path: str) -> Iterator[str]:
        """The modules of this package and of the module's own that are imported anywhere in its tree, and
        those of the names that it takes from this package by a dot."""
        followed = (f"{PACKAGE}.", f"{module.split('.')[0]}.")
        parents = module.split(".") if path.endswith("__init__.py") else module.split(".")[:-1]
        called = set[str]()
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                called |= {alias.asname or PACKAGE for alias in node.names if alias.name == PACKAGE}
                yield from (alias.name for alias in node.names if f"{alias.name}.".startswith(followed))
            elif isinstance(node, ast.ImportFrom):
                above = parents[: len(parents) + 1 - node.level] if node.level else []
                package = ".".join([*above, *([node.module] if node.module else [])])
                if f"{package}.".startswith(followed):
                    yield from (self.origin(package, alias.name) for alias in node.names)
        for node in ast.walk(tree) if called else ():
            if isinstance(node, ast.Attribute) and getattr(node.value, "id", None) in called:
                yield self.origin(PACKAGE, node.attr)

    def origin(self, package: str, name: str) -> str:
        """The module that an imported name is of: itself, that which a stub says, or the one it is from."""
        if self.path(f"{package}.{name}") is not None:
            return f"{package}.{name}"
        stub = Path(self.place(package), "__init__.pyi")
        if stub.exists():  # its names are loaded when they are first used
            for node in ast.parse(stub.read_bytes()).body:
                if isinstance(node, ast.ImportFrom) and name in [alias.name for alias in node.names]:
                    return f"{package}.{node.module}" if node.level else str(node.module)
        return package

    def _save(self) -> None:
        sources = {name: list(source) for name, source in self._read.items() if source is not None}
        table = {**self._kept, **sources}
        if self.table is None or table == self._kept:
            return
        self._kept = table
        with suppress(OSError):  # a package that only others may write: its sources are parsed again
            self.table.parent.mkdir(exist_ok=True)
            with atomic(self.table) as temporary:
                temporary.write_text(json.dumps(table), encoding="utf-8")


def is_of_package(name: str) -> bool:
    """True if a module is of this package, by its name."""
    return name.partition(".")[0] == PACKAGE


@cache
def package_sources() -> Sources:
    """The sources of this package, read once a process."""
    folder = Path(__file__).parents[1]
    return Sources(folder, folder / "__pycache__" / f"code.{sys.implementation.cache_tag}.json")


def read_table(path: Path | None) -> dict[str, list[Any]]:
    """The sources that a table keeps, by name; none where it cannot be read."""
    try:
        table = {} if path is None else json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return table if isinstance(table, dict) else {}


def effective_syntax(content: bytes) -> ast.Module:
    """The syntax tree of a module without what no result follows from: docstrings and imports for types."""
    tree = ast.parse(content)
    for node in ast.walk(tree):
        for name in ("body", "orelse", "finalbody"):
            statements = getattr(node, name, None)
            if isinstance(statements, list):
                setattr(node, name, [statement for statement in statements if is_effective(statement)])
    return tree


def is_effective(statement: ast.stmt) -> bool:
    """True if a statement is neither a lone string nor a branch for type checkers."""
    if isinstance(statement, ast.Expr):
        return not (isinstance(statement.value, ast.Constant) and isinstance(statement.value.value, str))
    return not (
        isinstance(statement, ast.If)
        and isinstance(statement.test, ast.Name)
        and statement.test.id == "TYPE_CHECKING"
    )


SUPERSEDED, THINNED, SHARPENED = "superseded", "thinned", "sharpened"
FLOORS, LARGE, DECKS = "floors", "large", "decks"
GROUND, SIGNS, REGIONS, BUILDINGS = "ground", "signs", "regions", "buildings"
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
            _feed(digest, getattr(value, field.name))
    elif isinstance(value, list | tuple):
        digest.update(f"{len(value)}(".encode())
        for item in value:
            _feed(digest, item)
    elif isinstance(value, Mapping):
        _feed(digest, list(value.items()))
    else:
        digest.update(f"{value!r},".encode())
