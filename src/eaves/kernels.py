"""Kernels: loops that are compiled, ahead of time where the package brings them so, else when first called.

The library `eaves.compiled` holds a function for each kernel and each sort of arguments, in C made from these
kernels by `packaging/kernels.py`. A function is used only if its fingerprint is that of the kernel as it
stands; any other call is compiled by numba, once a machine. Where nothing is compiled yet, a clone makes its
library, if there is a C compiler; else numba compiles all calls of `kernels.txt`, by as many processes as
there are cores; lists of satellites are for the library alone.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import linecache
import logging
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import parent_process
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

log = logging.getLogger("eaves.kernels")

FIRST_USE = "first use: loops are compiled once for this machine: seconds with a C compiler, else minutes"
CONTIGUOUS, FORTRAN, ALIGNED, WRITEABLE = 0x1, 0x2, 0x100, 0x400
"""The flags of an array (`numpy.ndarray.flags.num`) that decide which code fits it."""
SCALARS = {float: "float", int: "int", bool: "bool", np.float64: "float", np.int64: "int", np.bool_: "bool"}
NUMBERS = {"float": "float64", "int": "int64", "bool": "boolean", "float32": "float32"}
"""Sort of a number → numba's name of it."""
HOME = Path(__file__).parent
MAKER = HOME.parents[1] / "packaging" / "kernels.py"
"""What makes the library, in a clone."""
LIST = HOME / "kernels.txt"
"""The calls of kernels that runs of the core make, as `packaging/kernels.py --run` notes them."""
KERNELS: list[Kernel] = []
"""Every kernel of the modules imported so far."""


class Kernel:
    """A function of arrays and numbers, compiled for each sort of arguments it is called with."""

    def __init__(self, function: Callable[..., Any], inline: bool) -> None:
        functools.update_wrapper(self, function)
        self.py_func = function
        self.targetoptions = {"inline": "always" if inline else "never"}
        self.ready: dict[Any, Callable[..., Any]] = {}
        KERNELS.append(self)

    def __call__(self, *args: Any) -> Any:
        key = tuple(
            [
                (a.dtype, a.ndim, a.flags.num)
                if (kind := type(a)) is np.ndarray
                else (raw_sort(a) if isinstance(a, tuple) else kind)
                for a in args
            ]
        )
        try:
            run = self.ready[key]
        except KeyError:
            run = self.ready[key] = self.find(args)
        return run(*args)

    @property
    def name(self) -> str:
        """Module and name."""
        return f"{self.py_func.__module__}.{self.py_func.__qualname__}"

    def find(self, args: tuple[Any, ...]) -> Callable[..., Any]:
        """The compiled function for such arguments: the package's, if it has a fitting one, else numba's."""
        say_first_use()
        call = f"{self.name}({', '.join(map(sort_of, args))})"
        entries = library()
        if call not in entries:
            near = (one for one in entries if one.startswith(f"{self.name}(") and fits(call, one))
            call = next(near, call)
        if call in entries and entries[call][0] == self.fingerprint:
            return entries[call][1]
        by_numba: Callable[..., Any] = self.dispatcher
        return by_numba

    @functools.cached_property
    def dispatcher(self) -> Any:
        """The kernel as numba compiles it."""
        from numba import njit

        return njit(cache=True, **self.targetoptions)(self.py_func)

    @property
    def _numba_type_(self) -> Any:
        """The type that numba gives it where another kernel calls it."""
        return self.dispatcher._numba_type_

    @functools.cached_property
    def fingerprint(self) -> str:
        """A digest of the source with all that it names: other kernels, constants; that of any Python."""
        digest = hashlib.sha256()
        add_source(digest, self.py_func, {self.name})
        return digest.hexdigest()[:16]

    @functools.cached_property
    def weight(self) -> int:
        """What it costs to compile, about: the length of its code and of that of the kernels it calls."""
        code, names = self.py_func.__code__, self.py_func.__globals__
        callees = {name: names.get(name) for name in code.co_names}
        return len(code.co_code) + sum(one.weight for one in callees.values() if isinstance(one, Kernel))


