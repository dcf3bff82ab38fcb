"""Run every benchmark (`python -m benchmarks`), or those named (`python -m benchmarks ground detection`)."""

from __future__ import annotations

import importlib
import pkgutil
import sys

import benchmarks.accuracy

names = sys.argv[1:] or [found.name for found in pkgutil.iter_modules(benchmarks.accuracy.__path__)]
sys.argv = sys.argv[:1]
for name in names:
    importlib.import_module(f"benchmarks.accuracy.{name}").main()
