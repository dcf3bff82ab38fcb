"""The help of a command: its options under headings, its examples one a line."""

from __future__ import annotations

import inspect
import re
from typing import Any

from typer.core import TyperCommand

PANELS = ("input", "methods", "output", "run", "expert")
"""The headings, in their order."""


class PanelledCommand(TyperCommand):
    """A command whose help lists the options that most need first, and experts' last."""

    def __init__(self, *args: Any, **words: Any) -> None:
        text = inspect.cleandoc(words.get("help") or "")
        words["help"] = re.sub(r"\n\n(?=  )", "\n\n\b\n", text)  # \b: lines stay lines
        super().__init__(*args, **words)

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Arguments, then options by heading; all under one where none is an expert's."""
        panels: dict[str, list[tuple[str, str]]] = {"arguments": [], **{name: [] for name in PANELS}}
        shown = [(one, one.get_help_record(ctx)) for one in self.get_params(ctx)]
        large = any(getattr(one, "rich_help_panel", None) == PANELS[-1] for one, _ in shown)
        for one, record in shown:
            panel = getattr(one, "rich_help_panel", None) if large else None
            if one.param_type_name == "argument":
                panel = "arguments"
            if record is not None:
                panels.setdefault(panel or "options", []).append(record)
        for name, records in panels.items():
            if records:
                with formatter.section(name.capitalize()):
                    formatter.write_dl(records)
