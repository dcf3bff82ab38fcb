"""The first run from the sources compiles what a wheel brings compiled."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

LOOPS = 104
"""Compiled loops that the default methods call with the sorts of arguments of most data: about that many."""
POLL_S = 5.0


def compiled_pieces() -> int:
    """The number of loops that numba keeps compiled for eaves: none before the first run."""
    import eaves

    place = os.environ.get("NUMBA_CACHE_DIR") or Path(eaves.__file__).parent
    return sum(1 for _ in Path(place).rglob("*.nbc"))


@contextmanager
def compilation_shown(wanted: bool, show: Callable[[str, int, int], None]) -> Iterator[None]:
    """If it is wanted, progress shows how many loops are compiled."""
    ended = threading.Event()

    def watch() -> None:
        while not ended.wait(POLL_S) and (done := compiled_pieces()) < LOOPS:
            show("compiling", done, LOOPS)

    watcher = threading.Thread(target=watch, daemon=True)
    if wanted:
        watcher.start()
    try:
        yield
    finally:
        ended.set()
