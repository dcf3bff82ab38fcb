"""Point files that files, folders and globs stand for."""

from __future__ import annotations

import glob
import hashlib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

from eaves.formats.errors import InputError

LAS_SUFFIXES = (".las", ".laz")
TEXT_SUFFIXES = (".txt", ".xyz", ".csv", ".asc")
RASTERS = (".tif", ".tiff")
"""Suffixes of the rasters that are read as points."""

REMEDY = "give a LAS, LAZ, COPC or text file, a folder of them, a glob, an address or a .vpc list"


def find_inputs(paths: str | Path | Sequence[str | Path]) -> list[Path]:
    """The point files that files, folders and globs name, each once, sorted.

    A folder gives its LAS, LAZ and COPC files, or its text files when it has none of them.

    Parameters
    ----------
    paths : str, Path or sequence of them
        Files, folders or globs.

    Returns
    -------
    list of Path
        At least one file.

    Raises
    ------
    InputError
        For a path that gives no file.

    Examples
    --------
    >>> from pathlib import Path
    >>> from eaves.formats import find_inputs
    >>> Path("tile.laz").touch()
    >>> [path.name for path in find_inputs("*.laz")]
    ['tile.laz']
    """
    return [Path(path) for path in list_inputs(paths)]


def is_raster(path: str | Path) -> bool:
    """True if a file is read as a raster of heights, by its suffix."""
    return Path(path).suffix.lower() in RASTERS


def list_inputs(paths: str | Path | Sequence[str | Path]) -> list[str]:
    """The answer of `find_inputs` as text: of a million paths a quarter of the memory and of the time."""
    found: dict[str, str] = {}
    for given in [paths] if isinstance(paths, str | Path) else paths:
        if not str(given):
            raise InputError(f"the name of an input is empty; {REMEDY}")
        path = str(Path(given))
        if os.path.isdir(path):
            files = files_in(path)
        elif os.path.isfile(path):
            files = [(os.path.realpath(path), path)]
        elif os.path.exists(path):
            raise InputError.about(path, "is a pipe or a device", "save its points in a file")
        else:
            names = filter(os.path.isfile, glob.iglob(str(given), recursive=True))
            files = [(os.path.realpath(name), str(Path(name))) for name in names]
        if not files:
            rule = "has no point files" if os.path.isdir(path) else "does not exist"
            rule = "matches no file" if glob.has_magic(str(given)) else rule
            raise InputError.about(given, rule, REMEDY)
        found.update(files)
    if not found:
        raise InputError(f"no input given; {REMEDY}")
    return [found[real] for real in sorted(found)]


def files_in(folder: str) -> list[tuple[str, str]]:
    """The LAS files of a folder, or else its text files, each with its true path before the one given.

    Raises
    ------
    InputError
        When the folder cannot be listed.
    """
    by_kind: dict[tuple[str, ...], list[tuple[str, str]]] = {LAS_SUFFIXES: [], TEXT_SUFFIXES: []}
    real, shown = os.path.realpath(folder), "" if folder == "." else folder
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                suffix = os.path.splitext(entry.name)[1].lower()
                kind = next((kind for kind in by_kind if suffix in kind), None)
                if kind is None or entry.name[0] == "." or not entry.is_file():
                    continue
                plain = os.path.join(real, entry.name)
                true = os.path.realpath(plain) if entry.is_symlink() else plain
                by_kind[kind].append((true, plain if real == shown else os.path.join(shown, entry.name)))
    except OSError as error:
        raise InputError.about(
            folder, f"cannot be listed ({error.strerror})", "check the path and its permissions"
        ) from None
    return by_kind[LAS_SUFFIXES] or by_kind[TEXT_SUFFIXES]


def is_classified(name: str) -> bool:
    """True if a file of a run holds its classified points; copies as COPC are derived from it."""
    return name.startswith("classified") and name.endswith((".laz", ".las")) and ".copc." not in name


SAMPLED_BYTES = 1 << 16
"""Of a longer file the first and last so many bytes are hashed: header and first points, and the chunk table,
whose compressed sizes change with any point. Hashing a country whole would read it once more."""


def fingerprint(file: BinaryIO) -> bytes:
    """16 bytes that change with an open file's size, times of change, beginning or end.

    The time of the contents can be set back by whoever edits them, the file system's own (`st_ctime`) cannot.
    """
    state = os.fstat(file.fileno())
    digest = hashlib.sha256(f"{state.st_size} {state.st_mtime_ns} {state.st_ctime_ns}".encode())
    file.seek(0)
    digest.update(file.read(SAMPLED_BYTES))
    if state.st_size > 2 * SAMPLED_BYTES:
        file.seek(-SAMPLED_BYTES, 2)
    digest.update(file.read(SAMPLED_BYTES))
    return digest.digest()[:16]


def refuse_change(path: Path, mark: bytes) -> None:
    """Refuse a file that no longer has the fingerprint it had.

    Raises
    ------
    InputError
        When it has another one, or is gone.
    """
    try:
        with path.open("rb") as file:
            same = fingerprint(file) == mark
    except OSError:
        same = False
    if not same:
        raise InputError.about(path, "changed while the run was reading it", "run again")
