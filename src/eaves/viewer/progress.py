"""Progress of long work: bars on a terminal, plain lines in a log."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Tell = Callable[[str, int, int], None]
SECONDS_BETWEEN_LINES = 10.0


@contextmanager
def nothing() -> Iterator[Tell]:
    """Hears progress and says nothing."""
    yield lambda stage, done, total: None


@contextmanager
def lines() -> Iterator[Tell]:
    """A plain line to standard error at the end of each stage, and every ten seconds between."""
    last = time.monotonic()

    def tell(stage: str, done: int, total: int) -> None:
        nonlocal last
        now = time.monotonic()
        if done >= total or now - last > SECONDS_BETWEEN_LINES:
            last = now
            sys.stderr.write(f"{stage}: {done:,} of {total:,}\n")
            sys.stderr.flush()

    yield tell


@contextmanager
def bars() -> Iterator[Tell]:
    """A bar a stage, drawn by rich on standard error."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TaskID,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (TextColumn("{task.description:>10}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True)) as display:
        tasks: dict[str, TaskID] = {}

        def tell(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = display.add_task(stage, total=total)
            display.update(tasks[stage], completed=done, total=total)

        yield tell
