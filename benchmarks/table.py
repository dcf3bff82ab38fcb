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


def commit_now() -> str:
    """The commit that is checked out, or "none"."""
    command = ["git", "rev-parse", "--short", "HEAD"]
    return subprocess.run(command, capture_output=True, text=True, cwd=RESULTS).stdout.strip() or "none"


def kept_rows(name: str) -> list[dict[str, object]]:
    """The rows, as text, of the newest table `name` in benchmarks/results; none if there is none yet."""
    tables = sorted(RESULTS.glob(f"????-??-??-{name}.md"))
    if not tables:
        return []
    lines = [line for line in tables[-1].read_text(encoding="utf-8").splitlines() if line.startswith("| ")]
    columns, *rows = ([cell.strip() for cell in line.strip("| ").split(" | ")] for line in lines)
    return [dict(zip(columns, row, strict=True)) for row in rows]


def keep(
    name: str,
    title: str,
    rows: Sequence[Mapping[str, object]],
    command: str,
    note: str = "",
    shown: bool = True,
) -> Path:
    """Write the table to results/DATE-name.md, in place of an earlier one of that name, with the commit,
    machine and command; print it if `shown`."""
    commit = commit_now()
    cores = os.cpu_count()
    head = (
        f"# {title}\n\n`{command}` · commit {commit} and what stands on it · "
        f"Python {platform.python_version()}, {platform.system()}, {cores} cores\n"
    )
    body = f"{head}\n{as_markdown(rows)}\n" + (f"\n{note}\n" if note else "")
    if shown:
        print(body)
    RESULTS.mkdir(exist_ok=True)
    for earlier in RESULTS.glob(f"????-??-??-{name}.md"):
        earlier.unlink()
    path = RESULTS / f"{datetime.date.today():%Y-%m-%d}-{name}.md"
    path.write_text(body, encoding="utf-8")
    return path
