"""ARCHITECTURE.md and CONTRIBUTING.md name files that exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "src" / "eaves"
DEVELOP = ("engine", "questions", "decisions")
QUOTED = re.compile(r"`([\w.-]+(?:/[\w.*-]*)+|[\w-]+\.(?:py|md|toml|bib))`")
"""What stands in backticks and has a slash, or is a file of code or text."""
WRITTEN = ("OUT/",)
"""Folders of a run, which are not in the repository."""


def paths_of(page: str) -> list[str]:
    """The paths that a page names in its text, without placeholders."""
    text = (ROOT / page).read_text(encoding="utf-8")
    found = [path for path in QUOTED.findall(text) if not path.startswith(WRITTEN)]
    return sorted(set(found))


def tree_of(page: str) -> list[str]:
    """The paths of the drawing of the folders."""
    text = (ROOT / page).read_text(encoding="utf-8")
    drawing = next(block for block in text.split("```")[1::2] if "src/eaves/" in block)
    names = [line.lstrip("├─└│ ") for line in drawing.splitlines() if line.lstrip().startswith(("├", "└"))]
    return [path for line in names for path in re.findall(r"[\w./]+", line.split("  ")[0])]


@pytest.mark.parametrize(
    "page",
    [
        "ARCHITECTURE.md",
        "CONTRIBUTING.md",
        *(f"docs/develop/{name}.md" for name in ("engine", "questions", "decisions")),
    ],
)
def test_every_path_in_the_text_exists(page: str) -> None:
    paths = paths_of(page)
    assert len(paths) > 3
    missing = [p for p in paths if not ((ROOT / p).exists() or (PACKAGE / p).exists())]
    assert missing == []


def test_every_folder_in_the_drawing_exists_and_none_is_left_out() -> None:
    drawn = [path.rstrip("/") for path in tree_of("ARCHITECTURE.md")]
    assert [path for path in drawn if not (PACKAGE / path).exists()] == []
    there = {path.name for path in PACKAGE.iterdir() if path.is_dir() and path.name != "__pycache__"}
    assert there <= set(drawn)
