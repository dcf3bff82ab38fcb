"""The tutorials: notebooks are those of their pages, and every cell runs."""

from __future__ import annotations

from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat")
pytest.importorskip("nbclient")

from docs.notebooks import FOLDER, execute, notebook_of  # noqa: E402

PAGES = sorted(FOLDER.glob("*.md"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_notebook_has_the_cells_of_its_page(page: Path) -> None:
    written = nbformat.read(page.with_suffix(".ipynb"), as_version=4)
    assert [cell.source for cell in written.cells] == [cell.source for cell in notebook_of(page).cells]
    assert sum(bool(cell.get("outputs")) for cell in written.cells) > 1
    assert page.with_suffix(".ipynb").stat().st_size < 200_000


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_cell_of_a_tutorial_runs(page: Path) -> None:
    execute(page)
