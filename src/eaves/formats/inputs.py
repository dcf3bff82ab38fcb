"""Which point files are meant by files, folders and globs."""

from __future__ import annotations

import glob
from collections.abc import Sequence
from pathlib import Path

from eaves.formats.errors import InputError

LAS_SUFFIXES = (".las", ".laz")
TEXT_SUFFIXES = (".txt", ".xyz", ".csv", ".asc")


def find_inputs(paths: str | Path | Sequence[str | Path]) -> list[Path]:
    """The point files that files, folders and globs name, each once, sorted.

    A folder gives its LAS, LAZ and COPC files, or its text files when it has none of them.

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
    found: dict[Path, Path] = {}
    for given in [paths] if isinstance(paths, str | Path) else paths:
        path = Path(given)
        if path.is_dir():
            names = sorted(entry for entry in path.iterdir() if entry.is_file() and entry.name[0] != ".")
            files = [name for name in names if name.suffix.lower() in LAS_SUFFIXES]
            files = files or [name for name in names if name.suffix.lower() in TEXT_SUFFIXES]
        elif path.exists():
            files = [path]
        else:
            files = [Path(name) for name in glob.glob(str(given), recursive=True) if Path(name).is_file()]
        if not files:
            rule = "has no point files" if path.is_dir() else "does not exist"
            raise InputError.about(
                given, rule, "give a LAS, LAZ, COPC or text file, a folder of them, or a glob"
            )
        found.update((file.resolve(), file) for file in files)
    if not found:
        raise InputError("no input given; give a LAS, LAZ, COPC or text file, a folder of them, or a glob")
    return sorted(found.values(), key=lambda file: str(file.resolve()))
