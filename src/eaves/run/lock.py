"""One run at a time in an output folder."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from getpass import getuser
from pathlib import Path
from platform import node

from filelock import FileLock, Timeout

from eaves.formats import InputError

LOCK = ".eaves-lock"


@contextmanager
def lock_folder(folder: Path, name: str = LOCK) -> Iterator[None]:
    """Hold an output folder, which exists, for this process until the block ends.

    The system holds the lock and frees it with the process, however that ends: a file that a killed run left
    is no lock.

    Parameters
    ----------
    folder
        The output folder.
    name
        The lock file's name.

    Raises
    ------
    InputError
        When another run, or another thread of this one, holds the folder.

    Examples
    --------
    >>> from pathlib import Path
    >>> from eaves.run.lock import lock_folder
    >>> with lock_folder(Path(".")):
    ...     Path(".eaves-lock").exists()
    True
    """
    lock, note = FileLock(folder / name, timeout=0), folder / f"{name}-by"
    try:
        lock.acquire()
    except Timeout:
        by = ""
        with suppress(OSError):
            by = f" ({note.read_text(encoding='utf-8')})"
        raise InputError.about(
            folder,
            f"another run is writing here and holds {name}{by}",
            "wait for it, or choose another folder",
        ) from None
    try:
        with suppress(OSError, KeyError):  # a system may not know who we are
            since = f"{datetime.now():%H:%M}"
            note.write_text(
                f"{getuser()} on {node()}, process {os.getpid()}, since {since}", encoding="utf-8"
            )
        yield
    finally:
        with suppress(OSError):  # while it is held, so that no other run has just taken it
            note.unlink()
            (folder / name).unlink()
        lock.release()
