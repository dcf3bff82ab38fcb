"""Memory of the processes of a run: its limit, and the frequency of Python's garbage collection."""

from __future__ import annotations

import atexit
import gc
import os
import re
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from eaves.formats import InputError


class Clock:
    """Seconds spent between laps, by name."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.process_time()

    def lap(self, name: str) -> None:
        """Book the processor time (s) since the last lap under `name`."""
        before = self._last
        self.skip()
        self.laps[name] = self.laps.get(name, 0.0) + self._last - before

    def skip(self) -> None:
        """Book the time since the last lap nowhere: others have."""
        self._last = time.process_time()


STEP_OF_STAGE = {"ground": "ground", "rasters": "regions", "detect": "regions"}
"""Stages that a block's clock books, each with its step; the rest of a task is its points read and its part
written."""


class Budget:
    """Time of a region: processor time of all its tasks, wall time of its steps.

    The stages book their own time where they run (`Clock`); the rest of a task is its reading and writing.
    """

    def __init__(self) -> None:
        self.cpu: dict[str, float] = {}
        self.wall: dict[str, float] = {}
        self._last = time.perf_counter()

    def add(self, name: str, seconds: float) -> None:
        """Book processor time (s) of a task under the name of its step."""
        self.cpu[name] = self.cpu.get(name, 0.0) + seconds

    def step(self, name: str) -> None:
        """Book the wall time (s) since the last step under `name`."""
        now = time.perf_counter()
        self.wall[name] = round(self.wall.get(name, 0.0) + now - self._last, 3)
        self._last = now

    def with_stages(self, stages: Mapping[str, float]) -> dict[str, float]:
        """Processor time (s) by stage; `stages` is what was booked inside the tasks."""
        inside = {"ground": 0.0, "regions": 0.0, "buildings": 0.0}
        for name, seconds in stages.items():
            inside[STEP_OF_STAGE.get(name, "buildings")] += seconds
        parts: dict[str, float] = {}
        for name, seconds in self.cpu.items():
            if name not in inside:
                parts[name] = seconds
            else:  # parts kept from an earlier run have stages, and no task of this one
                parts[f"{name}, in and out"] = max(seconds - inside[name], 0.0)
        return {name: round(seconds, 3) for name, seconds in {**stages, **parts}.items()}


LETTERS = " KMGT"
"""Of sizes, each 1024 times the one before."""
LEAST, DENSE = 700_000_000, 20.0
"""Memory of a process: libraries and kernels take half, a block of 240 m at so many points/m² the rest."""
REMEDY = "use fewer --jobs or a larger --memory, and run again with --resume"


def parse_memory(text: str | None) -> int | None:
    """The bytes of `4G`, `500M` or a plain number; None for none.

    Raises
    ------
    InputError
        When it is no size, or one that no process can work with.

    Examples
    --------
    >>> from eaves.run.workers import parse_memory
    >>> parse_memory("2G")
    2147483648
    """
    if not text:
        return None
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([KMGT]?)(?:i?B)?", text.strip(), re.IGNORECASE)
    if match is None:
        raise InputError(f"--memory {text}: not a size; write for example 4G or 1500M")
    size = int(float(match[1]) * 1024 ** LETTERS.index(match[2].upper() or " "))
    if size < LEAST:
        raise InputError(f"--memory {text}: a process needs at least {LEAST // 10**6}M; give more")
    return size


def physical_memory() -> float:
    """The bytes of memory of the machine; NaN where the system does not say."""
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, ValueError, OSError):
        return float("nan")


def share_memory(memory: int | None, jobs: int) -> tuple[int, int | None]:
    """Number of processes that may work, of `jobs` wanted, and the bytes for each."""
    if memory is None:
        return jobs, None
    fitting = max(1, min(jobs, memory // LEAST))
    return fitting, memory // fitting


def limit_memory(size: int | None) -> None:
    """Let this process take no more bytes for its data than `size`, where the system can (not on Windows)."""
    if size is None:
        return
    try:
        import resource
    except ImportError:
        return
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    if hard != resource.RLIM_INFINITY:
        size = min(size, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (size, hard))


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
