"""Progress of long work: bars on a terminal, plain lines in a log; in a first run from the sources, which
compiles what a wheel brings compiled, also that of compiling."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from eaves.kernels import compiled_pieces

Show = Callable[[str, int, int], None]
SECONDS_BETWEEN_LINES = 10.0
SHARES = {"points": 0.08, "ground": 0.2, "regions": 0.25, "buildings": 0.4, "write": 0.07}
"""Usual share of each stage in the time of a run; of a run by tiles `TILE_SHARES`, of one that classifies the
ground alone `GROUND_SHARES`."""
GROUND_SHARES = {"points": 0.19, "ground": 0.55, "regions": 0.08, "write": 0.18}
LEAST_SHARE_COMPILING = 0.9
"""A first run compiles in its early steps, so only its end can be foreseen."""
UNITS = {
    "compiling": " loops",
    "points": " parts of files",
    "ground": " blocks",
    "buildings": " blocks",
    "write": " kinds of file",
}
LEAST_SHARE, LEAST_S = 0.1, 3.0
"""Before so much of a run, or so many seconds, the time that is left is guesswork: loading and reading, which
cost the same whatever comes, have been most of it."""
TILE_SHARES = {"tiles": 0.93, "write": 0.07}

LOOPS = 145
"""Compiled loops that the default methods call with the sorts of arguments of most data: about that many."""
POLL_S = 5.0


class Remaining:
    """Time that a whole run will still take, from the shares of its stages and the time it took so far."""

    def __init__(self, compiling: bool = False, shares: Mapping[str, float] = SHARES) -> None:
        self._shares = shares
        self._least = LEAST_SHARE_COMPILING if compiling else LEAST_SHARE
        self._started = time.monotonic()
        self._done: dict[str, float] = {}

    def after(self, stage: str, done: int, total: int) -> float | None:
        """Seconds left when so much of a stage is done; None while that is guesswork."""
        shares = TILE_SHARES if "tiles" in (stage, *self._done) else self._shares
        for earlier in list(shares)[: list(shares).index(stage)] if stage in shares else ():
            self._done[earlier] = 1.0
        self._done[stage] = done / total if total else 1.0
        share = sum(part * self._done.get(name, 0.0) for name, part in shares.items())
        passed = time.monotonic() - self._started
        return passed * (1.0 - share) / share if share > self._least and passed > LEAST_S else None


def in_words(seconds: float | None) -> str:
    """`, about 3 min left`; nothing for None."""
    if seconds is None:
        return ""
    for unit, length in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 1.5 * length:
            return f", about {seconds / length:.0f} {unit} left"
    return f", about {max(seconds, 1.0):.0f} s left"


@contextmanager
def nothing() -> Iterator[Show]:
    """Shows nothing."""
    yield lambda stage, done, total: None


@contextmanager
def lines(compiling: bool = False, shares: Mapping[str, float] = SHARES) -> Iterator[Show]:
    """A plain line to standard error at the end of each stage, and every ten seconds between."""
    last, remaining = time.monotonic(), Remaining(compiling, shares)

    def show(stage: str, done: int, total: int) -> None:
        nonlocal last
        now = time.monotonic()
        if done >= total or now - last > SECONDS_BETWEEN_LINES:
            last = now
            left = in_words(remaining.after(stage, done, total))
            unit = UNITS.get(stage, "")
            about = "about " if stage == "compiling" else ""
            sys.stderr.write(f"{stage}: {done:,} of {about}{total:,}{unit}{left}\n")
            sys.stderr.flush()

    yield show


@contextmanager
def bars(compiling: bool = False, shares: Mapping[str, float] = SHARES) -> Iterator[Show]:
    """A bar a stage, drawn by rich on standard error."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn

    columns = (
        TextColumn("{task.description:>10}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[left]}"),
    )
    remaining = Remaining(compiling, shares)
    with Progress(*columns, console=Console(stderr=True)) as display:
        tasks: dict[str, TaskID] = {}

        def show(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = display.add_task(stage, total=total, left="")
            left = in_words(remaining.after(stage, done, total)).removeprefix(", ")
            display.update(tasks[stage], completed=done, total=total, left="" if done >= total else left)

        yield show


@contextmanager
def compilation_shown(wanted: bool, show: Callable[[str, int, int], None]) -> Iterator[None]:
    """If it is wanted, progress shows how many loops are compiled."""
    ended = threading.Event()

    def watch() -> None:
        while not ended.wait(POLL_S) and (done := compiled_pieces()) < LOOPS:
            if done:  # else a clone makes its library, which is there at once
                show("compiling", done, LOOPS)

    watcher = threading.Thread(target=watch, daemon=True)
    if wanted:
        watcher.start()
    try:
        yield
    finally:
        ended.set()
