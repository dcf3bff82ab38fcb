"""The library of kernels, `eaves.compiled`, made from their C: needs a C compiler.

    python packaging/kernels.py FOLDER      make it there; `src/eaves` gives a clone its own
    python packaging/kernels.py --quick ... the same in half the time, for code that is a twentieth slower
    python packaging/kernels.py --c FILE    the C alone
    python packaging/kernels.py --run ...   a command of eaves; what it calls is added to the lists

`kernels.txt` of the package and of its satellites list what is compiled: kernels with the sorts of arguments
that runs call them with. What is not there runs too, compiled by numba when it is first called.
"""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

from eaves.kernels import HOME, LIST, Kernel, listed_calls, named, sort_of, words_of

from translate import NOTHING, Arr, Function, Translator, Tup, Untranslated, arrays_of, type_of

HERE = Path(__file__).parent
PARTS = 2
"""Into so many pieces the C is divided, which compilers make side by side."""
THOROUGH = ["-O2", "-fvect-cost-model=dynamic"]
QUICK = ["-O1", "-ftree-loop-vectorize", *THOROUGH[1:], "-fstrict-aliasing", "-finline-small-functions"]
"""How the compiler is to improve code: what comes out is the same to the byte."""
BASELINE = {"x86_64": ["-msse4.2"], "AMD64": ["-msse4.2"]}
"""Machine → what is compiled for beyond the plainest processor of its kind: what numpy asks for."""
KINDS = {"f8": "F8", "f4": "F4", "i8": "I8", "i4": "I4", "u1": "U1", "b1": "B1"}


def make_c() -> str:
    """All listed calls as C, `PART` of it where that is defined."""
    whole, entries, table = Translator(), [], []
    for call in listed_calls(*HOME.rglob(LIST.name)):
        kernel, sorts = named(call.partition("(")[0]), call[:-1].partition("(")[2]
        types = tuple(map(type_of, words_of(sorts)))
        try:
            function = whole.function(kernel, types)
        except (Untranslated, AttributeError, KeyError) as error:
            print(f"{call}: left to numba: {error}", file=sys.stderr)
            continue
        entries.append((f"call_{len(entries)}", function, types))
        table.append((f"{call}#{kernel.fingerprint}", entries[-1][0]))
    shares: list[list[Any]] = [[] for _ in range(PARTS)]
    loads = [0] * PARTS
    for entry in sorted(entries, key=lambda entry: -sum(len(one.text) for one in called_by(entry[1]))):
        lightest = loads.index(min(loads))
        shares[lightest].append(entry)
        loads[lightest] = sum(len(one.text) for one in called_by(*(one[1] for one in shares[lightest])))
    parts = [{one.name for one in called_by(*(entry[1] for entry in share))} for share in shares]
    pieces = []
    for one in called_by(*(function for _, function, _ in entries)):
        where = [k for k in range(PARTS) if one.name in parts[k]]
        pieces.append(guarded(where, one.text))
    for name, function, types in entries:
        where = [k for k in range(PARTS) if any(entry[0] == name for entry in shares[k])]
        pieces.append(guarded(where, entry_text(whole, name, function, types)))
    lines = [f"PyObject *{name}(PyObject *, PyObject *const *, Py_ssize_t);" for _, name in table]
    lines.append("static PyMethodDef table[] = {")
    for call, name in table:
        lines.append(f'    {{"{call}", (PyCFunction)(void (*)(void)){name}, METH_FASTCALL, NULL}},')
    lines += ["    {NULL, NULL, 0, NULL}};", "", (HERE / "runtime.c").read_text("utf-8")]
    head = [
        (HERE / "runtime.h").read_text("utf-8"),
        *whole.struct_texts(),
        *(t for _, t in whole.tables.values()),
    ]
    return "\n\n".join(["\n".join(head), *pieces, guarded([0], "\n".join(lines))])


def guarded(parts: list[int], text: str) -> str:
    """Text that only some parts have."""
    if len(parts) == PARTS:
        return text
    return "\n".join(
        [f"#if {' || '.join(['!defined(PART)', *(f'PART == {k}' for k in parts)])}", text, "#endif"]
    )


def called_by(*functions: Function) -> list[Function]:
    """Functions and what they call, each after what it calls."""
    found: dict[str, Function] = {}
    for one in functions:
        for inner in (*called_by(*one.calls), one):
            found.setdefault(inner.name, inner)
    return list(found.values())