def kernel(function: Callable[..., Any]) -> Any:
    """A function as a kernel; a decorator."""
    return Kernel(function, inline=False)


def inlined_kernel(function: Callable[..., Any]) -> Any:
    """A function as a kernel that is written out wherever another calls it; a decorator."""
    return Kernel(function, inline=True)


def raw_sort(value: Any) -> Any:
    """A key that differs between arguments of different sorts."""
    if type(value) is np.ndarray:
        return value.dtype, value.ndim, value.flags.num
    return (type(value), *map(raw_sort, value)) if isinstance(value, tuple) else type(value)


def sort_of(value: Any) -> str:
    """The sort of an argument: its type; of an array `<f8[2C]`: type, dimensions, order, `r` if read only."""
    if type(value) is np.ndarray:
        flags = value.flags.num
        order = "C" if flags & CONTIGUOUS else "F" if flags & FORTRAN else "A"
        read_only, unaligned = "" if flags & WRITEABLE else "r", "" if flags & ALIGNED else "u"
        return f"{value.dtype.str}[{value.ndim}{order}{read_only}{unaligned}]"
    if isinstance(value, tuple):
        kind = "" if type(value) is tuple else f"{type(value).__module__}.{type(value).__qualname__}"
        return f"{kind}({', '.join(map(sort_of, value))})"
    return SCALARS.get(type(value), type(value).__name__)


def fits(call: str, listed: str) -> bool:
    """True if the code of a listed call does for a call: what takes an array of any order, or an unaligned
    one, takes the others."""
    wider = re.sub(r"\\\[(\d)A(u?)\\\]", r"\\[\1[CFA]\2?\\]", re.escape(listed))
    return re.fullmatch(wider, call) is not None


@functools.cache
def say_first_use() -> None:
    """Say once, in the first of a run's processes, that loops are compiled, where none are yet, and compile
    those listed."""
    if parent_process() is None and is_first_use():
        log.warning(FIRST_USE)
        compile_listed()


def is_first_use() -> bool:
    """True if the package brings no compiled loops, and numba keeps none."""
    return not library() and not compiled_pieces()


def compiled_pieces() -> int:
    """The number of loops that numba keeps compiled for eaves: none before the first run."""
    return sum(1 for _ in cache_folder().rglob("*.nbc"))


def cache_folder() -> Path:
    """The folder in which numba keeps compiled loops."""
    return Path(os.environ.get("NUMBA_CACHE_DIR") or HOME)


def compile_listed() -> None:
    """Make the library, or else compile the core's calls by a process for each core, unless there are some;
    what another process does so is waited for. Where neither can be kept, nothing is done."""
    from filelock import FileLock

    cores = os.cpu_count() or 1
    within_another = not Path(sys.executable).stem.startswith(
        "python"
    )  # which would be started, in its place
    with suppress(OSError), FileLock(cache_folder() / ".compiling"):
        library.cache_clear()
        if not is_first_use() or within_another or make_library() or cores == 1:
            return
        code = "from eaves.kernels import compile_share; compile_share({}, {})"
        started = [
            subprocess.Popen([sys.executable, "-c", code.format(share, cores)]) for share in range(cores)
        ]
        try:
            for process in started:
                process.wait()
        finally:
            for process in started:
                process.kill()


def make_library() -> bool:
    """True if a clone's library could be made, which a machine without a C compiler cannot."""
    if not MAKER.exists() or not shutil.which(os.environ.get("CC", "cc").split()[0]):
        return False
    made = subprocess.run([sys.executable, MAKER, "--quick", HOME], capture_output=True, text=True)
    log.debug("the library of kernels: %s%s", made.stdout, made.stderr)
    if made.returncode:
        log.warning("the C compiler failed, so loops are compiled by numba: minutes; see --verbose")
    importlib.invalidate_caches()
    library.cache_clear()
    return bool(library())


