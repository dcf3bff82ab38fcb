"""Files written whole or not at all, and what a full disk looks like."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from glob import escape
from pathlib import Path

from eaves.formats.errors import InputError


@contextmanager
def atomic(path: str | Path, forced: bool = True) -> Iterator[Path]:
    """A temporary path in the same folder, with the same suffixes; renamed to `path` on leaving, removed
    on error. What bears the name is on the disk: a computer that loses its power leaves no file half-filled,
    but for those that are not `forced` there, which whoever reads them after that must check.

    Raises
    ------
    InputError
        When the folder cannot be made or written.
    """
    target = Path(path)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        # A folder of its own: drivers put side files (journals, .aux) beside the file they write.
        workplace = Path(tempfile.mkdtemp(prefix=f".{target.name}."[:SHORT], dir=target.parent))
    except OSError as error:
        raise InputError.about(
            target, f"the folder cannot be written ({error.strerror})", "choose another output folder"
        ) from None
    temporary = workplace / target.name
    try:
        yield temporary
        show_file(temporary, target) if forced else os.replace(temporary, target)
    finally:
        for leftover in workplace.iterdir():
            leftover.unlink(missing_ok=True)
        workplace.rmdir()


def clear_leftovers(files: Iterable[Path]) -> None:
    """Remove what processes that were killed have left of these files in the making."""
    for path in files:
        for place in path.parent.glob(f"{escape(f'.{path.name}.'[:SHORT])}*"):
            shutil.rmtree(place, ignore_errors=True)


SHORT = 200
"""A name may have 255 bytes; that of the folder beside a file has eight more."""


def show_file(hidden: Path, target: Path) -> None:
    """Bring a whole file to the disk and give it its name. Whoever has opened the file before goes on reading
    what it was.

    Raises
    ------
    InputError
        When it is a database that another program is changing.
    """
    with hidden.open("rb+") as file:
        os.fsync(file.fileno())
    for suffix in ("-wal", "-shm"):  # of a database: whoever holds the old one would spoil the new one
        beside = target.with_name(f"{target.name}{suffix}")
        if suffix == "-wal" and beside.exists() and beside.stat().st_size:
            raise InputError.about(
                target, "is being edited in another program", "close it there, and run again"
            )
        beside.unlink(missing_ok=True)
    os.replace(hidden, target)
    with suppress(OSError):  # Windows opens no folders; there the name is kept with the file
        folder = os.open(target.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


NUMBERS = (errno.ENOSPC, errno.EFBIG, getattr(errno, "EDQUOT", errno.ENOSPC))
"""No space left, file too large for the disk or the limit, quota used up."""
PHRASES = (
    *("no space left", "disk is full", "disk full", "write error", "writeerror", "disk quota exceeded"),
    "failed to call write",
)
"""Messages of GDAL, SQLite and lazrs, which give no error number."""


class DiskFullError(OSError):
    """The disk is full. Its text is one line with the place and the remedy."""


def is_full(error: BaseException | None) -> bool:
    """True if an error, or the one that caused it, means that the disk is full."""
    while error is not None:
        if isinstance(error, DiskFullError) or getattr(error, "errno", None) in NUMBERS:
            return True
        if not isinstance(error, ValueError) and any(phrase in str(error).lower() for phrase in PHRASES):
            return True
        error = error.__cause__ or error.__context__
    return False


@contextmanager
def report_full_disk(folder: Path) -> Iterator[None]:
    """Turn any error that means a full disk into one DiskFullError about `folder`."""
    try:
        yield
    except Exception as error:
        if not is_full(error):
            raise
        raise DiskFullError(
            f"{folder}: the disk is full; nothing is half-written: free space and run again with --resume"
        ) from None
