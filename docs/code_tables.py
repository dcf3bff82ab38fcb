"""What two pages say of classes and of failures, from the code: `docs.build` writes it."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from pathlib import Path

from eaves.model import cloud

SOURCES = Path(cloud.__file__).parents[1]
CLASSES = re.compile(r"(?<=\*\*Classes written\*\*: ).*?(?= 1 the rest\.)", re.DOTALL)
ROW = re.compile(r"^\| `([a-z_]+)` \| [^|]* \|", re.MULTILINE)


def conventions_page(text: str) -> str:
    """docs/conventions.md with the classes of `eaves.model.cloud`."""
    words = {
        value: name.lower().replace("_", " ")
        for name, value in vars(cloud).items()
        if name.isupper() and type(value) is int and 1 < value < 64
    }
    return CLASSES.sub(", ".join(f"{value} {words[value]}" for value in sorted(words)) + ",", text)


def failure_stages() -> dict[str, set[str]]:
    """Code → the stages that fail with it: of every `Failure(code, reason, stage)` among the sources."""
    found: dict[str, set[str]] = defaultdict(set)
    for path in sorted(SOURCES.rglob("*.py")):
        room = path.relative_to(SOURCES).parts[0]
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "Failure" and len(node.args) > 2:
                code, _, stage = node.args[:3]
                if isinstance(code, ast.Constant):
                    found[code.value].add(stage.value if isinstance(stage, ast.Constant) else room)
    return found


def errors_page(text: str) -> str:
    """docs/errors.md with the stages of each failure; a code that the code does not name keeps its own."""
    stages = failure_stages()

    def row(found: re.Match[str]) -> str:
        known = stages.get(found[1])
        return f"| `{found[1]}` | {', '.join(sorted(known))} |" if known else found[0]

    return ROW.sub(row, text)
