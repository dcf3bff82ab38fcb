"""The API reference, from signatures and docstrings."""

from __future__ import annotations

import inspect
import re
from importlib import import_module
from typing import Any

from docs.method_pages import linked, split_sections

SECTIONS = {
    "Functions and methods": "eaves",
    "Data types": "eaves.model",
    "Reading and writing": "eaves.formats",
    "Validating": "eaves.validate",
    "Evaluating": "eaves.evaluate",
    "Simulating": "eaves.simulate",
}
"""Title → module; its public names are what `__all__` lists."""

INTRODUCTION = """# API reference

Made from the docstrings by `make docs`; the examples run as tests. Methods have
[pages of their own](methods/README.md), words and units are those of the [conventions](../conventions.md).
"""


def api_page() -> str:
    """The page."""
    lines = [INTRODUCTION]
    for title, module in SECTIONS.items():
        home = import_module(module)
        lines.append(f"## {title}: `{module}`\n")
        for name in sorted(home.__all__):
            thing = getattr(home, name)
            if inspect.isfunction(thing) or inspect.isclass(thing):
                lines.append(entry(module, name, thing))
    return "\n".join(lines)


def entry(module: str, name: str, thing: Any) -> str:
    """Heading, signature and docstring of a function or class."""
    lines = [f"### {name}\n", f"```python\n{module}.{name}{signature(thing)}\n```\n"]
    for title, text in split_sections(inspect.getdoc(thing) or ""):
        body = f"```python\n{text}\n```" if ">>>" in text and title == "Examples" else listed(text, title)
        lines.append((f"**{title}**\n\n" if title else "") + body + "\n")
    return "\n".join(lines)


def signature(thing: Any) -> str:
    """The signature as written, on several lines when it is long."""
    try:
        found = inspect.signature(thing)
    except (TypeError, ValueError):
        return ""
    text = re.sub(r"<factory>|<function \S+ at 0x[0-9a-f]+>", "...", str(found)).replace("'", "")
    # typing keeps whichever of two equal limits was used first, 0 or 0.0
    text = re.sub(r"\b([GL][te]\(\w+=-?\d+)\.0\)", r"\1)", text)
    return text if len(text) < 80 else re.sub(r"^\((.*)\)", lambda m: "(\n    " + split(m[1]) + "\n)", text)


def split(arguments: str) -> str:
    """Arguments one a line; commas inside brackets stay."""
    depth, result = 0, ""
    for character in arguments:
        depth += (character in "([{") - (character in ")]}")
        result += ",\n    " if character == "," and depth == 0 else character
    return re.sub(r"\n {5,}", "\n    ", result)


def listed(text: str, title: str) -> str:
    """Numpydoc's names with indented texts as a list; other text as it is."""
    if title not in ("Parameters", "Returns", "Raises"):
        return linked(text)
    lines = []
    for line in text.splitlines():
        if line and not line.startswith(" "):
            lines.append(f"- `{line.rstrip()}`:")
        elif line.strip():
            lines[-1:] = [f"{lines[-1]} {line.strip()}"] if lines else [line.strip()]
    return linked("\n".join(lines))
