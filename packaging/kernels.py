"""The library of kernels, `eaves.compiled`, for the wheel of this machine's Python: needs a C compiler.

    python packaging/kernels.py FOLDER      make it there; `src/eaves` gives a clone its own
    python packaging/kernels.py --run ...   a command of eaves; what it calls is added to the lists

`kernels.txt` of the package and of its satellites list what is compiled: kernels with the sorts of arguments
that runs call them with. What is not there runs too, compiled by numba when it is first called.
"""

from __future__ import annotations

import os
import platform
import sys
import tempfile
from pathlib import Path
from typing import Any

from eaves.kernels import HOME, LIST, Kernel, listed_calls, named, signature, sort_of

BASELINE = {"x86_64": "x86-64-v2", "AMD64": "x86-64-v2"}
"""Machine → the processor compiled for: what numpy asks for; elsewhere the plainest of its kind."""


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
        for call in listed_calls(*HOME.rglob(LIST.name)):
            kernel = named(call.partition("(")[0])
            module.export(f"{call}#{kernel.fingerprint}", signature(call))(kernel.py_func)
        module.compile()
    return folder / module.output_file


def list_of(call: str) -> Path:
    """The list that a call is in: of the satellite whose kernel it is, where that has one, or of the core."""
    place = HOME / call.split(".")[1] / LIST.name
    return place if place.exists() else LIST


def list_calls(words: list[str]) -> None:
    """Run a command in this process and add the calls of kernels that it makes to the lists."""
    from eaves.cli import app

    calls = set(listed_calls(*HOME.rglob(LIST.name)))
    find = Kernel.find

    def find_and_note(kernel: Kernel, args: tuple[Any, ...]) -> Any:
        calls.add(f"{kernel.name}({', '.join(map(sort_of, args))})")
        return find(kernel, args)

    Kernel.find = find_and_note  # type: ignore[method-assign]
    sys.argv = ["eaves", *words]
    try:
        app.main()
    finally:
        for path in HOME.rglob(LIST.name):
            ours = sorted(call for call in calls if list_of(call) == path)
            path.write_text("".join(f"{call}\n" for call in ours), "utf-8")


if __name__ == "__main__":
    if sys.argv[1] == "--run":
        list_calls(sys.argv[2:])
    else:
        print(make_library(Path(sys.argv[1])))
