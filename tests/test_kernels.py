"""Kernels: what names their arguments, when the code brought along is used, whether all of it is there."""

from __future__ import annotations

import functools
import importlib
import logging
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest

from eaves import kernels
from eaves.kernels import LIST, MAKER, Kernel, inlined_kernel, kernel, sort_of
from eaves.simulate import nine_roofs_on_a_slope, write_simulation
from tests.conftest import build_files

QUICK = ("geometry.inside.connected", "geometry.planes.sums", "geometry.tin.whole", "raster.interpolate.away")
"""Kernels that numba compiles in a moment: the library is compared with it on these whenever tests run."""

STEP = 2.0


class Pair(NamedTuple):
    """Two values."""

    one: float
    other: int


@inlined_kernel
def scaled(value: float) -> Any:
    """A value in steps."""
    return value * STEP


@kernel
def sum_kernel(values: np.ndarray) -> float:
    """The sum of the scaled values."""
    total = 0.0
    for value in values:
        total += scaled(value)
    return total


def test_sorts_tell_type_dimensions_order_and_whether_it_can_be_written() -> None:
    grid = np.zeros((4, 6))
    assert sort_of(grid) == "<f8[2C]" and sort_of(grid.T) == "<f8[2F]" and sort_of(grid[:, ::2]) == "<f8[2A]"
    assert sort_of(np.broadcast_to(np.int32(1), 3)) == "<i4[1Ar]"
    assert [sort_of(v) for v in (1, 1.0, True, np.int64(1), np.float64(1), np.float32(1))] == [
        *("int", "float", "bool", "int", "float", "float32")
    ]
    assert sort_of((1, 2.0)) == "(int, float)"
    assert sort_of(Pair(1.0, 2)) == f"{__name__}.Pair(float, int)"


def test_fingerprint_follows_code_callees_and_constants(monkeypatch: pytest.MonkeyPatch) -> None:
    def afresh() -> str:
        return Kernel(sum_kernel.py_func, inline=False).fingerprint

    first = afresh()
    assert first == sum_kernel.fingerprint
    monkeypatch.setitem(globals(), "STEP", 3.0)
    second = afresh()
    monkeypatch.setitem(globals(), "scaled", inlined_kernel(lambda value: value * STEP + 1.0))
    assert len({first, second, afresh()}) == 3


def test_code_brought_along_is_used_only_for_its_own_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    call = f"{sum_kernel.name}(<f8[1C])"
    for fingerprint, expected in ((sum_kernel.fingerprint, "brought along"), ("of other code", 12.0)):
        monkeypatch.setattr(kernels, "library", lambda f=fingerprint: {call: (f, lambda v: "brought along")})
        monkeypatch.setattr(sum_kernel, "ready", {})
        assert sum_kernel(np.array([1.0, 2.0, 3.0])) == expected
    assert sum_kernel(np.array([1.0, 2.0, 3.0, 0.0])[::2]) == 8.0


def test_code_for_strided_arrays_does_for_others(monkeypatch: pytest.MonkeyPatch) -> None:
    call = f"{sum_kernel.name}(<f8[1A])"
    brought = {call: (sum_kernel.fingerprint, lambda values: "brought along")}
    monkeypatch.setattr(kernels, "library", lambda: brought)
    monkeypatch.setattr(sum_kernel, "ready", {})
    values = np.arange(6.0)
    assert sum_kernel(values) == sum_kernel(values[::2]) == "brought along"
    brought[f"{sum_kernel.name}(<f8[1C])"] = (sum_kernel.fingerprint, lambda values: "its own")
    monkeypatch.setattr(sum_kernel, "ready", {})
    assert (sum_kernel(values), sum_kernel(values[::2])) == ("its own", "brought along")
    assert not kernels.fits(f"{sum_kernel.name}(<f8[2C])", call)  # of two dimensions
    assert not kernels.fits(call, f"{sum_kernel.name}(<f8[1C])")  # and not the other way round
    assert kernels.fits("m.k(<i4[2C], |u1[1C], int)", "m.k(<i4[2Au], |u1[1A], int)")


