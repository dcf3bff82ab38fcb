"""Tutorials, each a notebook: `python -m docs.notebooks [NAME …]` executes `docs/tutorials/NAME.ipynb`.

The page of the site is made of the notebook with what its cells gave (`packaging/site_tables.py`).
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent / "tutorials"
KINDS = {"image/png": "![](data:image/png;base64,{})", "text/plain": "```text\n{}\n```"}
"""What a page shows of an output, the first that is there."""


def page_of(notebook: dict[str, Any]) -> str:
    """A notebook (its JSON) as the Markdown of a page."""
    parts = []
    for cell in notebook["cells"]:
        text = "".join(cell["source"])
        parts.append(f"```python\n{text}\n```" if cell["cell_type"] == "code" else text)
        for data in (output.get("data", {}) for output in cell.get("outputs", ())):
            shown = [form.format("".join(data[kind]).strip()) for kind, form in KINDS.items() if kind in data]
            parts += shown[:1]
    return "\n\n".join(parts) + "\n"


def execute(path: Path) -> Any:
    """The notebook with new outputs; raises where a cell does."""
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(path, as_version=4)
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
    import nbformat

    names = sys.argv[1:] or sorted(path.stem for path in FOLDER.glob("*.ipynb"))
    for path in (FOLDER / f"{name}.ipynb" for name in names):
        nbformat.write(execute(path), path)
        sys.stdout.write(f"{path.name} {path.stat().st_size // 1000} kB\n")


if __name__ == "__main__":
    main()
