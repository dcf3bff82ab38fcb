"""Run every benchmark (`python -m benchmarks`), or those named (`python -m benchmarks ground budget`)."""

from __future__ import annotations

import importlib
import pkgutil
import sys

import benchmarks.accuracy
import benchmarks.scale
import benchmarks.speed

there = {
    found.name: f"{package.__name__}.{found.name}"
    for package in (benchmarks.accuracy, benchmarks.speed, benchmarks.scale)
    for found in pkgutil.iter_modules(package.__path__)
}
names = sys.argv[1:] or list(there)
sys.argv = sys.argv[:1]
for name in names:
    getattr(importlib.import_module(there[name]), "main", int)()  # some only serve others