def test_list_names_kernels_there_are() -> None:
    for path in kernels.HOME.rglob(LIST.name):
        calls = path.read_text("utf-8").splitlines()
        assert calls == sorted(set(calls))
        for call in calls:
            kernel = kernels.named(call.partition("(")[0])
            taken = kernel.py_func.__code__.co_argcount
            assert isinstance(kernel, Kernel) and len(kernels.signature(call)) == taken, call


def test_the_shares_are_all_calls_of_the_list(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled: list[str] = []
    for share in range(3):
        taken: list[str] = []
        with monkeypatch.context() as patched:
            patched.setattr(kernels.signal, "signal", lambda *_: None)
            patched.setattr(kernels, "signature", lambda call, taken=taken: taken.append(call))
            one = SimpleNamespace(weight=1, dispatcher=SimpleNamespace(compile=lambda sorts: None))
            patched.setattr(kernels, "named", lambda name, one=one: one)
            kernels.compile_share(share, 3)
        assert taken
        compiled += taken
    assert sorted(compiled) == kernels.listed_calls(LIST)


def test_what_a_process_compiles_another_waits_for_and_finds(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(kernels.os, "cpu_count", lambda: 2)
    started: list[list[str]] = []

    def start(words: list[str]) -> SimpleNamespace:
        started.append(words)
        (tmp_path / f"{len(started)}.nbc").touch()
        return SimpleNamespace(wait=lambda: 0, kill=lambda: None)

    monkeypatch.setattr(kernels.subprocess, "Popen", start)
    monkeypatch.setattr(kernels, "library", functools.cache(dict))
    monkeypatch.setattr(kernels, "MAKER", tmp_path / "none.py")
    kernels.compile_listed()
    kernels.compile_listed()
    assert len(started) == 2


def test_a_clone_makes_its_library_before_numba_compiles(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    made: list[Any] = []

    def run(words: list[Any], **_: Any) -> SimpleNamespace:
        made.append(words[1:])
        return SimpleNamespace(stdout="", stderr="", returncode=0)

    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("CC", kernels.sys.executable)
    monkeypatch.setattr(kernels, "library", functools.cache(lambda: {"call": ()} if made else {}))
    monkeypatch.setattr(kernels.subprocess, "run", run)
    monkeypatch.setattr(kernels.subprocess, "Popen", None)
    kernels.compile_listed()
    kernels.compile_listed()
    assert made == [[kernels.MAKER, "--quick", kernels.HOME]]
    monkeypatch.setenv("CC", "no-compiler-of-this-name")
    assert not kernels.make_library() and len(made) == 1


def test_list_has_every_call_of_a_build(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    calls, find = set(), Kernel.find

    def find_and_note(one: Kernel, args: tuple[Any, ...]) -> Any:
        calls.add(f"{one.name}({', '.join(map(sort_of, args))})")
        return find(one, args)

    monkeypatch.setattr(Kernel, "find", find_and_note)
    for one in kernels.KERNELS:
        monkeypatch.setattr(one, "ready", {})
    files = write_simulation(nine_roofs_on_a_slope(density=6.0, noise=0.02), tmp_path / "scene")
    build_files(files["points"], tmp_path / "out", jobs=1)
    missing = {call for call in calls if call.startswith("eaves.")} - set(kernels.listed_calls(LIST))
    assert not missing, "add them: python packaging/kernels.py --run build …"
    assert len(calls) > 50


def test_the_first_use_is_said_once(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(kernels, "is_first_use", lambda: True)
    monkeypatch.setattr(kernels, "library", dict)
    monkeypatch.setattr(kernels, "compile_listed", lambda: None)
    monkeypatch.setattr(kernels, "parent_process", lambda: None)
    monkeypatch.setattr(kernels.log, "level", logging.NOTSET)  # which a command has set before
    kernels.say_first_use.cache_clear()
    kernels.say_first_use()
    kernels.say_first_use()
    assert [one.getMessage() for one in caplog.records] == [kernels.FIRST_USE]
    kernels.say_first_use.cache_clear()


def copied(value: Any) -> Any:
    """A copy of an argument, a tuple's arrays too."""
    if isinstance(value, np.ndarray):
        return value.copy("K")
    if isinstance(value, tuple):
        items = map(copied, value)
        return type(value)(*items) if hasattr(value, "_fields") else tuple(items)
    return value


def as_bytes(value: Any) -> Any:
    """What tells apart results that differ in anything."""
    if isinstance(value, tuple):
        return tuple(map(as_bytes, value))
    if isinstance(value, np.ndarray):
        return value.dtype, value.shape, value.tobytes()
    return type(value), np.asarray(value).tobytes() if value is not None else None


def compare_with_numba(monkeypatch: pytest.MonkeyPatch, folder: Path, wanted: Any) -> set[str]:
    """Build a scene with all wanted calls of kernels made by the library and by numba, which must agree to
    the byte in what they return and write; the calls made."""
    if not kernels.library():
        pytest.skip("no library of kernels: this machine has no C compiler")
    find, made = Kernel.find, set()

    def find_both(one: Kernel, args: tuple[Any, ...]) -> Any:
        call, run = f"{one.name}({', '.join(map(sort_of, args))})", find(one, args)
        if call not in kernels.library() or not wanted(call):
            return run
        made.add(call)

        def run_both(*args: Any) -> Any:
            copies = [copied(arg) for arg in args]
            expected, got = one.dispatcher(*copies), run(*args)
            assert as_bytes(got) == as_bytes(expected), call
            assert [as_bytes(arg) for arg in args] == [as_bytes(arg) for arg in copies], call
            return got

        return run_both

    monkeypatch.setattr(Kernel, "find", find_both)
    for one in kernels.KERNELS:
        monkeypatch.setattr(one, "ready", {})
    files = write_simulation(nine_roofs_on_a_slope(density=6.0, noise=0.02), folder / "scene")
    build_files(files["points"], folder / "out", jobs=1)
    return made


def test_the_library_gives_the_bytes_of_numba(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    few = compare_with_numba(monkeypatch, tmp_path, lambda call: any(n in call for n in QUICK))
    assert len(few) >= 4


@pytest.mark.slow
def test_the_whole_library_gives_the_bytes_of_numba(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert len(compare_with_numba(monkeypatch, tmp_path, lambda call: True)) > 90


@kernel
def halves_kernel(values: np.ndarray, by: float) -> float:
    """The sum of quotients."""
    total = 0.0
    for value in values:
        total += value / by
    return total


@pytest.fixture
def translate(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The module that makes C."""
    monkeypatch.syspath_prepend(kernels.MAKER.parent)
    return importlib.import_module("translate")


def test_c_is_made_of_all_listed_calls(translate: Any) -> None:
    whole = translate.Translator()
    for call in kernels.listed_calls(*kernels.HOME.rglob(LIST.name)):
        name, _, sorts = call[:-1].partition("(")
        types = tuple(map(translate.type_of, kernels.words_of(sorts)))
        assert whole.function(kernels.named(name), types).text.endswith("}"), call


def test_division_by_zero_is_checked_in_c_and_what_is_no_c_is_refused(translate: Any) -> None:
    whole = translate.Translator()
    function = whole.function(halves_kernel, (translate.Arr("f8", 1), "f8"))
    assert function.can_fail and "quotient(value, by, &bad)" in function.text
    assert whole.function(sum_kernel, (translate.Arr("f8", 1),)).returns == "f8"
    with pytest.raises(translate.Untranslated):
        whole.function(kernel(in_words), ("f8",))


def in_words(value: float) -> Any:
    """What C is not made of."""
    return f"{value}"


def test_every_listed_call_is_c_that_a_compiler_takes(tmp_path: Path) -> None:
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("this machine has no C compiler")
    source = tmp_path / "compiled.c"
    made = subprocess.run([sys.executable, MAKER, "--c", source], capture_output=True, text=True)
    assert (made.returncode, made.stderr) == (0, "")
    options = ["-fsyntax-only", "-w", "-std=gnu99", f"-I{sysconfig.get_path('include')}"]
    checked = subprocess.run([compiler, *options, source], capture_output=True, text=True)
    assert checked.stderr == ""


def test_the_library_raises_what_numba_does() -> None:
    bilinear = "eaves.model.scene.bilinear_kernel(<f4[2C], float, float, float, <f8[2C])"
    if bilinear not in kernels.library():
        pytest.skip("no library of kernels: this machine has no C compiler")
    with pytest.raises(ZeroDivisionError):
        kernels.library()[bilinear][1](np.zeros((2, 2), np.float32), 0.0, 0.0, 0.0, np.ones((1, 2)))
