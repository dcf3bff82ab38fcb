"""Who computes: this process, several processes, or a Dask cluster. The results are the same."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import sys
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from multiprocessing.connection import Connection
from pathlib import Path
from queue import SimpleQueue
from types import ModuleType
from typing import Any, Self, TypeVar

import numpy

from eaves.formats.errors import INSTALL
from eaves.formats.whole_files import is_full
from eaves.kernels import say_first_use
from eaves.model.checks import error_line
from eaves.run.memory import REMEDY, collect_rarely, limit_memory, share_memory

log = logging.getLogger("eaves")
Task = TypeVar("Task")
AHEAD = 4
"""Maximum number of tasks that wait for each worker."""
PROCESS_STATUS, PROCESS_SCORE = Path("/proc/self/status"), Path("/proc/self/oom_score_adj")
ABSENT, ROTATIONS = ("pandas", "geopandas", "pyarrow"), "scipy.spatial.transform"
PARTS_OF_NUMPY = ("f2py", "testing", "ma", "polynomial")
"""What is not imported with the libraries (`import_libraries_alone`)."""
FEW = 64
"""Tasks for each worker, of which the largest go first."""
KILLED = "its process was killed"


@dataclass(frozen=True)
class Outcome:
    """Outcome of a task: its answer, or the one-line reason for none, and the peak memory of its process."""

    index: int
    answer: Any = None
    error: str | None = None
    full: bool = False
    """True if the error was a full disk."""
    peak_mb: float = 0.0
    cpu: float = 0.0
    """Processor time (s) it took."""


def peak_memory_mb() -> float:
    """The largest memory this process has held (MB); 0 where the system does not tell (Windows)."""
    try:
        status = PROCESS_STATUS.read_text(encoding="ascii")
        return int(status.split("VmHWM:")[1].split()[0]) * 1024 / 1e6
    except (OSError, IndexError):
        pass  # not Linux; there getrusage would count what the caller held when it started this process
    try:
        import resource
    except ImportError:
        return 0.0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6


def attempt(work: Callable[[Task], Any], index: int, task: Task) -> Outcome:
    """Do one task; an error of its own becomes part of the outcome, so the others go on."""
    before = time.process_time()
    try:
        result = work(task)
        return Outcome(index, result, peak_mb=peak_memory_mb(), cpu=time.process_time() - before)
    except Exception as error:
        if is_interrupt(error):
            raise KeyboardInterrupt from None
        log.debug("task %d failed", index, exc_info=True)
        reason = error_line(error)
        if isinstance(error, MemoryError):
            reason = f"memory ran out ({error or 'the system gave no more'}); {REMEDY}"
        return Outcome(index, error=reason, full=is_full(error), peak_mb=peak_memory_mb())


def is_interrupt(error: BaseException | None) -> bool:
    """True if an error was caused by Ctrl-C: a compiled kernel returns it as one of its own."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def take(todo: deque[int]) -> int | None:
    """The first of some numbers, which is none of them from then on; None where none is left."""
    try:
        return todo.popleft()
    except IndexError:
        return None


