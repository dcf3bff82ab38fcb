"""One short mark of all that a step takes: where it is as it was, so is what the step finds."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np


def mark_of(*taken: Any) -> str:
    """The mark of arrays, to the last bit, and of plain values, by how they are written; None is one."""
    whole = hashlib.blake2b(digest_size=16)
    for one in taken:
        if isinstance(one, np.ndarray):
            whole.update(f"{one.dtype.str}{one.shape}".encode())
            whole.update(np.ascontiguousarray(one).view(np.uint8).data if one.size else b"")
        else:
            whole.update(repr(one).encode())
    return whole.hexdigest()
