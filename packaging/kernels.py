"""The library of kernels, `eaves.compiled`, for the wheel of this machine's Python: needs a C compiler.

    python packaging/kernels.py FOLDER      make it there; `src/eaves` gives a clone its own
    python packaging/kernels.py --run ...   a command of eaves; what it calls is added to kernels.txt

`kernels.txt` lists what is compiled: kernels with the sorts of arguments that runs call them with. What is
not there runs too, compiled by numba when it is first called.
"""

from __future__ import annotations

import importlib
import os
import platform
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

LIST = Path(__file__).parent / "kernels.txt"
BASELINE = {"x86_64": "x86-64-v2", "AMD64": "x86-64-v2"}
"""Machine → the processor compiled for: what numpy asks for; elsewhere the plainest of its kind."""
NUMBERS = {"float": "float64", "int": "int64", "bool": "boolean", "float32": "float32"}
"""Sort of a number (`eaves.kernels.SCALARS`) → numba's name of it."""


def make_library(folder: Path) -> Path:
    """Compile every call of the list into one extension module in a folder; its file."""
    cpu = BASELINE.get(platform.machine(), "")
    with tempfile.TemporaryDirectory() as cache:
        os.environ["NUMBA_CACHE_DIR"] = cache
        if cpu:
            os.environ |= {"NUMBA_CPU_NAME": cpu, "NUMBA_CPU_FEATURES": "+sse4.2"}
        from numba.pycc import CC, compiler

        compile_extra = compiler.compile_extra
        # an inlined kernel changes the flags, which numba shares between the functions of a module
        compiler.compile_extra = lambda *words, **more: compile_extra(*words[:5], words[5].copy(), **more)
        module = CC("compiled")
        module.target_cpu = cpu
        module.output_dir = str(folder)
        for call in LIST.read_text("utf-8").splitlines():
            name, words = call[:-1].split("(", 1)
            kernel = named(name)
            module.export(f"{call}#{kernel.fingerprint}", tuple(map(type_of, split(words))))(kernel.py_func)
        module.compile()
    return folder / module.output_file


def named(name: str) -> Any:
    """What a module holds under a name, `module.name`."""
    module, _, name = name.rpartition(".")
    return getattr(importlib.import_module(module), name)


def split(words: str) -> list[str]:
    """The sorts of a list of them, `<f8[2C], int, (int, int)`."""
    return re.findall(r"[^,\s(]*\([^)]*\)|[^,\s(]+", words)


def type_of(sort: str) -> Any:
    """The numba type of a sort that `eaves.kernels.sort_of` names."""
    import numpy as np
    from numba.core import types
    from numba.np.numpy_support import from_dtype

    if array := re.fullmatch(r"(\S+)\[(\d)([CFA])(r?)(u?)\]", sort):
        dtype, dimensions, order, read_only, unaligned = array.groups()
        return types.Array(
            from_dtype(np.dtype(dtype)), int(dimensions), order, bool(read_only), aligned=not unaligned
        )
    if sort.endswith(")"):
        kind, words = sort[:-1].split("(", 1)
        members = [type_of(word) for word in split(words)]
        return types.BaseTuple.from_types(members, named(kind) if kind else None)
    return getattr(types, NUMBERS[sort])


def list_calls(words: list[str]) -> None:
    """Run a command in this process and add the calls of kernels that it makes to the list."""
    from eaves.cli import app
    from eaves.kernels import Kernel, sort_of

    calls = set(LIST.read_text("utf-8").splitlines())
    find = Kernel.find

    def find_and_note(kernel: Kernel, args: tuple[Any, ...]) -> Any:
        calls.add(f"{kernel.name}({', '.join(map(sort_of, args))})")
        return find(kernel, args)

    Kernel.find = find_and_note  # type: ignore[method-assign]
    sys.argv = ["eaves", *words]
    try:
        app.main()
    finally:
        LIST.write_text("\n".join(sorted(calls)) + "\n", "utf-8")


if __name__ == "__main__":
    if sys.argv[1] == "--run":
        list_calls(sys.argv[2:])
    else:
        print(make_library(Path(sys.argv[1])))
