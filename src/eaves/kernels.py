"""Kernels: loops that are compiled, ahead of time where the package brings them so, else when first called.

The library `eaves.compiled` holds a function for each kernel and each sort of arguments, made from these
kernels by `packaging/kernels.py`. A function is used only if its fingerprint is that of the kernel as it
stands; any other call is compiled by numba, once a machine.
"""

from __future__ import annotations

import functools
import hashlib
import logging
import os
from collections.abc import Callable
from multiprocessing import parent_process
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import numpy as np

log = logging.getLogger("eaves.kernels")

FIRST_USE = "first use: loops are compiled once for this machine, a minute or two"
CONTIGUOUS, FORTRAN, ALIGNED, WRITEABLE = 0x1, 0x2, 0x100, 0x400
"""The flags of an array (`numpy.ndarray.flags.num`) that decide which code fits it."""
SCALARS = {float: "float", int: "int", bool: "bool", np.float64: "float", np.int64: "int", np.bool_: "bool"}
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
        table = library()
        entry = table.get(f"{self.name}({', '.join(map(sort_of, args))})") if table else None
        if entry is not None and entry[0] == self.fingerprint:
            return entry[1]
        say_first_use()
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
        """A digest of the code with all that it names: other kernels, constants."""
        digest = hashlib.sha256()
        add_code(digest, self.py_func.__code__, self.py_func.__globals__, {self.name})
        return digest.hexdigest()[:16]


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


@functools.cache
def say_first_use() -> None:
    """Say once, in the first of a run's processes, that loops are compiled, where none are yet."""
    if parent_process() is None and is_first_use():
        log.warning(FIRST_USE)


def is_first_use() -> bool:
    """True if the package brings no compiled loops, and numba keeps none."""
    return not library() and not compiled_pieces()


def compiled_pieces() -> int:
    """The number of loops that numba keeps compiled for eaves: none before the first run."""
    place = os.environ.get("NUMBA_CACHE_DIR") or Path(__file__).parent
    return sum(1 for _ in Path(place).rglob("*.nbc"))


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


def add_code(digest: Any, code: CodeType, names: dict[str, Any], visited: set[str]) -> None:
    """Add code, the functions within it and the values of the global names it uses, each kernel once."""
    digest.update(code.co_code)
    digest.update(repr((code.co_names, code.co_varnames)).encode())
    for place, constant in enumerate(code.co_consts):
        if place == 0 and isinstance(constant, str):
            continue  # the docstring
        if isinstance(constant, CodeType):
            add_code(digest, constant, names, visited)
        else:
            digest.update(repr(constant).encode())
    for name in code.co_names:
        value = names.get(name)
        if isinstance(value, Kernel):
            if value.name not in visited:
                visited.add(value.name)
                add_code(digest, value.py_func.__code__, value.py_func.__globals__, visited)
        elif isinstance(value, np.ndarray):
            digest.update(value.tobytes())
        elif value is not None and not isinstance(value, ModuleType):
            digest.update(getattr(value, "__qualname__", repr(value)).encode())
