"""The tutorials: every cell runs, and the page of the site has all of them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from docs.notebooks import FOLDER, execute, page_of

NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_page_has_the_cells_of_its_notebook(path: Path) -> None:
    notebook = json.loads(path.read_text(encoding="utf-8"))
    page = page_of(notebook)
    assert page.startswith("# ") and all("".join(cell["source"]) in page for cell in notebook["cells"])
    assert sum(bool(cell.get("outputs")) for cell in notebook["cells"]) > 1
    assert path.stat().st_size < 200_000


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_every_cell_of_a_tutorial_runs(path: Path) -> None:
    pytest.importorskip("nbclient")
    execute(path)
