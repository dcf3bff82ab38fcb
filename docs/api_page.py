"""The API reference, from signatures and docstrings."""

from __future__ import annotations

import inspect
import re
from importlib import import_module
from typing import Any

from docs.method_pages import linked, split_sections

from eaves.methods import REGISTRY, method_class, methods_of

TOPICS = {
    "run": ("Whole runs", ("report", "flow", "pipeline", "recipe", "methods", "change", "upkeep", "solar")),
    "points": ("Points and ground", ("ground", "raster")),
    "detection": ("Detection, outlines and units", ("detect", "outline", "units")),
    "between": ("Between the stages of a run", ("blocks", "buildings", "footprints", "figures")),
    "models": ("Roofs and solids", ("roof", "reconstruct")),
    "data": ("Data types", ("model",)),
    "formats": ("Reading and writing", ("formats", "exports")),
    "validation": ("Validating", ("validate",)),
    "evaluation": ("Evaluating", ("evaluate",)),
    "simulation": ("Simulating", ("simulate",)),
}
"""Page → title, and the rooms of the package whose public names it lists."""
HOMES = (
    "eaves",
    "eaves.model",
    "eaves.formats",
    "eaves.exports",
    "eaves.validate",
    "eaves.evaluate",
    "eaves.simulate",
)
"""The modules with public names, which `__all__` lists; a name stands where it comes first."""

INTRODUCTION = """# API by topic

These pages are made from the docstrings by `make docs`; the examples run as tests. Methods have
[pages of their own](../methods/README.md). The [conventions](../../conventions.md) explain words and units.
"""


def api_pages() -> dict[str, str]:
    """Name → text of every page, the list of all names as README.md."""
    every = [(stage, name) for stage in REGISTRY for name in methods_of(stage)]
    methods = {method_class(stage, name): f"{stage}-{name}" for stage, name in every}
    entries: dict[str, dict[str, str]] = {page: {} for page in TOPICS}
    index: dict[str, list[str]] = {page: [] for page in TOPICS}
    seen: set[Any] = set()
    for module in HOMES:
        home = import_module(module)
        for name in sorted(home.__all__):
            thing = getattr(home, name)
            if not (inspect.isfunction(thing) or inspect.isclass(thing)) or thing in seen:
                continue
            seen.add(thing)
            room = thing.stage if thing in methods else thing.__module__.split(".")[1]
            page = next(page for page, (_, rooms) in TOPICS.items() if room in rooms)
            if thing in methods:
                index[page].append(f"[{name}](../methods/{methods[thing]}.md)")
            else:
                index[page].append(f"[{name}]({page}.md#{name.lower()})")
                entries[page][name] = entry(module, name, thing)
    rows = [f"| [{title}]({page}.md) | {', '.join(index[page])} |" for page, (title, _) in TOPICS.items()]
    pages = {"README.md": "\n".join([INTRODUCTION, "| topic | names |", "|---|---|", *rows, ""])}
    for page, (title, _) in TOPICS.items():
        pages[f"{page}.md"] = f"# {title}\n\n" + "\n".join(entries[page].values())
    return pages


def entry(module: str, name: str, thing: Any) -> str:
    """Heading, signature and docstring of a function or class."""
    lines = [f"## {name}\n", f"```python\n{module}.{name}{signature(thing)}\n```\n"]
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