def entry_text(whole: Translator, name: str, function: Function, types: tuple[Any, ...]) -> str:
    """The function that Python calls."""
    lines = [f"PyObject *{name}(PyObject *self, PyObject *const *args, Py_ssize_t count) {{"]
    lines.append("    Call call = {0};")
    for k, type_ in enumerate(types):
        lines.append(f"    {whole.c_type(type_)} a{k} = {unboxed(whole, f'args[{k}]', type_)};")
    words = [f"a{k}" for k in range(len(types))]
    if function.can_fail:
        lines.append("    int raised = 0;")
        words.append("&raised")
    lines.append("    if (call.failed) return end_call(&call, NULL);")
    run = f"{function.name}({', '.join(words)})"
    lines.append(
        f"    {run};" if function.returns == NOTHING else f"    {whole.c_type(function.returns)} out = {run};"
    )
    if function.can_fail:
        lines.append("    if (raised) {")
        lines += [f"        Py_XDECREF({path}.owner);" for path in arrays_of("out", function.returns)]
        lines += ["        raise(raised);", "        return end_call(&call, NULL);", "    }"]
    lines.append(f"    return end_call(&call, {boxed('out', function.returns)});")
    return "\n".join([*lines, "}"])


def unboxed(whole: Translator, code: str, type_: Any) -> str:
    """A Python object as C has it."""
    if isinstance(type_, Arr):
        return f"array_of(&call, {code})"
    if isinstance(type_, Tup):
        items = (unboxed(whole, f"PyTuple_GetItem({code}, {k})", item) for k, item in enumerate(type_.items))
        return f"{{{', '.join(items)}}}"
    return {"f8": f"f8_of(&call, {code})", "f4": f"(float)f8_of(&call, {code})",
            "b1": f"PyObject_IsTrue({code}) == 1"}.get(type_, f"i8_of(&call, {code})")  # fmt: skip


def boxed(code: str, type_: Any) -> str:
    """A value in C as a new Python object."""
    if isinstance(type_, Arr):
        return f"box_array(&call, {code}, {type_.axes}, {KINDS[type_.kind]})"
    if isinstance(type_, Tup):
        items = ", ".join(boxed(f"{code}.f{k}", item) for k, item in enumerate(type_.items))
        return f"pack({len(type_.items)}, {items})"
    if type_ == NOTHING:
        return "(Py_INCREF(Py_None), Py_None)"
    if type_ in ("f8", "f4"):
        return f"PyFloat_FromDouble({code})"
    return f"PyBool_FromLong({code})" if type_ == "b1" else f"PyLong_FromLongLong({code})"


def make_library(folder: Path, improved: list[str]) -> Path:
    """Compile every call of the lists into one extension module in a folder; its file."""
    with tempfile.TemporaryDirectory() as made:
        source = Path(made) / "compiled.c"
        source.write_text(make_c(), "utf-8")
        return compile_c(source, folder, improved)


def compile_c(source: Path, folder: Path, improved: list[str]) -> Path:
    """Compile C to an extension module in a folder, part by part, as many at a time as there are cores."""
    if sys.platform == "win32":
        return compile_on_windows(source, folder)
    compiler = os.environ.get("CC", "cc").split()
    options = [
        *(*improved, "-fPIC", "-fwrapv", "-ffp-contract=off", "-fvisibility=hidden", "-std=gnu99", "-w"),
        *("-DPy_LIMITED_API=0x030b0000", f"-I{sysconfig.get_path('include')}"),
        *BASELINE.get(platform.machine(), []),
    ]
    library = folder / "compiled.abi3.so"
    with tempfile.TemporaryDirectory() as made:
        objects = [f"{made}/{part}.o" for part in range(PARTS)]
        started = [
            subprocess.Popen([*compiler, *options, f"-DPART={part}", "-c", source, "-o", objects[part]])
            for part in range(PARTS)
        ]
        if any([process.wait() for process in started]):
            raise SystemExit("the compiler failed")
        link = ["-bundle", "-undefined", "dynamic_lookup"] if sys.platform == "darwin" else ["-shared"]
        subprocess.run([*compiler, *link, *objects, "-o", f"{made}/library", "-lm"], check=True)
        shutil.move(f"{made}/library", library)
    return library


def compile_on_windows(source: Path, folder: Path) -> Path:
    """Compile C to an extension module in a folder as setuptools does, which finds the compiler."""
    from setuptools import Distribution, Extension

    macros = [("Py_LIMITED_API", "0x030b0000")]
    words = ["/O2", "/fp:precise"]
    module = Extension("compiled", [str(source)], macros, extra_compile_args=words, py_limited_api=True)
    command: Any = Distribution({"ext_modules": [module]}).get_command_obj("build_ext")
    command.build_lib, command.build_temp = str(folder), str(source.parent)
    command.ensure_finalized()
    command.run()
    return folder / "compiled.pyd"


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
    elif sys.argv[1] == "--c":
        Path(sys.argv[2]).write_text(make_c(), "utf-8")
    else:
        quick = sys.argv[1] == "--quick"
        print(make_library(Path(sys.argv[-1]), QUICK if quick else THOROUGH))
