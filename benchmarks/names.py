"""Share of bound names that name nothing: pronouns, participles and fillers, room by room.

    python -m benchmarks.names [SRC]

A binding is a parameter or a name that is assigned to, also by a loop, a comprehension, `with`, `except` or a
walrus. It counts when its name, without leading underscores, is one of `FILLERS`.
"""

from __future__ import annotations

import ast
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

FILLERS = frozenset(
    {
        "one",
        "two",
        "both",
        "other",
        "others",
        "some",
        "known",
        "found",
        "whole",
        "answer",
        "answers",
        "words",
        "rest",
        "kept",
        "made",
        "done",
        "seen",
        "given",
        "held",
        "left",
        "taken",
        "near",
        "wanted",
        "used",
        "told",
        "mine",
        "own",
        "there",
        "theirs",
        "mostly",
        "stated",
        "tried",
    }
)


def bound_names(tree: ast.AST) -> Iterator[str]:
    """The names that a module binds, one for each binding; not those of functions, classes and imports."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.ExceptHandler) and node.name:
            yield node.name


def main(source: Path) -> None:
    """Prints a table of the rooms, and the fillers that are used most."""
    bound, fillers, often = Counter[str](), Counter[str](), Counter[str]()
    for path in sorted(source.rglob("*.py")):
        inner = path.relative_to(source).parts
        room = inner[0] if len(inner) > 1 else "."
        for name in bound_names(ast.parse(path.read_text(encoding="utf-8"))):
            filler = name.lstrip("_") in FILLERS
            bound.update([room, "all"])
            fillers.update([room, "all"] if filler else [])
            often.update([name] if filler else [])
    print("| room | bound names | fillers | share |\n|---|---|---|---|")
    for room in sorted(bound, key=lambda room: (room == "all", room)):
        print(f"| {room} | {bound[room]:,} | {fillers[room]:,} | {fillers[room] / bound[room]:.1%} |")
    print("\n" + ", ".join(f"{name} {count}" for name, count in often.most_common()))


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "src/eaves"))
