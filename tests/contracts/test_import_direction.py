"""Imports point one way: the layers in pyproject.toml, held by import-linter."""

from __future__ import annotations

from importlinter.cli import EXIT_STATUS_SUCCESS, lint_imports


def test_imports_point_inward() -> None:
    assert lint_imports(no_cache=True) == EXIT_STATUS_SUCCESS
