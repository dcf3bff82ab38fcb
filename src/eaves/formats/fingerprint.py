"""Fingerprint that tells if a file is unchanged, without reading all of it."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import BinaryIO

from eaves.formats.errors import InputError

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
