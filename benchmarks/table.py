"""Prints a benchmark's table and keeps it, dated, in benchmarks/results."""

from __future__ import annotations

import datetime
import os
import platform
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

RESULTS = Path(__file__).parent / "results"


def as_markdown(rows: Sequence[Mapping[str, object]]) -> str:
    """Rows (dicts with the same keys) as a Markdown table."""

    def text(value: object) -> str:
        return f"{value:.4g}" if isinstance(value, float) else "–" if value is None else str(value)

    columns = list(rows[0])
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    lines += ["| " + " | ".join(text(row.get(column)) for column in columns) + " |" for row in rows]
    return "\n".join(lines)


def keep(name: str, title: str, rows: Sequence[Mapping[str, object]], command: str, note: str = "") -> Path:
    """Print the table and write it to results/DATE-name.md with the commit, the machine and the command."""
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, cwd=RESULTS
    ).stdout.strip()
    cores = os.cpu_count()
    head = (
        f"# {title}\n\n`{command}` · commit {commit or 'none'} and what stands on it · "
        f"Python {platform.python_version()}, {platform.system()}, {cores} cores\n"
    )
    body = f"{head}\n{as_markdown(rows)}\n" + (f"\n{note}\n" if note else "")
    print(body)
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / f"{datetime.date.today():%Y-%m-%d}-{name}.md"
    path.write_text(body, encoding="utf-8")
    return path
