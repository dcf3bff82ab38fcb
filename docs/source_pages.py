"""The figures of the pages of the published systems, each from the cell of a table that it names.

A figure in the words of a page is a link whose title names the row and the column of the newest table of its
kind, `[0.849](…/DATE-sources.md "delft · chen_sun · IoU")`; blocks between `<!-- figures -->` or
`<!-- steps -->` and `<!-- end -->` are made from the tables.
"""

from __future__ import annotations

import re
from pathlib import Path

FIGURE = re.compile(r'\[[^\]]*\]\((\S*?/)\d{4}-\d\d-\d\d-([\w-]+)\.md "([^"]+)"\)')
BLOCK = re.compile(r"<!-- (figures|steps) -->\n.*?<!-- end -->", re.DOTALL)
SETS = ("delft", "ign_urban", "town, blind", "amsterdam, blind", "williams, blind", "delft, footprints")
COLUMNS = (
    *("DTM error %", "compl.", "corr.", "IoU", "mask IoU", "objects over 10 m²", "at LoD 2.2"),
    *("moments/mixed/faces/prism", "RMSE to class 6, mean/median", "within 0.2 m", "CPU s"),
)
DRAWN = ("DTM error %", "compl.", "corr.", "IoU", "objects compl.", "objects corr.", "CPU s")
Table = list[dict[str, str]]


def newest(results: Path, kind: str) -> Path:
    """The newest table of a kind; StopIteration where there is none."""
    return next(reversed(sorted(results.glob(f"????-??-??-{kind}.md"))))


def rows_of(path: Path) -> Table:
    """The rows of a table, by the names of its columns."""
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if line.startswith("| ")]
    columns, *rows = ([cell.strip() for cell in line.strip("| ").split(" | ")] for line in lines)
    return [dict(zip(columns, row, strict=True)) for row in rows]


def cell_of(results: Path, kind: str, title: str) -> str:
    """The cell that a title names: the first cells of its row, then its column; ValueError for none."""
    *key, column = title.split(" · ")
    for row in rows_of(newest(results, kind)):
        if list(row.values())[: len(key)] == key and column in row:
            return row[column]
    raise ValueError(f"{kind}: no cell '{title}'")


def shown(cell: str) -> str:
    """A cell as a page shows it: a decimal to three digits, anything else as it stands."""
    return f"{float(cell):.3g}" if re.fullmatch(r"-?\d*\.\d+", cell) else cell


def table_of(rows: Table, columns: tuple[str, ...]) -> list[str]:
    """Lines of a Markdown table of those columns in which any row has something."""
    some = [name for name in columns if any(row.get(name, "–") != "–" for row in rows)]
    lines = ["| " + " | ".join(some) + " |", "|" + "---|" * len(some)]
    return lines + ["| " + " | ".join(shown(row.get(name, "–")) for name in some) + " |" for row in rows]


def figures(results: Path, source: str, folder: str) -> list[str]:
    """What a chain reaches on surveys and on the drawn towns, and the tables that say so."""
    mine = re.compile(rf"{source}(, .*)?")
    surveys = [row for row in rows_of(newest(results, "sources")) if mine.fullmatch(row["chain"])]
    lines = table_of([row for row in surveys if row["data"] in SETS], ("data", "chain", *COLUMNS))
    towns = [row for row in rows_of(newest(results, "sources-drawn")) if mine.fullmatch(row["chain"])]
    lines += [
        "",
        f"[Commands of these rows]({folder}{newest(results, 'sources').name}). On five drawn towns:",
    ]
    beside = tuple(name for name in towns[0] if "found" in name)
    lines += ["", *table_of(towns, ("chain", *DRAWN)), "", "Where trees touch a building, and elsewhere:", ""]
    return [*lines, *table_of(towns, ("chain", *beside)), ""]


def steps(results: Path, source: str, folder: str) -> list[str]:
    """What each step is worth: the figures without it."""
    path = newest(results, "sources-ablation")
    mine = [row for row in rows_of(path) if row.pop("source") == source]
    return [*table_of(mine, tuple(mine[0])), "", f"[Commands]({folder}{path.name})", ""]


def source_page(text: str, source: str, results: Path) -> str:
    """A page with every figure from its table."""
    folder = "../../benchmarks/results/"

    def block(match: re.Match[str]) -> str:
        lines = {"figures": figures, "steps": steps}[match[1]](results, source, folder)
        return "\n".join([f"<!-- {match[1]} -->", *lines, "<!-- end -->"])

    def figure(match: re.Match[str]) -> str:
        place, kind, title = match.groups()
        return f'[{shown(cell_of(results, kind, title))}]({place}{newest(results, kind).name} "{title}")'

    return FIGURE.sub(figure, BLOCK.sub(block, text))
