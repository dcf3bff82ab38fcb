"""report.html: one page with the plan, the table of buildings and the summary, that opens from disk."""

from __future__ import annotations

import base64
import html
import io
import json
from pathlib import Path
from typing import Any

from eaves.formats import read_polygons
from eaves.formats.atomic import atomic
from eaves.tiling.outputs import Summary
from eaves.viewer.plan import plan_figure

COLUMNS = (
    "id",
    "lod",
    "roof_type",
    "score",
    "area_m2",
    "h_ground",
    "h_eaves",
    "h_ridge",
    "rmse_m",
    "failure_code",
    "failure_reason",
)
"""Columns of the table, where a run has them."""

STYLE = """
:root { color-scheme: light dark; font: 15px/1.45 system-ui, sans-serif; }
body { max-width: 1100px; margin: 2rem auto; padding: 0 1rem; }
img { max-width: 100%; background: white; }
table { border-collapse: collapse; font-size: 13px; width: 100%; }
th, td { text-align: left; padding: 2px 8px; border-bottom: 1px solid #8884; }
th { cursor: pointer; position: sticky; top: 0; background: Canvas; }
pre { white-space: pre-wrap; }
"""
SCRIPT = """
document.querySelectorAll('th').forEach((head, column) => head.addEventListener('click', () => {
  const body = head.closest('table').tBodies[0], up = head.dataset.up = head.dataset.up === '1' ? '0' : '1';
  const value = row => { const text = row.cells[column].textContent, number = parseFloat(text);
    return isNaN(number) ? text : number; };
  const order = (a, b) => { const x = value(a), y = value(b); return x < y ? -1 : x > y ? 1 : 0; };
  [...body.rows].sort((a, b) => up === '1' ? order(a, b) : order(b, a)).forEach(row => body.append(row));
}));
"""


def write_report(summary: Summary) -> Path:
    """Write report.html into the run's folder; its path."""
    path = summary.folder / "report.html"
    _, _, rows, _ = read_polygons(summary.folder / "footprints.gpkg", layer="footprints")
    page = "\n".join(
        [
            "<!doctype html><html lang='en'><head><meta charset='utf-8'><title>eaves report</title>",
            f"<style>{STYLE}</style></head><body><h1>Buildings</h1>",
            f"<pre>{html.escape(summary.as_text())}</pre>",
            plan_picture(summary.folder),
            table(rows),
            f"<h2>Run</h2><pre>{html.escape(json.dumps(summary.run, indent=1, default=str))}</pre>",
            f"<script>{SCRIPT}</script></body></html>",
        ]
    )
    with atomic(path) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return path


def plan_picture(folder: Path) -> str:
    """The plan as an image inside the page; nothing where there are no rasters."""
    if not (folder / "dsm.tif").exists():
        return ""
    buffer = io.BytesIO()
    plan_figure(folder).savefig(buffer, format="png", dpi=130)
    picture = base64.b64encode(buffer.getvalue()).decode()
    return f"<h2>Plan</h2><img alt='plan of the buildings' src='data:image/png;base64,{picture}'>"


def table(rows: list[dict[str, Any]]) -> str:
    """All buildings, a row each; a click on a heading sorts."""
    there = [name for name in COLUMNS if any(name in row for row in rows)]
    head = "".join(f"<th>{name}</th>" for name in there)
    lines = "".join(
        "<tr>" + "".join(f"<td>{cell(row.get(name))}</td>" for name in there) + "</tr>" for row in rows
    )
    return (
        f"<h2>{len(rows)} buildings</h2><table><thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table>"
    )


def cell(value: Any) -> str:
    """A value as table text."""
    if value is None or value != value:
        return ""
    return html.escape(f"{value:.2f}" if isinstance(value, float) else str(value))
