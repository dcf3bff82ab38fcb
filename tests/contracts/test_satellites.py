"""A satellite stands on the core's public names alone, and no name of a package hides a public function."""

from __future__ import annotations

import ast
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "src" / "eaves"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
LAYERS = PROJECT["tool"]["importlinter"]["contracts"][0]["layers"]
TOP = LAYERS[: LAYERS.index("cli")]
SATELLITES = sorted({name.strip() for layer in TOP for name in layer.split("|")} - {"published"})


def public_names(package: str) -> set[str]:
    """The names that a package lists, in its stub or in its first file."""
    place = PACKAGE.joinpath(*package.split(".")[1:])
    files = [file for file in (place / "__init__.pyi", place / "__init__.py") if file.exists()]
    nodes = [node for file in files for node in ast.parse(file.read_text(encoding="utf-8")).body]
    return {
        alias.asname or alias.name
        for node in nodes
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


def taken(file: Path) -> set[tuple[str, str]]:
    """The modules and names that a file imports from this package."""
    nodes = ast.walk(ast.parse(file.read_text(encoding="utf-8")))
    return {
        (node.module, alias.name)
        for node in nodes
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "eaves"
        for alias in node.names
    }


@pytest.mark.parametrize("name", SATELLITES)
def test_a_satellite_takes_public_names_of_the_core_alone(name: str) -> None:
    place = PACKAGE / name
    hidden = []
    for file in place.rglob("*.py") if place.is_dir() else [place.with_suffix(".py")]:
        for module, what in taken(file):
            own = module.split(".")[1:2] == [name]
            nouns = module.startswith("eaves.model")  # all of them
            single = PACKAGE.joinpath(*module.split(".")[1:]).with_suffix(".py").exists()
            top_module = single and module.count(".") == 1
            if not (own or nouns or top_module or what in public_names(module)):
                hidden.append(f"{file.relative_to(PACKAGE)}: {module}.{what}")
    assert not hidden


def test_the_core_runs_without_satellites() -> None:
    script = (
        "import sys, importlib.abc\n"
        f"SATELLITES = {[f'eaves.{name}' for name in SATELLITES]}\n"
        "class Missing(importlib.abc.MetaPathFinder):\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name in SATELLITES:\n"
        "            raise ImportError(name)\n"
        "sys.meta_path.insert(0, Missing())\n"
        "import pkgutil, importlib, eaves\n"
        "for module in pkgutil.walk_packages(eaves.__path__, 'eaves.', onerror=lambda name: None):\n"
        "    if not module.name.startswith(tuple(SATELLITES)) and 'plots' not in module.name:\n"
        "        importlib.import_module(module.name) if not module.name.endswith('__main__') else None\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


def test_public_functions_are_called_after_every_module_was_imported() -> None:
    script = (
        "import pkgutil, importlib, eaves\n"
        "for module in pkgutil.walk_packages(eaves.__path__, 'eaves.', onerror=lambda name: None):\n"
        "    if not module.name.endswith('__main__'):\n"
        "        importlib.import_module(module.name)\n"
        "wrong = [name for name in eaves.__all__ if type(getattr(eaves, name)).__name__ == 'module']\n"
        "assert wrong == ['evaluate'], wrong\n"
        "for name in ('build', 'update', 'compare', 'find_buildings', 'measure_solar', 'read'):\n"
        "    try:\n"
        "        getattr(eaves, name)()\n"
        "    except TypeError as error:\n"
        "        assert 'missing' in str(error), (name, error)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
