"""The page of comparison tables, gathered from benchmarks/results."""

from __future__ import annotations

import re
from pathlib import Path

DATED = re.compile(r"(\d{4}-\d{2}-\d{2})-(.+)\.md")
ORDER = ("ground", "detection", "outline", "footprints", "roof", "moments", "models", "validate", "simulator")

INTRODUCTION = """# How it compares

Every table was printed by a script in `benchmarks/` and kept with its date, commit and machine; the newest of
each stands here, misses included. `make bench` makes them again. What the measures mean:
[evaluation](evaluation.md).
"""


def comparison_page(results: Path) -> str:
    """The newest table of every kind, with its headings one level down."""
    newest: dict[str, Path] = {}
    for path in sorted(results.glob("*.md")):
        if found := DATED.fullmatch(path.name):
            newest[found[2]] = path
    pieces = [INTRODUCTION]
    for _, path in sorted(newest.items(), key=lambda item: (rank(item[0]), item[0])):
        text = path.read_text(encoding="utf-8").strip()
        pieces.append(re.sub(r"^#", "##", text, flags=re.MULTILINE) + "\n")
    return "\n".join(pieces)


def rank(kind: str) -> int:
    """The place of a kind of table: the order of the flow, what is new last."""
    return next((number for number, stage in enumerate(ORDER) if kind.startswith(stage)), len(ORDER))
