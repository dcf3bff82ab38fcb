"""One run at a time in an output folder."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from eaves.formats import InputError

LOCK = ".eaves-lock"


@contextmanager
def lock_folder(folder: Path, name: str = LOCK) -> Iterator[None]:
    """Hold an output folder, which exists, for this process until the block ends.

    The lock is a file that says which process holds it: its id, when it began and on which computer. One that
    was left by a process that is gone is taken over; of another computer that cannot be known, so it stands.

    Parameters
    ----------
    folder
        The output folder.
    name
        The lock file's name.

    Raises
    ------
    InputError
        When another run, or another thread of this one, holds the folder.

    Examples
    --------
    >>> from pathlib import Path
    >>> from eaves.run.lock import lock_folder
    >>> with lock_folder(Path(".")):
    ...     Path(".eaves-lock").exists()
    True
    """
    path, me = folder / name, describe_process()
    while True:
        with path.open("a+", encoding="utf-8") as file, exclusive(file):
            if not is_same_file(file, path):  # its holder has just removed it
                continue
            file.seek(0)
            holder = read_holder(file.read())
            if holder is not None and is_running(holder):
                raise InputError.about(
                    folder,
                    f"process {holder['process']} on {holder['host']} has been writing here since "
                    f"{holder['since']}",
                    f"wait for it, or choose another folder; if it is gone for good, remove {path}",
                )
            file.seek(0)
            file.truncate()
            file.write(json.dumps(me))
            break
    try:
        yield
    finally:
        with suppress(OSError):
            path.unlink()


def describe_process() -> dict[str, Any]:
    """This process: id, when it began, its computer."""
    return {
        "process": os.getpid(),
        "started": process_start(os.getpid()),
        "host": socket.gethostname(),
        "since": time.strftime("%Y-%m-%d %H:%M:%S"),
    }


def read_holder(text: str) -> dict[str, Any] | None:
    """Who a lock file names; None for an empty or a damaged one, which a process left that was killed."""
    try:
        holder = json.loads(text)
    except ValueError:
        return None
    whole = isinstance(holder, dict) and {"process", "started", "host", "since"} <= holder.keys()
    return holder if whole and isinstance(holder["process"], int) else None


def is_running(holder: dict[str, Any]) -> bool:
    """Whether the process is there; one of another computer is taken to be."""
    if holder["host"] != socket.gethostname():
        return True
    started = process_start(holder["process"])
    return started is not None and started == holder["started"]


def process_start(process: int) -> str | None:
    """When a process of this computer began, in the system's own words; None when it is not there."""
    if process <= 0:
        return None
    if sys.platform == "win32":
        return start_on_windows(process)
    try:
        text = Path(f"/proc/{process}/stat").read_text(encoding="utf-8", errors="replace")
        fields = text.rpartition(")")[2].split()
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
        return None if fields[0] == "Z" else f"{boot} {fields[19]}"
    except OSError:
        if Path("/proc/self/stat").exists():
            return None
    shown = subprocess.run(  # macOS and the BSDs
        ["/bin/ps", "-o", "lstart=", "-p", str(process)], capture_output=True, text=True, check=False
    )
    return shown.stdout.strip() or None


def start_on_windows(process: int) -> str | None:
    """As `start_of`, by the Windows API; `os.kill` would end the process there."""
    import ctypes

    kernel: Any = getattr(ctypes, "windll").kernel32  # noqa: B009 (only there)
    handle = kernel.OpenProcess(0x1000, False, process)  # PROCESS_QUERY_LIMITED_INFORMATION
    if not handle:
        return None
    times, code = (ctypes.c_ulonglong * 4)(), ctypes.c_ulong()
    size = ctypes.sizeof(ctypes.c_ulonglong)
    places = [ctypes.byref(times, size * k) for k in range(4)]
    known = kernel.GetProcessTimes(handle, *places) and kernel.GetExitCodeProcess(handle, ctypes.byref(code))
    kernel.CloseHandle(handle)
    return str(times[0]) if known and code.value == 259 else None  # STILL_ACTIVE


def is_same_file(file: IO[str], path: Path) -> bool:
    """Whether a path still leads to an open file."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), os.stat(path))
    except FileNotFoundError:
        return False


@contextmanager
def exclusive(file: IO[str]) -> Iterator[None]:
    """The system's own lock of an open file while its holder is looked at, where there is one."""
    with suppress(OSError, ImportError):
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(file.fileno(), msvcrt.LK_LOCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX)
    yield
