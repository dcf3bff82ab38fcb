"""Tutorials as executed notebooks: `python -m docs.notebooks [NAME …]` writes `docs/tutorials/NAME.ipynb`.

A tutorial is the page `docs/tutorials/NAME.md`: its Python blocks are the cells.
"""

from __future__ import annotations

import re
import sys
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient

FOLDER = Path(__file__).parent / "tutorials"
BLOCK = re.compile(r"```python\n(.*?)```\n?", re.DOTALL)


def notebook_of(page: Path) -> nbformat.NotebookNode:
    """The notebook of a page, not yet executed."""
    kinds = nbformat.v4.new_markdown_cell, nbformat.v4.new_code_cell
    parts = enumerate(BLOCK.split(page.read_text(encoding="utf-8")))
    cells = [kinds[number % 2](part.strip()) for number, part in parts if part.strip()]
    for number, cell in enumerate(cells):
        cell["id"] = f"cell-{number}"
    return nbformat.v4.new_notebook(cells=cells)


def execute(page: Path) -> nbformat.NotebookNode:
    """The notebook of a page with its outputs; raises where a cell does."""
    notebook = notebook_of(page)
    with tempfile.TemporaryDirectory() as folder:
        client = NotebookClient(notebook, kernel_name="python3", resources={"metadata": {"path": folder}})
        client.execute()
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
        if cell.cell_type == "code":  # progress and warnings differ from run to run
            cell.outputs = [one for one in cell.outputs if one.get("name") != "stderr"]
    notebook.metadata.pop("language_info", None)
    return notebook


def main() -> None:
    """Execute the tutorials that are named, or all."""
    names = sys.argv[1:] or sorted(page.stem for page in FOLDER.glob("*.md"))
    for name in names:
        path = FOLDER / f"{name}.ipynb"
        nbformat.write(execute(FOLDER / f"{name}.md"), path)
        sys.stdout.write(f"{path.name} {path.stat().st_size // 1000} kB\n")


if __name__ == "__main__":
    main()
