"""Files appear whole or not at all: written beside, then renamed."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from eaves.formats.errors import InputError


@contextmanager
def atomic(path: str | Path) -> Iterator[Path]:
    """A temporary path in the same folder, with the same suffixes; renamed to `path` on leaving, removed
    on error.

    Raises
    ------
    InputError
        When the folder cannot be made or written.
    """
    target = Path(path)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        # A folder of its own: drivers put side files (journals, .aux) beside the file they write.
        workplace = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.parent))
    except OSError as error:
        raise InputError.about(
            target, f"the folder cannot be written ({error.strerror})", "choose another output folder"
        ) from None
    temporary = workplace / target.name
    try:
        yield temporary
        os.replace(temporary, target)
    finally:
        for leftover in workplace.iterdir():
            leftover.unlink(missing_ok=True)
        workplace.rmdir()
