"""Who computes: this process, several processes, or a Dask cluster. The results are the same."""

from __future__ import annotations

import logging
import multiprocessing
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any, TypeVar

log = logging.getLogger("eaves")
Task = TypeVar("Task")


@dataclass(frozen=True)
class Outcome:
    """How a task ended: its answer, or the one-line reason for none, and the peak memory of its process."""

    index: int
    answer: Any = None
    error: str | None = None
    peak_mb: float = 0.0


def peak_memory_mb() -> float:
    """The largest memory this process has held (MB); 0 where the system does not tell (Windows)."""
    try:
        import resource
    except ImportError:
        return 0.0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak / 1e3


def attempt(work: Callable[[Task], Any], index: int, task: Task) -> Outcome:
    """Do one task; an error of its own becomes part of the outcome, so the others go on."""
    try:
        return Outcome(index, work(task), peak_mb=peak_memory_mb())
    except Exception as error:
        log.debug("task %d failed", index, exc_info=True)
        return Outcome(index, error=f"{type(error).__name__}: {error}", peak_mb=peak_memory_mb())


def run(
    work: Callable[[Task], Any], tasks: Sequence[Task], jobs: int = 1, scheduler: str | None = None
) -> Iterator[Outcome]:
    """Outcomes of `work(task)` for every task, as they are ready; `work` must write its own part."""
    if scheduler is not None:
        yield from run_on_dask(work, tasks, scheduler)
    elif jobs > 1 and len(tasks) > 1:
        yield from run_in_processes(work, tasks, min(jobs, len(tasks)))
    else:
        for index, task in enumerate(tasks):
            yield attempt(work, index, task)


def run_in_processes(work: Callable[[Task], Any], tasks: Sequence[Task], jobs: int) -> Iterator[Outcome]:
    """As `run`, in `jobs` processes.

    Tasks lost when a process dies are tried again, in the end each on its own, so that the one that kills
    its process is the only one to fail.
    """
    left = dict(enumerate(tasks))
    together = jobs
    while left:
        before = len(left)
        batches = [left] if together > 1 else [{index: task} for index, task in left.items()]
        for batch in [dict(batch) for batch in batches]:
            for outcome in run_batch(work, batch, together):
                left.pop(outcome.index)
                yield outcome
            if together == 1:
                for index in batch.keys() & left.keys():
                    left.pop(index)
                    yield Outcome(index, error="its process was killed, also when tried alone")
        if left:
            log.warning("a worker process was killed; %d lost tasks are tried again", len(left))
            together = together if len(left) < before else 1


def run_batch(work: Callable[[Task], Any], batch: dict[int, Task], jobs: int) -> Iterator[Outcome]:
    """Outcomes of the tasks (by number) that a pool of `jobs` processes ends before one of them dies."""
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=ignore_interrupt)
    try:
        futures = [pool.submit(attempt, work, index, task) for index, task in batch.items()]
        for future in as_completed(futures):
            try:
                yield future.result()
            except BrokenProcessPool:
                continue
    except BaseException:  # Ctrl-C, or the caller wants no more: do not wait for what is under way
        for process in multiprocessing.active_children():
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def ignore_interrupt() -> None:
    """Leave Ctrl-C to the process that started this one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def run_on_dask(work: Callable[[Task], Any], tasks: Sequence[Task], scheduler: str) -> Iterator[Outcome]:
    """As `run`, on the workers of a running Dask scheduler (`tcp://host:port`) with the same file system."""
    try:
        from distributed import Client
        from distributed import as_completed as completed
    except ImportError:
        raise ValueError("--scheduler needs the cluster extra; pip install 'eaves[cluster]'") from None
    with Client(scheduler) as client:
        futures = [client.submit(attempt, work, index, task, pure=False) for index, task in enumerate(tasks)]
        number = {future.key: index for index, future in enumerate(futures)}
        for future in completed(futures):
            if future.status == "finished":
                yield future.result()
            else:
                yield Outcome(number[future.key], error=f"the cluster lost it: {future.exception()}")
