"""Frequency of Python's garbage collection, in processes of our own."""

from __future__ import annotations

import atexit
import gc
from collections.abc import Iterator
from contextlib import contextmanager

NEW_OBJECTS = 20_000
"""New objects after which Python looks for garbage in cycles: 700, its own number, are those of one import,
and a tenth of a small run went into looking."""


def collect_rarely() -> None:
    """Look for garbage rarely, and not once more as the process ends: all that is left goes with it."""
    gc.set_threshold(NEW_OBJECTS)
    atexit.register(gc.freeze)


@contextmanager
def keep_all() -> Iterator[None]:
    """Look for no garbage while modules are imported, and never at what they made: it stays."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