def compile_share(share: int, shares: int) -> None:
    """Compile a share of the core's calls: the dearest kernels are dealt out first, with all their calls. Who
    started this process ends it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    calls: dict[str, list[str]] = {}
    for call in listed_calls(LIST):
        calls.setdefault(call.partition("(")[0], []).append(call)
    loads = [0.0] * shares
    for name in sorted(calls, key=lambda name: -named(name).weight * len(calls[name])):
        lightest = loads.index(min(loads))
        loads[lightest] += named(name).weight * len(calls[name])
        if lightest == share:
            for call in calls[name]:
                named(name).dispatcher.compile(signature(call))


def listed_calls(*lists: Path) -> list[str]:
    """The calls of some lists, `module.kernel(sorts of arguments)`, in order."""
    return sorted(call for path in lists for call in path.read_text("utf-8").splitlines())


def named(name: str) -> Any:
    """What a module holds under a name, `module.name`."""
    module, _, name = name.rpartition(".")
    return getattr(importlib.import_module(module), name)


def signature(call: str) -> tuple[Any, ...]:
    """The numba types of the arguments of a listed call."""
    return tuple(map(type_of, words_of(call[:-1].split("(", 1)[1])))


def words_of(sorts: str) -> list[str]:
    """The sorts of a list of them, `<f8[2C], int, (int, int)`."""
    return re.findall(r"[^,\s(]*\([^)]*\)|[^,\s(]+", sorts)


def type_of(sort: str) -> Any:
    """The numba type of a sort that `sort_of` names."""
    from numba.core import types
    from numba.np.numpy_support import from_dtype

    if array := re.fullmatch(r"(\S+)\[(\d)([CFA])(r?)(u?)\]", sort):
        dtype, dimensions, order, read_only, unaligned = array.groups()
        kind: Any = order  # of the letters that numba allows
        return types.Array(
            from_dtype(np.dtype(dtype)), int(dimensions), kind, bool(read_only), aligned=not unaligned
        )
    if sort.endswith(")"):
        tuple_of, words = sort[:-1].split("(", 1)
        members = [type_of(word) for word in words_of(words)]
        return types.BaseTuple.from_types(  # type: ignore[attr-defined]  # which its stubs lack
            members, named(tuple_of) if tuple_of else None
        )
    return getattr(types, NUMBERS[sort])


@functools.cache
def library() -> dict[str, tuple[str, Callable[..., Any]]]:
    """Kernel and sorts of arguments → fingerprint and compiled function; empty where there is no library."""
    try:
        from eaves import compiled  # type: ignore[attr-defined]  # which wheels bring, and sources do not
    except ImportError:
        return {}
    table = {}
    for name, function in vars(compiled).items():
        call, mark, fingerprint = name.partition("#")
        if mark:
            table[call] = fingerprint, function
    return table


def add_source(digest: Any, function: Callable[..., Any], visited: set[str]) -> None:
    """Add the lines of a function and the values of the global names it uses, each kernel once."""
    code, names = function.__code__, function.__globals__
    lines = linecache.getlines(code.co_filename)
    last = max(line for *_, line in code.co_lines() if line)
    while last < len(lines) and lines[last].startswith(" "):
        last += 1
    digest.update("".join(lines[code.co_firstlineno - 1 : last]).encode())
    for name in sorted(code.co_names):
        value = names.get(name)
        if isinstance(value, Kernel):
            if value.name not in visited:
                visited.add(value.name)
                add_source(digest, value.py_func, visited)
        elif isinstance(value, np.ndarray | np.generic):
            digest.update(value.tobytes())
        elif value is not None and not isinstance(value, ModuleType):
            digest.update(getattr(value, "__qualname__", repr(value)).encode())