class Workers:
    """Who computes in a run; a context manager, for processes and connections last from stage to stage.

    Parameters
    ----------
    jobs
        Processes, of which this one is the first.
    scheduler
        Address of a running Dask scheduler (`tcp://host:port`) whose workers share the file system; it goes
        before `jobs`.
    memory
        Bytes for all processes together: each gets its share, and there are fewer of them where a share would
        be too small. This process then leaves all work to others, also when `jobs` is 1.
    """

    def __init__(self, jobs: int = 1, scheduler: str | None = None, memory: int | None = None) -> None:
        (self.jobs, self._share), self.scheduler = share_memory(memory, jobs), scheduler
        self._pool: ProcessPoolExecutor | None = None
        self._line: Connection | None = None
        """Write end of the pipe that the processes watch: they exit when it closes."""
        self._broken = set[ProcessPoolExecutor]()
        self._client: Any = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        if self._client is not None:
            self._client.close()
        self._stop()

    @property
    def alone(self) -> bool:
        """True if this process does all the work."""
        return self.scheduler is None and self.jobs < 2 and self._share is None

    @property
    def width(self) -> int:
        """Number of tasks that are computed at a time."""
        return max(self.jobs, 1) if self.scheduler is None else max(self._threads(), 1)

    def start(self, work: Callable[[], Any]) -> None:
        """Start the processes, if there are to be some, with work that makes them import what they need."""
        if self.scheduler is None and not self.started:
            for _ in range(self._beside):
                self._processes().submit(work)

    def heaviest_first(self, tasks: Sequence[Task], weight: Callable[[Task], float]) -> list[Task]:
        """The tasks in the order in which several processes end together; in their own when they are many,
        for neighbours read the same files."""
        if self.alone or len(tasks) > FEW * max(self.jobs, 1):
            return list(tasks)
        return sorted(tasks, key=weight, reverse=True)

    @property
    def started(self) -> bool:
        """True if there are processes that wait for work."""
        return self._pool is not None

    def run(self, work: Callable[[Task], Any], tasks: Sequence[Task]) -> Iterator[Outcome]:
        """Outcomes of `work(task)` for every task, as they are ready; `work` must write its own part."""
        if self.scheduler is not None and tasks:
            yield from self._run_on_dask(work, tasks)
        elif self._share is not None or (self.jobs > 1 and len(tasks) > 1):
            yield from self._run_in_processes(work, tasks)
        else:
            for index, task in enumerate(tasks):
                yield attempt(work, index, task)

    def _run_in_processes(self, work: Callable[[Task], Any], tasks: Sequence[Task]) -> Iterator[Outcome]:
        """As `run`, in processes, of which this one is one; not where memory is limited.

        One task waits for each process while many are left: this one may be too busy to hand it out. Tasks
        lost when a process dies are tried again, each on its own, so that the one that kills its process is
        the only one to fail. One that kills this process ends the run.
        """
        todo, lost = deque(range(len(tasks))), list[int]()
        outcomes: SimpleQueue[Outcome] = SimpleQueue()
        driven: ProcessPoolExecutor | None = None

        def drive(pool: ProcessPoolExecutor, spare: int) -> None:
            while pool not in self._broken and len(todo) > spare and (index := take(todo)) is not None:
                outcomes.put(self._compute(pool, work, index, tasks[index]))

        try:
            for _ in tasks:
                pool = self._processes()
                for spare in (0, AHEAD * self.jobs) * self._beside if pool is not driven else ():
                    threading.Thread(target=drive, args=(pool, spare), daemon=True).start()
                driven = pool
                chosen = take(todo) if self._share is None and outcomes.empty() else None
                outcome = outcomes.get() if chosen is None else attempt(work, chosen, tasks[chosen])
                if outcome.error == KILLED:
                    lost.append(outcome.index)
                else:
                    yield outcome
            if lost:
                log.warning("a worker process was killed; %d lost tasks are tried again", len(lost))
            for index in lost:
                outcome = self._compute(self._processes(), work, index, tasks[index])
                if outcome.error == KILLED:
                    reason = f"{KILLED}, also when tried alone: memory may be short; {REMEDY}"
                    outcome = Outcome(index, error=reason)
                yield outcome
        except BaseException:  # Ctrl-C, an error, or a caller that stops iterating
            todo.clear()
            self._stop()
            raise

    def _compute(
        self, pool: ProcessPoolExecutor, work: Callable[[Task], Any], index: int, task: Task
    ) -> Outcome:
        """The outcome of a task in a process; `KILLED` where one of them died meanwhile, and all with it."""
        try:
            return pool.submit(attempt, work, index, task).result()
        except BrokenProcessPool:
            self._broken.add(pool)
            return Outcome(index, error=KILLED)
        except Exception as error:  # it could not be sent
            return Outcome(index, error=f"{type(error).__name__}: {error}")

    def _run_on_dask(self, work: Callable[[Task], Any], tasks: Sequence[Task]) -> Iterator[Outcome]:
        """As `run`, on the workers of the Dask scheduler."""
        threads = self._threads()
        from distributed import as_completed as completed

        number: dict[str, int] = {}
        waiting = iter(range(len(tasks)))

        def submit(count: int) -> list[Any]:
            futures = []
            for index in islice(waiting, count):
                futures.append(self._client.submit(attempt, work, index, tasks[index], pure=False))
                number[futures[-1].key] = index
            return futures

        stream = completed(submit(max(AHEAD * threads, FEW)))  # workers may still be coming
        for future in stream:
            if future.status == "finished":
                yield future.result()
            else:
                yield Outcome(number[future.key], error=f"the cluster lost it: {future.exception()}")
            stream.update(submit(1))

    def _threads(self) -> int:
        """Number of threads of the Dask scheduler's workers."""
        try:
            from distributed import Client
        except ImportError:
            raise ValueError(f"--scheduler needs the cluster extra; {INSTALL.format('cluster')}") from None
        if self._client is None:
            self._client = Client(self.scheduler)
        return sum(self._client.nthreads().values())

    @property
    def _beside(self) -> int:
        """Number of processes beside this one."""
        return self.jobs - (self._share is None)

    def _processes(self) -> ProcessPoolExecutor:
        """The processes beside this one, new ones where one of them died."""
        if self._pool is None or self._pool in self._broken:
            self._stop()
            say_first_use()  # before each of them compiles for itself
            line, self._line = multiprocessing.Pipe(duplex=False)
            arguments = line, self._share
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(self._beside, context, begin_worker, arguments)
        return self._pool

    def _stop(self) -> None:
        """End the processes, whatever they are at."""
        if self._pool is not None and self._line is not None:
            self._line.close()
            self._pool.shutdown()
            self._pool = None


