"""The independent judges of what eaves writes: other programs and schemas, which a machine may lack.

A test without its judge is skipped, and a run of the tests says in one line how many were. With
EAVES_JUDGES=1, as continuous integration has it, such a test fails.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable
from importlib import import_module
from typing import Any

import pytest

MISSING = "no judge: "


def need_judge(name: str, there: object) -> None:
    """Skip the test where a judge is not there, or fail it where judges must be."""
    if not there:
        verdict = pytest.fail if os.environ.get("EAVES_JUDGES") == "1" else pytest.skip
        verdict(MISSING + name)


def judging_module(name: str) -> Any:
    """A module of another project that judges."""
    try:
        return import_module(name)
    except ImportError:
        need_judge(name.split(".")[0], False)


def summary_of(reasons: Iterable[str]) -> str:
    """One line on the tests that lacked a judge; empty where none did."""
    counts = Counter(reason.split(MISSING)[1].strip("')") for reason in reasons if MISSING in reason)
    if not counts:
        return ""
    each = ", ".join(f"{name} {count}" for name, count in sorted(counts.items()))
    return f"{counts.total()} tests skipped without their judge: {each} (EAVES_JUDGES=1 fails them)"
