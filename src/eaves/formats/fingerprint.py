"""Whether a file is unchanged, without reading all of it."""

from __future__ import annotations

import hashlib
import os
from typing import BinaryIO

SAMPLED_BYTES = 1 << 16
"""Of a longer file the first and last so many bytes are hashed: header and first points, and the chunk table,
whose compressed sizes change with any point. Hashing a country whole would read it once more."""


def fingerprint(file: BinaryIO) -> bytes:
    """16 bytes that change with an open file's size, time of change, beginning or end."""
    state = os.fstat(file.fileno())
    digest = hashlib.sha256(f"{state.st_size} {state.st_mtime_ns}".encode())
    file.seek(0)
    digest.update(file.read(SAMPLED_BYTES))
    if state.st_size > 2 * SAMPLED_BYTES:
        file.seek(-SAMPLED_BYTES, 2)
    digest.update(file.read(SAMPLED_BYTES))
    return digest.digest()[:16]