def begin_worker(line: Connection, memory: int | None = None) -> None:
    """Leave Ctrl-C to the process that started this one, end with its end of the line, keep to `memory`."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    warnings.simplefilter("ignore")  # remarks of libraries, which nobody could read among other processes'
    with suppress(OSError):  # not Linux, which ends such processes first when memory runs out
        PROCESS_SCORE.write_text("500", encoding="ascii")
    limit_memory(memory)
    collect_rarely()
    import_libraries_alone()
    threading.Thread(target=end_with, args=(line,), daemon=True).start()


def end_with(line: Connection) -> None:
    """End this process where the other end of a line is closed."""
    with suppress(EOFError, OSError):
        line.recv()
    os._exit(1)


def import_libraries_alone() -> None:
    """Import pyogrio without the data frames it would offer, and scipy without what comes with a copy of all
    of numpy (a translator of Fortran, judges of tests, masked arrays) and without rotations: pandas and
    geopandas cost most of a second, the others .15.

    For processes of our own only, before any is imported: a caller's process may want them later.
    """
    instead: dict[str, Any] = {**dict.fromkeys(ABSENT), ROTATIONS: ModuleType(ROTATIONS)}
    hidden = {name: module for name, module in instead.items() if name not in sys.modules}
    parts = [name for name in PARTS_OF_NUMPY if f"numpy.{name}" not in sys.modules]
    sys.modules.update(hidden)
    vars(numpy).update(dict.fromkeys(parts))
    try:
        import pyogrio.raw  # noqa: F401
        import scipy.ndimage
        import scipy.spatial
    finally:
        for name in hidden:
            del sys.modules[name]
        for name in parts:  # numpy looks for it where it is asked for
            if vars(numpy)[name] is None:
                del vars(numpy)[name]
    if ROTATIONS in hidden:
        vars(scipy.spatial).pop("transform", None)
