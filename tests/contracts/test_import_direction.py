"""Imports point one way: the layers in pyproject.toml, held by import-linter."""

from __future__ import annotations

import subprocess
import sys

# in a process of its own, for import-linter switches off the loggers of the process it runs in
LINT = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports(no_cache=True))"


def test_imports_point_inward() -> None:
    done = subprocess.run([sys.executable, "-c", LINT], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout
