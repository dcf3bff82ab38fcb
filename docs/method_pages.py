"""A page for every registered method: idea, docstring, parameters, step pictures, paper."""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from typing import Any

from docs.citations import citation

from eaves.methods import DEFAULTS, REGISTRY, Method, method_class, methods_of

HEADING = re.compile(r"(?:^|\s)([A-Z][a-z]+(?: [a-z]+){0,2})\s+-{4,}\s*", re.MULTILINE)
"""A numpydoc heading, also one that a line wrapper has joined to its text."""
LIMITS = {"Ge": "≥", "Gt": ">", "Le": "≤", "Lt": "<"}
STAGES = {
    "ground": "Ground",
    "detect": "Detection",
    "outline": "Outlines",
    "units": "Units",
    "roof": "Roof planes",
    "reconstruct": "Reconstruction",
}


def option_of(stage: str) -> str:
    """The option of `eaves build` that names a stage's method."""
    return "--units" if stage == "units" else f"--{stage}-method"


def method_page(stage: str, name: str, docs: Path) -> str:
    """The page of one method."""
    cls = method_class(stage, name)
    lines = [f"# {stage}/{name}", "", f"*{sentence(cls.idea)}*"]
    lines += ["", f"`{cls.__module__}.{cls.__name__}`" + (", the default" if DEFAULTS[stage] == name else "")]
    lines += ["", f"```\neaves build tile.laz -o out {option_of(stage)} {name}\n```"]
    sections = split_sections(inspect.getdoc(cls) or "")
    for title, text in sections:
        if title in ("Parameters", "References"):
            continue
        lines += ["", *([f"## {title}", ""] if title else []), linked(text)]
    lines += ["", "## Parameters", "", parameter_table(cls)]
    picture = docs / "images" / "methods" / f"{stage}-{name}.png"
    if picture.exists():
        lines += ["", "## Steps", "", "On a simulated scene; `python -m docs.pictures` draws it again."]
        lines += ["", f"![The steps of {name}](../../images/methods/{picture.name})"]
    keys = [cls.paper, *re.findall(r"\[(\w+)\]", dict(sections).get("References", ""))]
    lines += ["", "## References", "", *(f"- {citation(key)}" for key in dict.fromkeys(keys))]
    return "\n".join(lines) + "\n"


def split_sections(text: str) -> list[tuple[str, str]]:
    """Title and text of the sections of a docstring, the first without a title."""
    pieces = HEADING.split(text)
    return list(zip(["", *pieces[1::2]], (piece.strip() for piece in pieces[::2]), strict=True))


def linked(text: str) -> str:
    """The text with short citations in italics, so that Markdown does not take them for links."""
    return re.sub(r"\[(\w+)\](?!\()", lambda found: f"*{found[1]}*", text)


def parameter_table(cls: type[Method]) -> str:
    """The parameters as a Markdown table; a sentence when there are none."""
    if not cls.model_fields:
        return "None."
    rows = ["| parameter | default | published | unit | range | symbol | meaning |", "|" + "---|" * 7]
    for name, field in cls.model_fields.items():
        extra: Any = field.json_schema_extra or {}
        limits = ", ".join(
            f"{LIMITS[kind]} {limit}"
            for item in field.metadata
            if (kind := type(item).__name__) in LIMITS and (limit := getattr(item, kind.lower())) is not None
        )
        unit = None if extra.get("unit") == "1" else extra.get("unit")
        default = "derived" if field.default is None else str(field.default)
        cells = [f"`{name}`", default, printed_number(extra), unit, limits, extra.get("symbol")]
        cells.append(sentence(field.description or ""))
        shown = ["" if cell is None else str(cell).replace("|", "\\|") for cell in cells]
        rows.append("| " + " | ".join(shown) + " |")
    return "\n".join(rows)


def printed_number(extra: dict[str, Any]) -> str | None:
    """The published number and the place in the paper; None where the paper prints none."""
    if extra.get("published") is not None:
        return f"{extra['published']} ({extra['printed_in']})"
    ours = extra.get("off") is not None and extra.get("step") is None
    return f"{extra['off']} (off: not in the paper)" if ours else None


def sentence(text: str) -> str:
    """The text on one line, with a capital and a full stop."""
    whole = " ".join(text.split())
    return whole[:1].upper() + whole[1:] + ("" if whole.endswith(".") else ".")


def method_index() -> str:
    """The list of all methods."""
    lines = ["# Methods", "", "Made from the registry by `make docs`. **Bold**: the default of its stage."]
    for stage, names in ((stage, methods_of(stage)) for stage in REGISTRY):
        lines += ["", f"## {STAGES[stage]}", "", "| method | idea | paper |", "|---|---|---|"]
        for name in names:
            cls = method_class(stage, name)
            shown = f"[{name}]({stage}-{name}.md)"
            shown = f"**{shown}**" if DEFAULTS[stage] == name else shown
            lines.append(f"| {shown} | {sentence(cls.idea)} | {cls.paper} |")
    return "\n".join(lines) + "\n"
