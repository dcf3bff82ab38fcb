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
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from itertools import islice
from multiprocessing.connection import wait as wait_for_end
from pathlib import Path
from typing import Any, Self, TypeVar

from eaves.formats.atomic import is_full
from eaves.run.garbage import collect_rarely
from eaves.run.memory import REMEDY, limit_memory, share_memory

log = logging.getLogger("eaves")
Task = TypeVar("Task")
AHEAD = 4
"""Tasks that wait for each worker."""
PROCESS_STATUS = Path("/proc/self/status")
FEW = 64
"""Tasks for each worker, of which the largest go first."""


@dataclass(frozen=True)
class Outcome:
    """How a task ended: its answer, or the one-line reason for none, and the peak memory of its process."""

    index: int
    answer: Any = None
    error: str | None = None
    full: bool = False
    """Whether the error was a full disk."""
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
        answer = work(task)
        return Outcome(index, answer, peak_mb=peak_memory_mb(), cpu=time.process_time() - before)
    except Exception as error:
        if is_interrupt(error):
            raise KeyboardInterrupt from None
        log.debug("task %d failed", index, exc_info=True)
        reason = f"{type(error).__name__}: {error}"
        if isinstance(error, MemoryError):
            reason = f"memory ran out ({error or 'the system gave no more'}); {REMEDY}"
        return Outcome(index, error=reason, full=is_full(error), peak_mb=peak_memory_mb())


def is_interrupt(error: BaseException | None) -> bool:
    """Whether Ctrl-C is what caused an error: a compiled kernel returns it as one of its own."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


class Workers:
    """Who computes in a run; a context manager, for processes and connections last from stage to stage.

    Parameters
    ----------
    jobs
        Processes; with 1 this process does it all.
    scheduler
        Address of a running Dask scheduler (`tcp://host:port`) whose workers share the file system; it goes
        before `jobs`.
    memory
        Bytes for all processes together: each gets its share, and there are fewer of them where a share would
        be too small. This process then leaves the work to one of them also when `jobs` is 1.
    """

    def __init__(self, jobs: int = 1, scheduler: str | None = None, memory: int | None = None) -> None:
        (self.jobs, self._share), self.scheduler = share_memory(memory, jobs), scheduler
        self._pool: ProcessPoolExecutor | None = None
        self._client: Any = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        if self._client is not None:
            self._client.close()
        if kind is not None:  # Ctrl-C, or an error: do not wait for what is under way
            self._stop_processes()
        self._drop_pool()

    @property
    def alone(self) -> bool:
        """Whether this process does all the work."""
        return self.scheduler is None and self.jobs < 2 and self._share is None

    def start(self, work: Callable[[], Any]) -> None:
        """Start the processes, if there are to be some, with work that makes them import what they need."""
        if self.scheduler is None and not self.alone and self._pool is None:
            pool = self._processes()
            for _ in range(self.jobs):
                pool.submit(work)

    def heaviest_first(self, tasks: Sequence[Task], weight: Callable[[Task], int]) -> list[Task]:
        """The tasks in the order in which several processes end together; in their own when they are many,
        for neighbours read the same files."""
        if self.alone or len(tasks) > FEW * max(self.jobs, 1):
            return list(tasks)
        return sorted(tasks, key=weight, reverse=True)

    @property
    def started(self) -> bool:
        """Whether there are processes that wait for work."""
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
        """As `run`, in processes.

        Tasks lost when a process dies are tried again, in the end each on its own, so that the one that
        kills its process is the only one to fail.
        """
        left = set(range(len(tasks)))
        together = True
        while left:
            before = len(left)
            for batch in [sorted(left)] if together else [[index] for index in sorted(left)]:
                for outcome in self._run_batch(work, tasks, batch):
                    left.discard(outcome.index)
                    yield outcome
                if not together and batch[0] in left:
                    left.discard(batch[0])
                    reason = f"its process was killed, also when tried alone: memory may be short; {REMEDY}"
                    yield Outcome(batch[0], error=reason)
            if left:
                log.warning("a worker process was killed; %d lost tasks are tried again", len(left))
                together = together and len(left) < before

    def _run_batch(
        self, work: Callable[[Task], Any], tasks: Sequence[Task], batch: list[int]
    ) -> Iterator[Outcome]:
        """Outcomes of the tasks (by number) that the processes end before one of them dies.

        Few tasks wait in the pool at a time: a country has more of them than memory should hold.
        """
        pool = self._processes()
        waiting, broken = iter(batch), False
        running: set[Future[Outcome]] = set()
        try:
            while True:
                while not broken and len(running) < AHEAD * self.jobs:
                    index = next(waiting, None)
                    if index is None:
                        break
                    try:
                        running.add(pool.submit(attempt, work, index, tasks[index]))
                    except BrokenProcessPool:
                        broken = True
                if not running:
                    return
                done, running = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    try:
                        yield future.result()
                    except BrokenProcessPool:
                        broken = True
        except BaseException:  # the caller wants no more
            self._stop_processes()
            self._drop_pool()
            raise
        finally:
            if broken:
                self._drop_pool()

    def _run_on_dask(self, work: Callable[[Task], Any], tasks: Sequence[Task]) -> Iterator[Outcome]:
        """As `run`, on the workers of the Dask scheduler."""
        try:
            from distributed import Client
            from distributed import as_completed as completed
        except ImportError:
            raise ValueError("--scheduler needs the cluster extra; pip install 'eaves[cluster]'") from None
        if self._client is None:
            self._client = Client(self.scheduler)
        threads = sum(self._client.nthreads().values())
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

    def _processes(self) -> ProcessPoolExecutor:
        if self._pool is None:
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(
                self.jobs, mp_context=context, initializer=begin_worker, initargs=(self._share,)
            )
        return self._pool

    def _stop_processes(self) -> None:
        for process in list((getattr(self._pool, "_processes", None) or {}).values()):
            process.terminate()

    def _drop_pool(self) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
        self._pool = None


def begin_worker(memory: int | None = None) -> None:
    """Leave Ctrl-C to the process that started this one, end when it does, and keep to `memory`."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=end_after, args=(parent.sentinel,), daemon=True).start()
    warnings.simplefilter("ignore")  # remarks of libraries, which nobody could read among other processes'
    limit_memory(memory)
    collect_rarely()
    import_pyogrio_alone()


def end_after(sentinel: int) -> None:
    """Wait for another process to end, and end this one."""
    wait_for_end([sentinel])
    os._exit(1)


def import_pyogrio_alone() -> None:
    """Import pyogrio without the data frames it would offer: pandas and geopandas cost most of a second.

    For processes of our own only: a caller's process may want pyogrio's data frames later.
    """
    hidden = [name for name in ("pandas", "geopandas", "pyarrow") if name not in sys.modules]
    sys.modules.update(dict.fromkeys(hidden))  # type: ignore[arg-type]
    try:
        import pyogrio.raw  # noqa: F401
    finally:
        for name in hidden:
            del sys.modules[name]
