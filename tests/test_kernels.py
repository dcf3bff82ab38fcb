"""Kernels: what names their arguments, when the code brought along is used, whether all of it is there."""

from __future__ import annotations

import logging
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest

from eaves import kernels
from eaves.kernels import LIST, Kernel, inlined_kernel, kernel, sort_of
from eaves.simulate import nine_roofs_on_a_slope, write_simulation
from tests.conftest import build_files

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
    kernels.compile_listed()
    kernels.compile_listed()
    assert len(started) == 2


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
